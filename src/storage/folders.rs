//! What is in a folder.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// The first `most` files in a folder and the folders below it, those nearest first.
///
/// # Errors
/// The errors of reading the folder itself; those below that cannot be read are left out.
pub fn nearest_files(folder: &Path, most: usize) -> io::Result<Vec<PathBuf>> {
    let (mut files, mut open) = (Vec::new(), vec![folder.to_path_buf()]);
    fs::read_dir(folder)?;
    while !open.is_empty() && files.len() < most {
        let mut entries: Vec<PathBuf> = Vec::new();
        for folder in std::mem::take(&mut open).iter().take(most) {
            let room = most.saturating_sub(files.len());
            entries.extend(fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).take(room));
        }
        entries.sort();
        for path in entries {
            let is_folder = fs::symlink_metadata(&path).is_ok_and(|m| m.is_dir());
            if is_folder { open.push(path) } else { files.push(path) }
        }
    }
    files.truncate(most);
    Ok(files)
}

/// All files in a folder and the folders below it, sorted.
///
/// # Errors
/// The errors of reading the folders.
pub fn files_below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            if entry.file_type()?.is_dir() { open.push(entry.path()) } else { files.push(entry.path()) }
        }
    }
    files.sort();
    Ok(files)
}
