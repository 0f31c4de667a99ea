//! Zarr folders that this program has written, known by what is in them: only such a one is replaced by an output. A folder of Zarr may hold
//! years of others' work, labels and further images beside the one that an output would be.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

use serde_json::Value;

use crate::storage::regular;

/// The array's name in the group.
pub(crate) const LEVEL: &str = "0";
/// The attribute of the group that says how the volume lies in the world, and that this program has made it.
pub(crate) const ATTRIBUTE: &str = "interslice";
/// The file of a group or an array that describes it, and the folder of an array's chunks.
const METADATA: &str = "zarr.json";
const CHUNKS: &str = "c";
/// What macOS leaves in every folder that was looked at.
const LEFT_BY_SYSTEM: &str = ".DS_Store";
/// Most bytes of metadata that are read; those that are written take some thousands.
const MOST_BYTES: u64 = 16 << 20;
/// Most things that a message names.
const MOST_NAMED: usize = 5;

/// Why a folder must not be replaced; nothing where it is a volume that this program has written and nothing else.
///
/// # Errors
/// The errors of reading the folder.
pub(crate) fn what_stays(folder: &Path) -> io::Result<Option<String>> {
    if !folder.join(METADATA).is_file() {
        return Ok(Some("is a folder, but none of Zarr, and is not replaced".into()));
    }
    let mut others = others(folder, "", &[METADATA, LEVEL])?;
    if others.is_empty() {
        others = self::others(&folder.join(LEVEL), "0/", &[METADATA, CHUNKS])?;
    }
    if !others.is_empty() {
        let more = others.len().saturating_sub(MOST_NAMED);
        others.truncate(MOST_NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let named = format!("`{}`{more}", others.join("`, `"));
        return Ok(Some(format!(
            "is a Zarr that holds more than an output does ({named}), and is not replaced; give the output another name"
        )));
    }
    let whole: Value = serde_json::from_slice(&regular::begin(&folder.join(METADATA), MOST_BYTES)?).unwrap_or_default();
    let own = whole["attributes"].get(ATTRIBUTE).is_some();
    let said = "is a Zarr that another program has written, and is not replaced; give the output another name";
    Ok((!own).then(|| said.into()))
}

/// Names in a folder, sorted, besides those `known`; none where there is no such folder.
fn others(folder: &Path, before: &str, known: &[&str]) -> io::Result<Vec<String>> {
    let entries = match fs::read_dir(folder) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let name = entry?.file_name();
        if name != LEFT_BY_SYSTEM && known.iter().all(|known| OsStr::new(known) != name) {
            names.push(format!("{before}{}", name.to_string_lossy()));
        }
    }
    names.sort();
    Ok(names)
}
