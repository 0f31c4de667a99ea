//! Files that a run reads and files that it writes: no output takes the place of anything that is read, or of another output, whatever either is
//! called.
//!
//! A path is not compared by its name but by what it is. Where something exists, that is the file itself (device and inode; where a system
//! has none, the path with all links followed), so that `./a`, links of both kinds and another case on a file system that ignores it are all `a`.
//! Where nothing exists yet, it is the folder (as above) and the name in it.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use super::JobOptions;
use super::pending::parent;
use crate::error::{Error, Result};
use crate::input::Gathered;

/// A file or folder that exists.
#[cfg(unix)]
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Found {
    device: u64,
    inode: u64,
}
#[cfg(not(unix))]
type Found = PathBuf;

/// Identity of what stands at a path, links followed.
#[cfg(unix)]
fn found(path: &Path) -> Option<Found> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|m| Found { device: m.dev(), inode: m.ino() })
}

#[cfg(not(unix))]
fn found(path: &Path) -> Option<Found> {
    path.canonicalize().ok()
}

/// Links one behind the other, of which systems follow as many.
const MOST_LINKS: usize = 40;
/// Outputs of a run that are locked.
const MOST_LOCKS: usize = 64;

/// The place that is written where `target` is: that of a link, or of a link that it leads to, is where the last of them leads, be there anything or not.
///
/// # Errors
/// Words about links that lead to no end.
fn behind_links(target: &Path) -> io::Result<PathBuf> {
    let mut place = target.to_path_buf();
    for _ in 0..MOST_LINKS {
        match fs::read_link(&place) {
            Ok(to) => place = parent(&place).join(to),
            Err(_) => return Ok(place),
        }
    }
    Err(io::Error::other(format!("is a link, the first of more than {MOST_LINKS} or of a circle")))
}

/// The same for an output, where the system lets a link be followed: not one that somebody else has laid into a folder that all may write.
///
/// # Errors
/// [`Error::Output`].
pub(super) fn place_of(target: &Path) -> Result<PathBuf> {
    let fail = |e: io::Error| Error::Output { path: target.into(), message: e.to_string() };
    let place = behind_links(target).map_err(fail)?;
    match fs::metadata(target) {
        Err(e) if place != target && e.kind() == io::ErrorKind::PermissionDenied => {
            let message = format!("is a link to {}, which is not followed: {e}", place.display());
            Err(Error::Output { path: target.into(), message })
        }
        _ => Ok(place),
    }
}

/// A name in a folder: the last folder that exists, and what follows.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Entry {
    folder: Option<Found>,
    name: PathBuf,
}

impl Entry {
    fn of(path: &Path) -> Self {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let (mut folder, mut name) = (None, path.clone());
        for above in path.ancestors().skip(1) {
            folder = found(above);
            if folder.is_some() {
                name = path.strip_prefix(above).unwrap_or(&path).into();
                break;
            }
        }
        // Folders that are still to be made are no links.
        let name = name.components().fold(PathBuf::new(), |mut plain, part| {
            match part {
                Component::ParentDir => drop(plain.pop()),
                Component::CurDir => {}
                part => plain.push(part),
            }
            plain
        });
        Entry { folder, name }
    }

    /// Path in lower case: the same for all ways to write its name in upper and lower case.
    fn folded(&self) -> Self {
        Entry { folder: self.folder.clone(), name: self.name.to_string_lossy().to_lowercase().into() }
    }
}

/// Places that a run reads and writes. Each has a name for messages, such as "the input a.nrrd".
#[derive(Debug, Default)]
pub struct Places {
    reads: HashMap<Found, String>,
    /// Names of what is read, and folders it is in.
    read_as: HashMap<Entry, String>,
    around_reads: HashMap<Found, String>,
    /// Outputs by their names without case, and as they were written.
    writes: HashMap<Entry, Vec<(PathBuf, String)>>,
    /// Folders outputs will be in.
    around_writes: HashMap<Entry, String>,
    /// Folders all of whose files of a kind are an input, and their names.
    gathered: Vec<(Gathered, Found, PathBuf)>,
    /// Locks of outputs that were asked for.
    locks: usize,
}

impl Places {
    /// Places that a reconstruction reads: its input's files, the links file and the settings file.
    ///
    /// # Errors
    /// The errors of [`JobOptions::files`].
    pub fn of(input: &Path, options: &JobOptions) -> Result<Self> {
        let mut places = Self::reading(options.files(input)?.iter().chain(&options.settings_file));
        places.gathers(input);
        Ok(places)
    }

    /// Adds an input that outputs must not join where it is a folder all of whose files of a kind are read.
    pub fn gathers(&mut self, input: &Path) {
        self.gathered.extend(Gathered::of(input).and_then(|kind| Some((kind, found(input)?, input.into()))));
    }

    /// Whether another output may be locked: of a great many the first say which run they are of, and files that are open at a time are few.
    pub(super) fn has_lock(&mut self) -> bool {
        self.locks += 1;
        self.locks <= MOST_LOCKS
    }

    /// Places that a run over these files reads.
    pub fn reading(files: impl IntoIterator<Item = impl AsRef<Path>>) -> Self {
        let mut places = Places::default();
        for file in files {
            let file = file.as_ref();
            places.read(file, &format!("the input {}", file.display()));
        }
        places
    }

    /// Adds a file that is read.
    pub fn read(&mut self, path: &Path, what: &str) {
        self.read_as.entry(Entry::of(path)).or_insert_with(|| what.into());
        if let Some(found) = found(path) {
            self.reads.entry(found).or_insert_with(|| what.into());
        }
        // The folders of the file itself, and of a link to it.
        for place in [path.canonicalize(), std::path::absolute(path)].into_iter().flatten() {
            for folder in place.ancestors().skip(1).filter_map(found) {
                if self.around_reads.contains_key(&folder) {
                    break;
                }
                self.around_reads.insert(folder, what.into());
            }
        }
    }

    /// Adds an output.
    ///
    /// # Errors
    /// Name of the place that it would take.
    pub fn write(&mut self, path: &Path, what: &str) -> std::result::Result<(), String> {
        let place = behind_links(path).unwrap_or_else(|_| path.into());
        let path = place.as_path();
        let (entry, found) = (Entry::of(path), found(path));
        let is = found.as_ref().and_then(|found| self.reads.get(found)).or_else(|| self.read_as.get(&entry));
        if let Some(read) = is {
            return Err(read.clone());
        }
        if let Some(read) = found.as_ref().filter(|_| path.is_dir()).and_then(|found| self.around_reads.get(found)) {
            return Err(format!("a folder with {read}"));
        }
        let same_but_for_case = self.writes.get(&entry.folded());
        if let Some((_, other)) = same_but_for_case.and_then(|others| others.iter().find(|(o, _)| is_one(o, path))) {
            return Err(other.clone());
        }
        if let Some(other) = self.around_writes.get(&entry) {
            return Err(format!("a folder with {other}"));
        }
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let above: Vec<Entry> = path.ancestors().skip(1).map(Entry::of).collect();
        let within = above.iter().filter_map(|folder| self.writes.get(&folder.folded())).flatten();
        if let Some((_, other)) = within.into_iter().find(|(other, _)| above.contains(&Entry::of(other))) {
            return Err(format!("in {other}"));
        }
        self.around_writes.extend(above.into_iter().map(|folder| (folder, what.into())));
        self.writes.entry(entry.folded()).or_default().push((path, what.into()));
        Ok(())
    }

    /// Adds an output of a run.
    ///
    /// # Errors
    /// [`Error::Output`] with what it would take the place of, or join: the next run of the same input would read it.
    pub(super) fn claim(&mut self, target: &Path) -> Result<()> {
        let said = |what: String| {
            let message = match what.strip_prefix("the output ") {
                Some(other) if Path::new(other) == target => "is named twice".into(),
                Some(other) => format!("is named twice: it is {other}"),
                None => format!("is {what}; give the output a name of its own"),
            };
            Error::Output { path: target.into(), message }
        };
        self.write(target, &format!("the output {}", target.display())).map_err(said)?;
        match self.joins(target) {
            Some(message) => Err(Error::Output { path: target.into(), message }),
            None => Ok(()),
        }
    }

    /// Words where the next run of an input would read an output with it, under its own name or that of what it leads to.
    pub fn joins(&self, target: &Path) -> Option<String> {
        let place = behind_links(target).unwrap_or_else(|_| target.into());
        let is_in = |path: &Path, (kind, folder, _): &(Gathered, Found, PathBuf)| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            kind.takes(&name) && found(parent(path)).as_ref() == Some(folder)
        };
        let (kind, _, input) = self.gathered.iter().find(|of| is_in(target, of) || is_in(&place, of))?;
        let one = kind.one();
        Some(format!(
            "the next run would read it as {one} of the input {}; write it to another folder",
            input.display()
        ))
    }
}

/// Whether two paths whose names differ in case at most, in one folder, are one file.
fn is_one(a: &Path, b: &Path) -> bool {
    if Entry::of(a) == Entry::of(b) {
        return true;
    }
    match (found(a), found(b)) {
        (Some(a), Some(b)) => a == b,
        (None, None) => a.parent().is_some_and(ignores_case),
        _ => false,
    }
}

/// Whether a folder has one file for all ways to write a name in upper and lower case, as far as what is in it tells.
fn ignores_case(folder: &Path) -> bool {
    let turned = |name: &OsStr| {
        let name = name.to_str()?;
        let turn = |c: char| if c.is_lowercase() { c.to_ascii_uppercase() } else { c.to_ascii_lowercase() };
        Some(name.chars().map(turn).collect::<String>()).filter(|turned| turned != name)
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut told = entries.filter_map(|entry| Some((found(&entry.path())?, turned(&entry.file_name())?)));
    told.next().is_some_and(|(file, turned)| found(&folder.join(turned)) == Some(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_tells_whether_it_ignores_case() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let at = |name: &str| place.path().join(name);
        let twice = |places: &mut Places| {
            places.write(&at("x.nrrd"), "x").expect("it is the first");
            places.write(&at("X.nrrd"), "X")
        };
        assert_eq!(twice(&mut Places::default()), Ok(()), "an empty folder tells nothing");
        fs::write(at("aB1"), "").expect("a file can be written");
        if !at("Ab1").exists() {
            assert_eq!(twice(&mut Places::default()), Ok(()), "another name is another file");
            // As a file system that ignores case would answer.
            fs::hard_link(at("aB1"), at("Ab1")).expect("a link can be made");
        }
        assert_eq!(twice(&mut Places::default()), Err("x".into()));
    }

    #[test]
    fn outputs_keep_out_of_each_other() {
        let place = tempfile::tempdir().expect("a folder can be made");
        let at = |name: &str| place.path().join(name);
        fs::create_dir_all(at("a.zarr/0")).expect("a folder can be made");
        for [first, second] in
            [["a.zarr", "a.zarr/0/b.nrrd"], ["a.zarr/0/b.nrrd", "a.zarr"], ["c/d.nrrd", "c/e/../d.nrrd"]]
        {
            let mut places = Places::default();
            places.write(&at(first), "first").expect("it is the first");
            assert!(places.write(&at(second), "second").is_err(), "{first}, {second}");
            places.write(&at("c/other.nrrd"), "third").expect("it is by itself");
        }
        let mut places = Places::default();
        places.read(&at("a.zarr/0/c/0"), "read");
        assert_eq!(places.write(&at("a.zarr"), "over it"), Err("a folder with read".into()));
        places.write(&at("a.zarr/0/c.nrrd"), "beside it").expect("it is another file");
    }
}
