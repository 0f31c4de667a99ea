//! Errors: every way to fail.
//!
//! A message has the name, the value, the limit and the way out. [`Error::exit_code`] tells the two kinds apart:
//! 2 for input, settings or outputs that are wrong and for too little memory (found before anything is computed), 1 for work that failed.

use std::path::{Path, PathBuf};

/// Shorthand for `std::result::Result<T, interslice::Error>`.
pub type Result<T> = std::result::Result<T, Error>;

/// Error of a run: every way to fail.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder cannot be opened or read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A file's content is not what its format demands.
    #[error("{}: {message}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Field or line, value found, value expected.
        message: String,
    },
    /// One slice does not fit the stack.
    #[error("slice {index} (`{name}`): {message}")]
    Slice {
        /// Position in the stack, from 0.
        index: usize,
        /// File name, or the slice's own name.
        name: String,
        /// Value found and the limit.
        message: String,
    },
    /// The stack as a whole cannot be reconstructed.
    #[error("stack: {0}")]
    Stack(String),
    /// A setting lies outside its range.
    #[error("`{name}` {message}")]
    Setting {
        /// Name of the setting.
        name: String,
        /// Range and value, e.g. "must lie in (0, 1); got 1.2".
        message: String,
    },
    /// The machine does not have the memory the job needs.
    #[error(
        "this job needs about {needed_mib} MiB of memory, {available_mib} MiB are available; use a coarser `--dz`, fewer outputs (pictures, pages and Zarr take the most), a smaller stack, or parts of it (`interslice plan`)"
    )]
    Memory {
        /// Estimate for the whole job, MiB.
        needed_mib: u64,
        /// Available now, MiB.
        available_mib: u64,
    },
    /// The disk does not have the room that a run larger than memory needs.
    #[error(
        "{}: {needed_mib} MiB are needed for temporary files, {available_mib} MiB are free; set TMPDIR to a folder with more room", folder.display()
    )]
    Disk {
        /// Folder of temporary files.
        folder: PathBuf,
        /// Estimate, MiB.
        needed_mib: u64,
        /// Free now, MiB.
        available_mib: u64,
    },
    /// An output cannot be created; found before the work starts.
    #[error("{}: cannot write: {message}", path.display())]
    Output {
        /// The output as named by the user.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// Writing an output failed half way (disk full, folder removed). The temporary file is gone, the old file untouched.
    #[error("{}: writing failed: {source}", path.display())]
    Write {
        /// The output.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// Lines of a manifest are wrong; found before any job ran.
    #[error("{}: {} wrong, nothing was run{}", path.display(), counted(lines.len(), "thing"), listed(lines.iter().map(|(n, m)| format!("line {n}: {m}"))))]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// Every line that is wrong, by number from 1, with field, value and limit.
        lines: Vec<(usize, String)>,
    },
    /// Jobs of a batch have failed, or were not run.
    #[error("{} failed, {not_run} not run, of {of}{}", counted(failed.len(), "job"), listed(failed.iter().map(|(id, m)| format!("{id}: {m}"))))]
    Batch {
        /// The jobs that failed, and why.
        failed: Vec<(String, String)>,
        /// Jobs that were not run, because the batch was stopped.
        not_run: usize,
        /// All jobs.
        of: usize,
    },
    /// The GPU cannot do the work: no adapter, limits too small, a lost or hanging device, a driver's complaint.
    #[error("GPU: {0}")]
    Gpu(String),
    /// The GPU has no memory for as many jobs at once, or for the one that is left.
    #[error("GPU: {0}")]
    GpuMemory(String),
    /// The run was ended by its listener ([`Progress::stops`](crate::Progress::stops)).
    #[error("interrupted")]
    Interrupted,
    /// A numeric stage produced something that must not be: a NaN, a vanished group.
    #[error("stage `{stage}`: {message}")]
    Numerics {
        /// Name of the stage.
        stage: &'static str,
        /// The value that was found, and its place.
        message: String,
    },
}

impl Error {
    /// The error of a stack that a file holds: what is wrong with the stack as a whole is said of the file.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Error::Stack(message) => Error::Format { path: path.into(), message },
            other => other,
        }
    }

    /// Exit code of the program: 2 input or settings wrong, 1 the work failed.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Write { .. }
            | Error::Numerics { .. }
            | Error::Gpu(_)
            | Error::GpuMemory(_)
            | Error::Interrupted
            | Error::Batch { .. } => 1,
            _ => 2,
        }
    }
}

/// A number of things.
pub(crate) fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Indented lines, one for each.
fn listed(lines: impl Iterator<Item = String>) -> String {
    lines.map(|line| format!("\n  {line}")).collect()
}
