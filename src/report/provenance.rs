//! Provenance: of what, with which options, when and where a result was made.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// What a result was made of.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Time at which the report was made, UTC (RFC 3339); that of SOURCE_DATE_EPOCH where this is set. None in a batch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// Files that were read.
    pub inputs: Vec<InputFile>,
    /// Names of the ROIs or labels that became the body, as far as the input says them; else their numbers.
    pub bodies: Vec<String>,
    /// Options that were given, by their long names with _ for -; those that are not here have their defaults.
    pub options: Map<String, Value>,
    /// The machine; none in a batch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<MachineReport>,
}

impl Provenance {
    /// This without what differs from run to run and from folder to folder.
    pub fn lasting(self) -> Self {
        let name = |file: &str| Path::new(file).file_name().map(|name| name.to_string_lossy().into_owned());
        let inputs = self.inputs.into_iter().map(|i| InputFile { file: name(&i.file).unwrap_or(i.file), ..i });
        Provenance { date: None, machine: None, inputs: inputs.collect(), ..self }
    }
}

/// A file that was read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Its path as it was named; in a batch its name.
    pub file: String,
    /// Its length; of a folder (Zarr) that of all files in it.
    pub bytes: u64,
    /// Its SHA-256 digest, hexadecimal; of a folder that of the lines that `sha256sum` writes of its files, sorted by name.
    pub sha256: String,
}

/// A machine that computes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MachineReport {
    /// Its name.
    pub host: String,
    /// Operating system and its version.
    pub system: String,
    /// Architecture, such as x86_64.
    pub architecture: String,
    /// Threads of the computation.
    pub threads: usize,
}
