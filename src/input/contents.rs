//! Files of a folder without `stack.json`: images of one slice each, and volumes. The folder is of those that are more; the others are left out, and told.

use std::cmp::Ordering;
use std::io;
use std::path::{Path, PathBuf};

use super::format::InputFormat;
use super::tiff;
use crate::error::{Error, Result, counted};

/// Extensions of images.
const IMAGES: [&str; 3] = ["png", "tif", "tiff"];
/// Extensions of images that are not read.
const OTHER_IMAGES: [&str; 12] =
    ["jpg", "jpeg", "bmp", "gif", "webp", "tga", "jp2", "heic", "avif", "pgm", "pnm", "dcm"];
/// What such files are called.
const NOT_READ: &str = "images that are not read, save them as PNG or TIFF";
/// Files that a message names.
const NAMED: usize = 3;

/// Files of a folder, in the order in which people count.
#[derive(Debug, Default)]
pub(super) struct Contents {
    /// Images of a slice.
    images: Vec<PathBuf>,
    /// TIFF of several pages, and how many.
    stacks: Vec<(PathBuf, usize)>,
    /// Volumes of other formats.
    volumes: Vec<PathBuf>,
    /// TIFF whose pages cannot be counted: the reader of the others says why.
    unclear: Vec<PathBuf>,
    /// Images of formats that are not read.
    others: Vec<PathBuf>,
}

impl Contents {
    /// The files in `folder`.
    ///
    /// # Errors
    /// Those of reading the folder.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            files.push(entry?.path());
        }
        files.sort_by(|a, b| by_number(&a.to_string_lossy(), &b.to_string_lossy()));
        let mut contents = Contents::default();
        for path in files.into_iter().filter(|path| path.is_file()) {
            contents.add(path);
        }
        Ok(contents)
    }

    fn add(&mut self, path: PathBuf) {
        let name = name(&path);
        if name.starts_with('.') {
            return;
        }
        match InputFormat::of_name(&name).filter(|(format, _)| format.is_volume()) {
            Some((format, _)) if format.name == "tiff" => match tiff::pages(&path) {
                Some(1) => self.images.push(path),
                Some(pages) => self.stacks.push((path, pages)),
                None => self.unclear.push(path),
            },
            // The other file of a pair is read by its header.
            Some((format, _))
                if format.name == "analyze" && !name.to_ascii_lowercase().ends_with(format.extensions[0]) => {}
            Some(_) => self.volumes.push(path),
            None if has_extension(&path, &["png"]) => self.images.push(path),
            None if has_extension(&path, &OTHER_IMAGES) => self.others.push(path),
            None => {}
        }
    }

    /// Whether these are masks: volumes, and no more images beside them. One image is a picture of them.
    pub fn is_of_masks(&self) -> bool {
        let volumes = self.stacks.len() + self.volumes.len();
        match self.images.len() {
            0 => volumes + self.unclear.len() > 0,
            images => volumes > 0 && images <= volumes.max(1),
        }
    }

    /// The masks, and what a person should know of files that are none.
    pub fn masks(self) -> (Vec<PathBuf>, Vec<String>) {
        let stacks = self.stacks.into_iter().map(|(path, _)| path);
        let mut files: Vec<PathBuf> = stacks.chain(self.volumes).chain(self.unclear).collect();
        files.sort_by(|a, b| by_number(&a.to_string_lossy(), &b.to_string_lossy()));
        let of = |left: &[PathBuf], what| left_out(left, "masks", what, files.len());
        let notes = [of(&self.images, "images of one slice"), of(&self.others, NOT_READ)];
        (files, notes.into_iter().flatten().collect())
    }

    /// What a person should know of volumes, and of images that are not read, beside the slices.
    ///
    /// # Errors
    /// The name of a TIFF of several pages, how many it has, and the way out.
    pub fn beside_slices(&self) -> std::result::Result<Vec<String>, String> {
        if let Some((path, pages)) = self.stacks.first() {
            return Err(format!(
                "`{}` has {pages} pages, and {} beside it one each: a folder of slices has a page per image, and a volume is an input by itself",
                name(path),
                counted(self.images.len(), "image")
            ));
        }
        let of = |left: &[PathBuf], what| left_out(left, "slices", what, self.images.len() + self.unclear.len());
        Ok([of(&self.volumes, "volumes"), of(&self.others, NOT_READ)].into_iter().flatten().collect())
    }
}

/// Whether a file is an image that is read, by its name.
pub(super) fn is_image(path: &Path) -> bool {
    has_extension(path, &IMAGES)
}

fn has_extension(path: &Path, known: &[&str]) -> bool {
    path.extension().is_some_and(|e| known.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Words about files that are not of the kind that the folder is of.
fn left_out(files: &[PathBuf], kind: &str, what: &str, others: usize) -> Option<String> {
    let names: Vec<String> = files.iter().take(NAMED).map(|path| format!("`{}`", name(path))).collect();
    let more = files.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!files.is_empty()).then(|| {
        format!(
            "the folder is read as {kind}, of which it has {others}; left out as {what}: {}{more}",
            names.join(", ")
        )
    })
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Names of the images in a folder, in the order in which people count.
pub(super) fn images_of(folder: &Path) -> Result<Vec<String>> {
    let unreadable = |source| Error::Read { path: folder.into(), source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let image = is_image(&path);
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if image && !name.starts_with('.') {
            names.push(name);
        }
    }
    sort_by_number(&mut names);
    Ok(names)
}

/// Images of a folder that are not read: how many and of which extension, the first that there is.
pub(super) fn other_images_of(folder: &Path) -> Option<String> {
    let paths = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let extensions: Vec<String> =
        paths.filter_map(|path| Some(path.extension()?.to_string_lossy().to_ascii_lowercase())).collect();
    let of = |known: &&str| extensions.iter().filter(|e| e == known).count();
    let found = OTHER_IMAGES.iter().find(|known| of(known) > 0)?;
    Some(format!("{} .{found}", of(found)))
}

/// Stands before the digits of a negative number where a hyphen does in its name: no name of a file has it.
const NEGATIVE: char = '\0';
/// What a hyphen that is a sign may stand behind though no name has the number without one.
const BEFORE_A_SIGN: [char; 2] = ['_', '='];

/// Sorts names of one folder in the order in which people count, negative numbers first: `z-10`, `z-5`, `z0`. A hyphen before a number is a sign where
/// it begins the name or stands behind `_` or `=`, or another name has a number in its place (`z0`); else it is a hyphen (`scan-001`).
pub(super) fn sort_by_number(names: &mut [String]) {
    let signed = |name: &String| {
        let digit = |at: usize| name[at..].starts_with(|c: char| c.is_ascii_digit());
        let in_its_place = |stem: &str| {
            let number =
                |other: &String| other.strip_prefix(stem).is_some_and(|r| r.starts_with(|c: char| c.is_ascii_digit()));
            !stem.ends_with(|c: char| c.is_ascii_digit()) && names.iter().any(number)
        };
        let sign =
            |at: usize| name[..at].is_empty() || name[..at].ends_with(BEFORE_A_SIGN) || in_its_place(&name[..at]);
        match name.match_indices('-').map(|(at, _)| at).find(|&at| digit(at + 1) && sign(at)) {
            Some(at) => format!("{}{NEGATIVE}{}", &name[..at], &name[at + 1..]),
            None => name.clone(),
        }
    };
    let mut keyed: Vec<(String, String)> = names.iter().map(|name| (signed(name), name.clone())).collect();
    keyed.sort_by(|(a, _), (b, _)| by_number(a, b));
    names.iter_mut().zip(keyed).for_each(|(name, (_, sorted))| *name = sorted);
}

/// Names in the order in which people count: `s2` before `s10`.
fn by_number(a: &str, b: &str) -> Ordering {
    fn piece(text: &str) -> (&str, &str) {
        let (sign, rest) = text.split_at(usize::from(text.starts_with(NEGATIVE)));
        let digit = rest.starts_with(|c: char| c.is_ascii_digit());
        let ends = |c: char| c == NEGATIVE || c.is_ascii_digit() != digit;
        text.split_at(sign.len() + rest.find(ends).unwrap_or(rest.len()))
    }
    fn by_value(p: &str, q: &str) -> Ordering {
        let [p, q] = [p, q].map(|text| text.trim_start_matches('0'));
        p.len().cmp(&q.len()).then_with(|| p.cmp(q))
    }
    let (mut left, mut right) = (a, b);
    while !left.is_empty() && !right.is_empty() {
        let ((p, rest), (q, others)) = (piece(left), piece(right));
        let digits = |text: &str| text.starts_with(|c: char| c.is_ascii_digit());
        let order = match (p.strip_prefix(NEGATIVE), q.strip_prefix(NEGATIVE)) {
            (None, None) if digits(p) && digits(q) => by_value(p, q),
            (Some(p), Some(q)) => by_value(q, p),
            _ => p.cmp(q),
        };
        if order != Ordering::Equal {
            return order;
        }
        (left, right) = (rest, others);
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_as_people_count() {
        let mut names = ["s10.png", "s2.png", "s02.png", "s1.png", "a", "s", "10", "9"];
        names.sort_by(|a, b| by_number(a, b));
        assert_eq!(names, ["9", "10", "a", "s", "s1.png", "s02.png", "s2.png", "s10.png"]);
    }

    #[test]
    fn a_hyphen_is_a_sign_where_numbers_have_none_in_its_place() {
        let sorted = |names: &[&str]| {
            let mut names: Vec<String> = names.iter().map(ToString::to_string).collect();
            sort_by_number(&mut names);
            names
        };
        for told in [
            &["slice_-10.png", "slice_-5.png", "slice_0.png", "slice_5.png"][..],
            &["slice_-10.png", "slice_-5.png"],
            &["z-10.5.png", "z-10.25.png", "z-5.png", "z0.png"],
            &["-2.png", "-1.png", "1.png"],
            &["scan-1.png", "scan-2.png", "scan-10.png"],
            &["2020-01-05.png", "2020-01-12.png", "2020-02-01.png", "2020.png"],
            &["a-1.png", "a-2.png", "b0.png"],
            &["a -2.png", "a -1.png", "a 1.png"],
            &["a -1.png", "a -2.png"],
        ] {
            let mut shuffled = told.to_vec();
            shuffled.reverse();
            shuffled.rotate_left(1);
            assert_eq!(sorted(&shuffled), told);
        }
    }
}
