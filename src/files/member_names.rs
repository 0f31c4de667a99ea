//! Names of files that hold one of several bodies: `out.stl` becomes `out.Heart.stl`, `out.nii.gz` `out.5.nii.gz`.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::format::{extension_at, telling_words};

/// Most bytes of a word, so that a name chosen by the user has room beside it: file systems take 255.
const LONGEST: usize = 120;

/// Words for bodies of these names and numbers, each its own in upper and lower case: letters, digits, `-`, `_` and `+` of the name, and the number
/// where another has the same, or where the word would make another kind of file of a name (`dem` of `out.tif`). None leads to another folder.
pub fn words<'n>(bodies: impl Iterator<Item = (&'n str, i64)>) -> Vec<String> {
    let mut taken: HashSet<String> = telling_words().map(String::from).collect();
    let word = |(name, number): (&str, i64)| {
        let plain = plain(name);
        let own = format!("{plain}-{number}");
        // That may be another's name.
        let others = (2..).map(|k| format!("{own}-{k}"));
        let mut words = [plain, own.clone()].into_iter().chain(others);
        words.find(|word| taken.insert(folded(word))).unwrap_or_default()
    };
    bodies.map(word).collect()
}

/// A word as file systems without case see it.
fn folded(word: &str) -> String {
    word.to_uppercase().to_lowercase()
}

fn plain(name: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || "-_+".contains(c) { c } else { '_' };
    let mut word = String::new();
    for c in name.trim().chars().map(safe) {
        if word.len() + c.len_utf8() > LONGEST {
            break;
        }
        word.push(c);
    }
    if word.is_empty() { "ROI".into() } else { word }
}

/// The name of a file for one body, with its word before the extension.
pub fn with_word(path: &Path, word: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let at = extension_at(&name);
    path.with_file_name(format!("{}.{word}{}", &name[..at], &name[at..]))
}
