//! An output under its temporary name: a file, or for a format of many files a folder. It lies beside the place that it takes, which is behind all links.

use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use tempfile::{Builder, NamedTempFile, TempDir};

use super::format::check_place;
use super::lock::Lock;
use super::places::{Places, place_of};
use crate::error::{Error, Result};
use crate::storage::folders::files_below;
use crate::storage::temporaries::{Listed, uninterrupted};

/// What names of temporary files end with.
const SUFFIX: &str = ".tmp";

/// Names of temporary files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Temporary {
    /// Never two alike: any number of runs may write to one folder, but to each place one at a time, which removes what a killed one has left.
    Random,
    /// Never two alike, of runs that may write to one place at a time: it is theirs who end last.
    Shared,
    /// Same name every time, so that what a killed run has left is written over. For a caller that lets no other of its kind make this output.
    Fixed,
}

/// Gone with its content when dropped before it is renamed, and when the program is interrupted.
#[derive(Debug)]
pub struct Pending {
    /// Where it will be.
    place: PathBuf,
    /// What there is of it.
    pub(super) made: Made,
    /// Keeps other runs from its place.
    _lock: Option<Lock>,
}

/// A temporary file or folder.
#[derive(Debug)]
pub(super) enum Made {
    /// A file.
    File(NamedTempFile, Listed),
    /// A folder.
    Folder(TempDir, Listed),
}

impl Pending {
    /// Opens the temporary file or folder of `target`, which becomes one of the `places` that the run writes to.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written, or is that of something else.
    pub fn open(target: &Path, is_folder: bool, temporary: Temporary, places: &mut Places) -> Result<Self> {
        places.claim(target)?;
        let fail = |e: io::Error| Error::Output { path: target.into(), message: e.to_string() };
        let place = place_of(target)?;
        check_place(target, &place, is_folder)?;
        let folder = parent(&place);
        let message = |e: io::Error| match folder.is_dir() {
            true => format!("in folder {}: {e}", folder.display()),
            false => format!("there is no folder {}", folder.display()),
        };
        let locked = temporary != Temporary::Shared && places.has_lock();
        let lock = if locked { Lock::of(&place).map_err(fail)? } else { None };
        let made = Made::beside(&place, is_folder, temporary, lock.is_some());
        let made = made.map_err(|e| Error::Output { path: target.into(), message: message(e) })?;
        Ok(Pending { place, made, _lock: lock })
    }

    /// Writes a value as JSON for people, and a last line's end, onto the disk.
    ///
    /// # Errors
    /// The errors of writing.
    pub fn write_json(&self, value: &impl Serialize) -> io::Result<()> {
        let mut out = BufWriter::new(File::create(self.path())?);
        serde_json::to_writer_pretty(&mut out, value)?;
        out.write_all(b"\n")?;
        out.flush()?;
        self.sync()
    }

    /// Path until it is renamed.
    pub fn path(&self) -> &Path {
        match &self.made {
            Made::File(file, _) => file.path(),
            Made::Folder(folder, _) => folder.path(),
        }
    }

    /// Waits until all of it is on the disk.
    ///
    /// # Errors
    /// The errors of the disk.
    pub fn sync(&self) -> io::Result<()> {
        match &self.made {
            Made::File(file, _) => file.as_file().sync_all(),
            Made::Folder(folder, _) => {
                files_below(folder.path())?.iter().try_for_each(|path| File::open(path)?.sync_all())
            }
        }
    }

    /// Gives it its own name, in one step; a file that stood there keeps who may read and write it. Where the system cannot do that with folders, what has that
    /// name steps aside until the new one has it; it is removed then.
    ///
    /// # Errors
    /// The errors of renaming; what was there is there again.
    pub fn rename(self) -> io::Result<()> {
        let place = &self.place;
        match self.made {
            Made::File(file, _listed) => {
                keep_mode(file.as_file(), place)?;
                uninterrupted(|| file.persist(place)).map(drop).map_err(|e| e.error)
            }
            Made::Folder(folder, _listed) => uninterrupted(|| Made::rename_folder(folder, place)),
        }
    }
}

impl Made {
    /// Makes it beside the place that it will take, and removes what a killed run has left. Where the place is `locked` no other run writes there.
    fn beside(target: &Path, is_folder: bool, temporary: Temporary, locked: bool) -> io::Result<Self> {
        let place = parent(target);
        let mut builder = Builder::new();
        builder.prefix(".interslice-").suffix(SUFFIX);
        // The target's own name may be as long as names can be.
        let name = blake3::hash(target.file_name().unwrap_or_default().as_encoded_bytes()).to_hex();
        let own = format!(".interslice-{}", &name[..32]);
        let of_locked = format!("{own}-");
        match temporary {
            Temporary::Fixed => {
                builder.prefix(&own).rand_bytes(0);
                remove(&place.join(format!("{own}{SUFFIX}")))?;
            }
            Temporary::Random if locked => {
                builder.prefix(&of_locked);
                left_behind(place, &of_locked).iter().for_each(|path| drop(remove(path)));
            }
            Temporary::Random | Temporary::Shared => {}
        }
        if is_folder {
            set_mode(&mut builder, 0o777);
            let (folder, listed) = Listed::make(|| builder.tempdir_in(place), TempDir::path)?;
            Ok(Made::Folder(folder, listed))
        } else {
            set_mode(&mut builder, 0o666);
            let (file, listed) = Listed::make(|| builder.tempfile_in(place), NamedTempFile::path)?;
            Ok(Made::File(file, listed))
        }
    }

    fn rename_folder(folder: TempDir, target: &Path) -> io::Result<()> {
        let place = folder.path().to_path_buf();
        if exchange(&place, target).is_ok() {
            // What had the name has the temporary one now; if it cannot be removed, it is in nobody's way.
            let _ = folder.keep();
            let _ = remove(&place);
            return Ok(());
        }
        let aside = place.with_extension("old");
        let replaces = fs::symlink_metadata(target).is_ok();
        if replaces {
            remove(&aside)?;
            fs::rename(target, &aside)?;
        }
        if let Err(e) = fs::rename(&place, target) {
            if replaces {
                fs::rename(&aside, target)?;
            } else if exchange(&place, target).is_ok() {
                // Another run has written it just now.
                return Ok(());
            }
            return Err(e);
        }
        // Nothing has its temporary name any more.
        let _ = folder.keep();
        let _ = remove(&aside);
        Ok(())
    }
}

/// Swaps what two names stand for, in one step: at no time has neither.
///
/// # Errors
/// Fallback where one does not exist, or the system or its file system cannot.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Modes of new files and folders as any program's: less the umask.
fn set_mode(builder: &mut Builder<'_, '_>, mode: u32) {
    #[cfg(unix)]
    builder.permissions(<Permissions as std::os::unix::fs::PermissionsExt>::from_mode(mode));
    #[cfg(not(unix))]
    let _: (_, _, Option<Permissions>) = (builder, mode, None);
}

/// Gives a file the mode of the one whose place it takes.
///
/// # Errors
/// Of the system, which then keeps what was there.
fn keep_mode(file: &File, target: &Path) -> io::Result<()> {
    #[cfg(unix)]
    if let Ok(found) = fs::symlink_metadata(target)
        && found.is_file()
        && found.permissions() != file.metadata()?.permissions()
    {
        file.set_permissions(found.permissions())?;
    }
    #[cfg(not(unix))]
    let _ = (file, target);
    Ok(())
}

/// Temporary files and folders in a folder whose names begin so.
fn left_behind(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let ours = |name: &str| name.starts_with(prefix) && name.ends_with(SUFFIX);
    entries.filter(|entry| entry.file_name().to_str().is_some_and(ours)).map(|entry| entry.path()).collect()
}

/// Removes a file, or a folder and all in it, where there is one.
fn remove(path: &Path) -> io::Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) => Err(e),
    };
    match removed {
        Err(e) if e.kind() != io::ErrorKind::NotFound => {
            Err(io::Error::new(e.kind(), format!("{}: {e}", path.display())))
        }
        _ => Ok(()),
    }
}

/// The folder of a path.
pub fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_what_it_leads_to_is_written() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let at = |name: &str| place.path().join(name);
        let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, at(name)).expect("a link can be made");
        fs::create_dir(at("there")).expect("a folder can be made");
        fs::write(at("there/old.json"), "old").expect("room");
        [("there/old.json", "one"), ("one", "two"), ("there/new.json", "dangling"), ("a", "b"), ("b", "a")]
            .into_iter()
            .for_each(|(to, name)| link(to, name));
        let open = |name: &str| Pending::open(&at(name), false, Temporary::Random, &mut Places::default());
        for (name, to) in [("two", "there/old.json"), ("dangling", "there/new.json")] {
            let pending = open(name).expect("it can be made");
            pending.write_json(&1).expect("room");
            pending.rename().expect("it can be renamed");
            assert!(at(name).is_symlink() && !at(to).is_symlink(), "{name}");
            assert_eq!(fs::read_to_string(at(to)).expect("it is there"), "1\n");
        }
        assert!(at("one").is_symlink());
        let circle = open("a").expect_err("it leads nowhere").to_string();
        assert!(circle.contains("is a link, the first of more than 40 or of a circle"), "{circle}");
        // Of a link and what it leads to only one can be written.
        let mut places = Places::default();
        places.write(&at("there/other.json"), "other").expect("it is the first");
        link("there/other.json", "beside");
        assert_eq!(places.write(&at("beside"), "it"), Err("other".into()));
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_is_written_again_stays_as_private_as_it_was() {
        use std::os::unix::fs::PermissionsExt;
        let place = tempfile::tempdir().expect("a folder can be made");
        let mode = |path: &Path| fs::metadata(path).expect("it is there").permissions().mode() & 0o777;
        let write = |target: &Path| {
            let pending =
                Pending::open(target, false, Temporary::Random, &mut Places::default()).expect("it can be made");
            pending.write_json(&1).expect("room");
            pending.rename().expect("it can be renamed");
        };
        let [plain, private] = ["plain.json", "private.json"].map(|name| place.path().join(name));
        fs::write(&private, "old").expect("room");
        fs::set_permissions(&private, Permissions::from_mode(0o600)).expect("it is ours");
        [&plain, &private].into_iter().for_each(|target| write(target));
        assert_eq!((mode(&private), fs::read_to_string(&private).expect("it is there")), (0o600, "1\n".into()));
        assert_ne!(mode(&plain), 0o600, "a new file is as any program's");
    }

    #[test]
    fn what_a_killed_run_has_left_of_a_place_goes_with_the_next_run_to_it() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let at = |name: &str| place.path().join(name);
        let open = |name: &str, is_folder: bool, temporary: Temporary| {
            Pending::open(&at(name), is_folder, temporary, &mut Places::default()).expect("it can be made")
        };
        let listed = || fs::read_dir(place.path()).expect("the folder is there").count();
        for (name, is_folder) in [("a.stl", false), ("a.zarr", true)] {
            // As if it were killed: neither the file nor its lock is removed, and the lock is nobody's.
            let killed = open(name, is_folder, Temporary::Random);
            let left = killed.path().to_path_buf();
            let kept = at("kept");
            fs::rename(&left, &kept).expect("it is there");
            drop(killed);
            fs::rename(&kept, &left).expect("it is there");
            drop(open("b.stl", false, Temporary::Random));
            drop(open(name, is_folder, Temporary::Shared));
            assert!(left.exists(), "other places, and runs that write to one place, let it be");
            drop(open(name, is_folder, Temporary::Random));
            assert_eq!(listed(), 0, "{name}");
        }
        let running = open("a.stl", false, Temporary::Random);
        Pending::open(&at("a.stl"), false, Temporary::Random, &mut Places::default()).expect_err("one writes there");
        assert!(running.path().exists());
    }

    /// Many folders get one name, one after the other on two threads: whoever looks finds one that is complete.
    #[test]
    fn a_folder_is_replaced_in_one_step() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let target = place.path().join("a.zarr");
        let write = |number: usize| {
            let pending =
                Pending::open(&target, true, Temporary::Shared, &mut Places::default()).expect("it can be made");
            let own = r#"{"attributes": {"interslice": {}}}"#;
            fs::create_dir_all(pending.path().join("0/c")).expect("room");
            fs::write(pending.path().join("0/c/0"), number.to_string()).expect("room");
            fs::write(pending.path().join("zarr.json"), own).expect("room");
            pending.rename().expect("it can be renamed");
        };
        write(0);
        let stop = AtomicBool::new(false);
        let missing = std::thread::scope(|scope| {
            let looks = scope.spawn(|| {
                let mut missing = 0;
                while !stop.load(Ordering::Relaxed) {
                    missing += usize::from(!target.join("zarr.json").is_file());
                }
                missing
            });
            let writers = [1, 2].map(|first| scope.spawn(move || (0..200).for_each(|k| write(first + 2 * k))));
            writers.into_iter().for_each(|writer| writer.join().expect("all could be renamed"));
            stop.store(true, Ordering::Relaxed);
            looks.join().expect("it has looked")
        });
        if cfg!(any(target_os = "linux", target_os = "macos")) {
            assert_eq!(missing, 0, "times that there was none");
        }
        let left = fs::read_dir(place.path()).expect("the folder is there").count();
        assert_eq!(left, 1, "nothing else is left");
    }
}
