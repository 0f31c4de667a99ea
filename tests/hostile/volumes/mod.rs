//! Wrong volumes: each format cut short, with flipped bits, with sizes its file cannot hold; a clear error with exit code 2, no panic.

mod damaged;
mod fields;
mod nifti;
mod numpy;
mod sound;
mod sources;
