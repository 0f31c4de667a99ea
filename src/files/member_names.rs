//! Names of files that hold one of several bodies: `out.stl` becomes `out.Heart.stl`, `out.nii.gz` `out.5.nii.gz`.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::format::extension_at;

/// Words in a file's name that say what it holds.
const TAKEN: [&str; 3] = ["contours", "origin", "confidence"];

/// Words for bodies of these names and numbers, each its own: letters, digits, `-`, `_` and `+` of the name, and the number where another has the same.
pub fn words<'n>(bodies: impl Iterator<Item = (&'n str, i64)>) -> Vec<String> {
    let mut taken = HashSet::from(TAKEN.map(String::from));
    let word = |(name, number): (&str, i64)| {
        let mut word = plain(name);
        if !taken.insert(word.to_lowercase()) {
            word = format!("{word}-{number}");
            taken.insert(word.to_lowercase());
        }
        word
    };
    bodies.map(word).collect()
}

fn plain(name: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || "-_+".contains(c) { c } else { '_' };
    let name: String = name.trim().chars().map(safe).collect();
    if name.is_empty() { "ROI".into() } else { name }
}

/// The name of a file for one body, with its word before the extension.
pub fn with_word(path: &Path, word: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let at = extension_at(&name);
    path.with_file_name(format!("{}.{word}{}", &name[..at], &name[at..]))
}
