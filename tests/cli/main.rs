//! The program as a user meets it: outputs, settings file, report, inspect, demo, pictures.

mod arguments;
#[cfg(feature = "gpu")]
mod backends;
mod closed_pipe;
mod endings;
mod evaluate;
mod examples;
#[path = "../support/files.rs"]
mod files;
mod foretold;
mod help;
mod runs;
mod settings_file;
