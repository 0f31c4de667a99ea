//! Wrong volumes: each format cut short, with flipped bits, with sizes its file cannot hold; a clear error with exit code 2, no panic.

mod damaged;
mod fields;
#[path = "../support/files.rs"]
mod files;
mod nifti;
mod numpy;
mod sound;
#[path = "../support/mod.rs"]
mod support;
mod volumes;
