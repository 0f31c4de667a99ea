//! Locks of the places that a run writes to: two runs that write there at the same time would leave a part of what each has made.
//!
//! They are locks of the operating system on empty files beside the places, gone with their process; where a file system has none nobody is locked out.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::pending::parent;
use crate::storage::temporaries::Listed;

/// Files that others have just removed before one is left alone.
const ATTEMPTS: usize = 100;

/// The lock of a place. Its file is removed when it is dropped, and when the program is interrupted.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
    path: PathBuf,
    _listed: Listed,
}

impl Lock {
    /// The lock of `place`; nothing where there are no locks.
    ///
    /// # Errors
    /// Words where another run has it.
    pub fn of(place: &Path) -> io::Result<Option<Self>> {
        // The place's own name may be as long as names can be.
        let name = blake3::hash(place.file_name().unwrap_or_default().as_encoded_bytes()).to_hex();
        let path = parent(place).join(format!(".interslice-{}.lock", &name[..32]));
        let taken = Listed::make(|| take(&path).map(|file| (file, path.clone())), |(_, path)| path);
        match taken {
            Ok(((file, path), listed)) => Ok(Some(Lock { file, path, _listed: listed })),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => Err(io::Error::other(
                "is written by another run; wait for its end, or give the output a name of its own",
            )),
            Err(_) => Ok(None),
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While it is held: what another one makes and locks then is let be.
        let _ = fs::remove_file(&self.path);
        // A child process may hold the file open, and closing it would not give the lock back.
        let _ = self.file.unlock();
    }
}

/// Makes and locks a file.
///
/// # Errors
/// [`io::ErrorKind::WouldBlock`] where another one holds it; whatever else means that there are no locks.
fn take(path: &Path) -> io::Result<File> {
    for _ in 0..ATTEMPTS {
        let mut options = OpenOptions::new();
        // A pipe or a link that somebody has laid there is not waited for, and not followed.
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK | libc::O_NOFOLLOW);
        let file = options.create(true).truncate(false).write(true).open(path)?;
        match file.try_lock() {
            Ok(()) if is_at(&file, path)? => return Ok(file),
            // Who had it has removed it: what is there now is another one.
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(io::ErrorKind::WouldBlock.into()),
            Err(TryLockError::Error(e)) => {
                let _ = fs::remove_file(path);
                return Err(e);
            }
        }
    }
    Err(io::ErrorKind::TimedOut.into())
}

/// Whether a file is the one at a path.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let own = file.metadata()?;
    Ok(fs::metadata(path).is_ok_and(|there| (there.dev(), there.ino()) == (own.dev(), own.ino())))
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> io::Result<bool> {
    Ok(path.exists())
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn one_has_it_at_a_time_and_nothing_is_left() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let target = place.path().join("a.nrrd");
        let held = Lock::of(&target).expect("nobody has it").expect("there are locks");
        let other = Lock::of(&target).expect_err("one has it").to_string();
        assert!(other.starts_with("is written by another run; "), "{other}");
        let beside = Lock::of(&place.path().join("b.nrrd")).expect("it is another place");
        drop(held);
        let again = Lock::of(&target).expect("it was given back");
        drop((again, beside));
        assert_eq!(fs::read_dir(place.path()).expect("it is there").count(), 0);
        // What a killed run has left locks nobody out.
        let name = Lock::of(&target).expect("nobody has it").expect("there are locks").path.clone();
        fs::write(&name, "").expect("room");
        drop(Lock::of(&target).expect("nobody has it"));
        assert!(!name.exists());
    }

    #[test]
    fn two_never_have_it_however_they_come_and_go() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let target = place.path().join("a.nrrd");
        let [holders, taken] = [AtomicUsize::new(0), AtomicUsize::new(0)];
        let come_and_go = || {
            for _ in 0..2000 {
                if let Ok(Some(_lock)) = Lock::of(&target) {
                    assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0, "another one has it");
                    taken.fetch_add(1, Ordering::SeqCst);
                    holders.fetch_sub(1, Ordering::SeqCst);
                }
            }
        };
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(come_and_go))));
        assert!(taken.load(Ordering::SeqCst) > 100, "{taken:?}");
    }
}
