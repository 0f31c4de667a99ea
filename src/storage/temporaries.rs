//! Temporary files and folders that have names: they are removed when the program is interrupted.
//!
//! A drop removes them in any other case, but an interrupt ends the program without one. Files without names need nothing: they are gone with the
//! program.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Attempts to remove a folder into which other threads still write.
const ATTEMPTS: usize = 100;

/// What is there now.
static THERE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn there() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    THERE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file or folder that an interrupt removes as long as this lives.
#[derive(Debug)]
pub struct Listed(PathBuf);

impl Listed {
    /// Makes one by `make`, which an interrupt waits for; `path` says what it is called.
    ///
    /// # Errors
    /// The errors of `make`.
    pub fn make<T>(make: impl FnOnce() -> io::Result<T>, path: impl FnOnce(&T) -> &Path) -> io::Result<(T, Self)> {
        let mut there = there();
        let made = make()?;
        // An interrupt may come when the working folder is another.
        let path = std::path::absolute(path(&made))?;
        there.insert(path.clone());
        Ok((made, Listed(path)))
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        there().remove(&self.0);
    }
}

/// Does something to temporary files, such as renaming them, that an interrupt waits for.
pub fn uninterrupted<T>(work: impl FnOnce() -> T) -> T {
    let _there = there();
    work()
}

/// Removes all that is listed and ends the program; from now on nobody lists more.
pub fn remove_and_exit(code: i32) -> ! {
    let there = there();
    for path in there.iter() {
        if path.is_dir() {
            (0..ATTEMPTS).take_while(|_| std::fs::remove_dir_all(path).is_err() || path.exists()).for_each(drop);
        } else {
            // If it cannot be removed, there is nobody left who could.
            let _ = std::fs::remove_file(path);
        }
    }
    std::process::exit(code)
}
