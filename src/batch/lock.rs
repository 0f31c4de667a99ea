//! Locks between processes: one per job, one per batch.
//!
//! They are locks of the operating system on files of a folder, so that those of a dead process are gone with it and none is ever stale. On a
//! network file system they hold between machines where its server passes locks on (NFS 4 does; a machine that died keeps its locks until the
//! server's lease ends, some 90 s); a file system without locks is refused.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Extension of the lock files of jobs.
const JOB: &str = "job";

/// The locks of a batch. As long as it lives, the batch is in use.
#[derive(Debug)]
pub struct Locks {
    folder: PathBuf,
    in_use: File,
}

/// A lock that is held until it is dropped.
#[derive(Debug)]
pub struct Held(#[expect(dead_code, reason = "closing it gives the lock back")] File);

impl Locks {
    /// The locks in `folder`, which is made where it is not there.
    ///
    /// # Errors
    /// [`Error::Output`] where the folder cannot be written or files there cannot be locked.
    pub fn open(folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| failure(folder, &e))?;
        let path = folder.join("batch");
        let in_use = lock_file(&path)?;
        in_use.lock_shared().map_err(|e| failure(&path, &e))?;
        Ok(Locks { folder: folder.into(), in_use })
    }

    /// The lock of a job, or nothing where somebody else has it.
    ///
    /// # Errors
    /// The errors of [`Locks::open`].
    pub fn job(&self, id: &str) -> Result<Option<Held>> {
        let name = &blake3::hash(id.as_bytes()).to_hex()[..32];
        let path = self.folder.join(name).with_extension(JOB);
        let file = lock_file(&path)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Held(file))),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(e)) => Err(failure(&path, &e)),
        }
    }

    /// The lock of the results, waited for.
    ///
    /// # Errors
    /// The errors of [`Locks::open`].
    pub fn results(&self) -> Result<Held> {
        let path = self.folder.join("results");
        let file = lock_file(&path)?;
        file.lock().map_err(|e| failure(&path, &e))?;
        Ok(Held(file))
    }
}

impl Drop for Locks {
    /// The last to leave takes the lock files of the jobs away. Nobody can hold one of them: whoever comes waits for `batch` first.
    fn drop(&mut self) {
        let _ = self.in_use.unlock();
        if self.in_use.try_lock().is_err() {
            return;
        }
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            if entry.path().extension().is_some_and(|e| e == JOB) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

fn lock_file(path: &Path) -> Result<File> {
    OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(|e| failure(path, &e))
}

fn failure(path: &Path, e: &std::io::Error) -> Error {
    Error::Output { path: path.into(), message: format!("no lock there: {e}") }
}
