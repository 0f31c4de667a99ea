//! The program as a user meets it: outputs, settings file, report, inspect, demo, pictures.

mod arguments;
#[cfg(feature = "gpu")]
mod backends;
mod endings;
#[path = "../support/files.rs"]
mod files;
mod foretold;
mod help;
mod runs;
mod settings_file;
