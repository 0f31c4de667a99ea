//! Trust in a driver: before `--backend auto` takes a GPU, it runs a short self-test, whose outcome is remembered in the user's cache folder.
//!
//! It is remembered for an adapter, its driver and the kernels of this program; another of them is tested again. What cannot be read is tested
//! again, what cannot be written is not remembered, and neither fails a run.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use super::Gpu;
use super::adapter::AdapterSummary;
use super::kernels::interfaces;
use super::selftest::doctor;
use crate::error::Result;
use crate::storage::temporaries::{Listed, uninterrupted};

/// Name of the file in the cache folder.
pub const FILE: &str = "gpu-self-tests.json";
/// Outcomes that are kept at most: a file that has more is begun anew.
const MOST_KEPT: usize = 64;

/// Outcome of a self-test.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outcome {
    /// Adapter and driver, for people.
    pub tested: String,
    /// Stages that are wrong; none where the driver can be trusted.
    pub wrong: Vec<String>,
}

/// Folder in which programs keep for a user what they can make again; none where the system names none.
pub fn cache_folder() -> Option<PathBuf> {
    let named = |name: &str| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let home = |folder: &str| named("HOME").map(|home| home.join(folder));
    let folder = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        home("Library/Caches")
    } else {
        named("XDG_CACHE_HOME").or_else(|| home(".cache"))
    };
    folder.map(|folder| folder.join("interslice"))
}

/// Outcome for this adapter that `folder` remembers.
pub fn remembered(folder: Option<&Path>, summary: &AdapterSummary) -> Option<Outcome> {
    all(&folder?.join(FILE)).remove(&key(summary))
}

/// Outcome for a GPU: the remembered one, or that of a self-test now, and whether it was run now.
///
/// # Errors
/// [`crate::Error::Gpu`] when the GPU cannot do the work; that is not remembered.
pub fn examined(folder: Option<&Path>, gpu: &Gpu) -> Result<(Outcome, bool)> {
    let summary = &gpu.device.summary;
    if let Some(outcome) = remembered(folder, summary) {
        return Ok((outcome, false));
    }
    let wrong = doctor::examine_shortly(gpu)?.into_iter().filter(|stage| !stage.holds());
    let wrong = wrong.map(|stage| format!("{} at {}", stage.stage, stage.place)).collect();
    let outcome = Outcome { tested: format!("{} ({}, {})", summary.name, summary.api, summary.driver), wrong };
    if let Some(folder) = folder {
        // A folder that cannot be written to costs the next run a self-test, nothing else.
        let _ = remember(folder, key(summary), outcome.clone());
    }
    Ok((outcome, true))
}

/// Name of an adapter with its driver and the kernels that it was tested with.
fn key(summary: &AdapterSummary) -> String {
    let AdapterSummary { name, api, driver, .. } = summary;
    let mut hash = blake3::Hasher::new();
    for part in [name, api, driver, env!("CARGO_PKG_VERSION")] {
        hash.update(&(part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
    for shader in interfaces() {
        hash.update(shader.text.as_bytes());
    }
    hash.finalize().to_hex().to_string()
}

/// All outcomes of a file; none of one that cannot be read.
fn all(file: &Path) -> BTreeMap<String, Outcome> {
    fs::read(file).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

/// Adds an outcome to the file, which always holds either all of the old or all of the new.
fn remember(folder: &Path, key: String, outcome: Outcome) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let file = folder.join(FILE);
    let mut outcomes = all(&file);
    if outcomes.len() >= MOST_KEPT {
        outcomes.clear();
    }
    outcomes.insert(key, outcome);
    let (mut new, _listed) = Listed::make(|| NamedTempFile::new_in(folder), NamedTempFile::path)?;
    serde_json::to_writer_pretty(&mut new, &outcomes)?;
    uninterrupted(|| new.persist(file))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(driver: &str) -> AdapterSummary {
        let [name, api, kind] = ["A", "Vulkan", "discrete"].map(String::from);
        let (memory, largest_binding, largest_buffer, lacks) = (None, 1 << 30, 1 << 30, None);
        AdapterSummary {
            index: 0,
            name,
            api,
            kind,
            driver: driver.into(),
            memory,
            largest_binding,
            largest_buffer,
            lacks,
        }
    }

    #[test]
    fn an_outcome_is_that_of_its_driver() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().join("new/interslice");
        let [old, new] = ["1.0", "1.1"].map(adapter);
        let outcome =
            |wrong: &[&str]| Outcome { tested: "A".into(), wrong: wrong.iter().map(|w| w.to_string()).collect() };
        assert_eq!(remembered(Some(&folder), &old), None);
        assert_eq!(remembered(None, &old), None);
        remember(&folder, key(&old), outcome(&["morphs"])).expect("it can be written");
        assert_eq!(remembered(Some(&folder), &new), None, "another driver is tested anew");
        remember(&folder, key(&new), outcome(&[])).expect("it can be written");
        assert_eq!(remembered(Some(&folder), &old), Some(outcome(&["morphs"])));
        assert_eq!(remembered(Some(&folder), &new), Some(outcome(&[])));
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 1, "nothing else is left");
    }

    #[test]
    fn what_cannot_be_read_or_written_is_forgotten() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().join("interslice");
        fs::create_dir(&folder).expect("a folder");
        for damaged in ["", "{", "[1]", "{\"key\": {\"tested\": 1}}"] {
            fs::write(folder.join(FILE), damaged).expect("it can be written");
            assert_eq!(remembered(Some(&folder), &adapter("1.0")), None, "{damaged}");
        }
        let outcome = Outcome { tested: "A".into(), wrong: Vec::new() };
        remember(&folder, key(&adapter("1.0")), outcome.clone()).expect("what is damaged is replaced");
        assert_eq!(remembered(Some(&folder), &adapter("1.0")), Some(outcome.clone()));
        let file = folder.join(FILE);
        assert!(remember(&file, String::new(), outcome).is_err(), "a file is no folder");
    }
}
