//! Provenance of a result: read off its input, its options and the machine when a report is wanted.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use sysinfo::System;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::JobOptions;
use crate::error::{Error, Result};
use crate::report::provenance::{InputFile, MachineReport, Provenance};
use crate::stack::appearance::Appearance;
use crate::storage::folders::files_below;

/// Time that reproducible builds name instead of now, seconds since 1970.
const EPOCH: &str = "SOURCE_DATE_EPOCH";
/// Bytes of a file that are read at once.
const PIECE: usize = 1 << 20;

/// Input and options as they were given, before reading has filled in what is missing.
#[derive(Debug, Clone)]
pub struct Source {
    input: PathBuf,
    files: Vec<PathBuf>,
    options: Map<String, Value>,
}

impl Source {
    /// What is given.
    ///
    /// # Errors
    /// The errors of [`JobOptions::files`].
    pub fn of(input: &Path, options: &JobOptions) -> Result<Self> {
        let mut given = Map::new();
        let default = JobOptions::default();
        differing(&options.read, &default.read, &mut given);
        differing(&options.settings, &default.settings, &mut given);
        differing(&options.output, &default.output, &mut given);
        if let Some(links) = &options.links.links {
            given.insert("links".into(), links.display().to_string().into());
        }
        Ok(Source { input: input.into(), files: options.files(input)?, options: given })
    }

    /// This with an option that is none of a job's own.
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.options.insert(name.into(), value.into());
        self
    }

    /// The provenance of what became of `bodies`.
    ///
    /// # Errors
    /// [`Error::Read`] where a file cannot be read again; [`Error::Setting`] for a `SOURCE_DATE_EPOCH` that is no time.
    pub fn provenance(&self, bodies: &[Appearance]) -> Result<Provenance> {
        let files: &[PathBuf] = if self.files.is_empty() { std::slice::from_ref(&self.input) } else { &self.files };
        let file = |path: &PathBuf| {
            let digest = if path.is_dir() { sha256_of_folder(path) } else { sha256(path) };
            let (bytes, sha256) = digest.map_err(|source| Error::Read { path: path.clone(), source })?;
            Ok(InputFile { file: path.display().to_string(), bytes, sha256 })
        };
        let named = |body: &Appearance| body.name.clone().or_else(|| Some(body.number?.to_string()));
        Ok(Provenance {
            date: Some(date()?),
            inputs: files.iter().map(file).collect::<Result<_>>()?,
            bodies: bodies.iter().filter_map(named).collect(),
            options: self.options.clone(),
            machine: Some(MachineReport {
                host: System::host_name().unwrap_or_default(),
                system: System::long_os_version().unwrap_or_else(|_| std::env::consts::OS.into()),
                architecture: std::env::consts::ARCH.into(),
                threads: rayon::current_num_threads(),
            }),
        })
    }
}

/// Adds the options that are not as in `default`.
fn differing<T: Serialize>(own: &T, default: &T, given: &mut Map<String, Value>) {
    let [own, default] = [own, default].map(|options| serde_json::to_value(options).unwrap_or_default());
    let (Value::Object(own), Value::Object(default)) = (own, default) else { return };
    given.extend(own.into_iter().filter(|(name, value)| default.get(name) != Some(value)));
}

/// Length and SHA-256 digest of a file.
fn sha256(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let (mut hasher, mut piece, mut bytes) = (Sha256::new(), vec![0; PIECE], 0);
    loop {
        match file.read(&mut piece)? {
            0 => break,
            n => {
                hasher.update(&piece[..n]);
                bytes += n as u64;
            }
        }
    }
    Ok((bytes, hexadecimal(hasher)))
}

/// Length of all files in a folder and below it, and the SHA-256 digest of lines `digest  name`, sorted by name, as `sha256sum` writes them.
fn sha256_of_folder(folder: &Path) -> io::Result<(u64, String)> {
    let (mut hasher, mut bytes) = (Sha256::new(), 0);
    for path in files_below(folder)? {
        let (length, digest) = sha256(&path)?;
        let name = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().replace('\\', "/");
        hasher.update(format!("{digest}  {name}\n"));
        bytes += length;
    }
    Ok((bytes, hexadecimal(hasher)))
}

fn hexadecimal(hasher: Sha256) -> String {
    hasher.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Now, or the time that the environment names.
fn date() -> Result<String> {
    let wrong = |text: &str| Error::Setting {
        name: EPOCH.into(),
        message: format!("must be whole seconds since 1970 in the environment; got `{text}`"),
    };
    let time = match std::env::var(EPOCH) {
        Ok(text) => {
            let seconds = text.trim().parse().map_err(|_| wrong(&text))?;
            OffsetDateTime::from_unix_timestamp(seconds).map_err(|_| wrong(&text))?
        }
        Err(_) => OffsetDateTime::now_utc(),
    };
    let time = time.replace_nanosecond(0).unwrap_or(time);
    time.format(&Rfc3339).map_err(|e| Error::Setting { name: "date".into(), message: format!("cannot be told: {e}") })
}
