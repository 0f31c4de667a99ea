//! Fingerprint of all that the bytes of a result depend on, as one number: program version, options, content of the input and of the links file.

use std::fs::File;
use std::io;
use std::path::Path;

use blake3::Hasher;

use super::JobOptions;
use crate::error::{Error, Result};
use crate::storage::folders::files_below;

/// The fingerprint of a reconstruction and of some `words` that matter to the caller, 64 hexadecimal digits. Equal content gives equal
/// fingerprints, whatever the input is called; an option that is given its default value is as one not given.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`] for an input that cannot be read.
pub fn fingerprint(input: &Path, options: &JobOptions, words: &[&str]) -> Result<String> {
    let mut hasher = Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(env!("CARGO_PKG_VERSION").as_bytes());
    let told = serde_json::to_string(options)
        .map_err(|e| Error::Setting { name: "options".into(), message: e.to_string() })?;
    part(told.as_bytes());
    part(&(words.len() as u64).to_le_bytes());
    words.iter().for_each(|word| part(word.as_bytes()));
    for file in options.files(input)? {
        part(digest(&file).map_err(|source| Error::Read { path: file.clone(), source })?.1.as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Length and BLAKE3 digest of a file; of a folder those of its files, with their names.
///
/// # Errors
/// The errors of reading it.
pub fn digest(path: &Path) -> io::Result<(u64, String)> {
    let mut hasher = Hasher::new();
    if !path.is_dir() {
        hasher.update_reader(File::open(path)?)?;
        return Ok((hasher.count(), hasher.finalize().to_hex().to_string()));
    }
    let mut bytes = 0;
    for file in files_below(path)? {
        let name = file.strip_prefix(path).unwrap_or(&file).as_os_str().as_encoded_bytes();
        let (length, blake3) = digest(&file)?;
        bytes += length;
        hasher.update(&(name.len() as u64).to_le_bytes()).update(name).update(blake3.as_bytes());
    }
    Ok((bytes, hasher.finalize().to_hex().to_string()))
}
