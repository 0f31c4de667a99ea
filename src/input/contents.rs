//! Files of a folder without `stack.json`: images of one slice each, and volumes. The folder is of those that are more; the others are left out, and told.

use std::cmp::Ordering;
use std::io;
use std::path::{Path, PathBuf};

use super::format::InputFormat;
use super::tiff;
use crate::error::counted;

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
            None if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) => self.images.push(path),
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
    pub fn masks(self) -> (Vec<PathBuf>, Option<String>) {
        let stacks = self.stacks.into_iter().map(|(path, _)| path);
        let mut files: Vec<PathBuf> = stacks.chain(self.volumes).chain(self.unclear).collect();
        files.sort_by(|a, b| by_number(&a.to_string_lossy(), &b.to_string_lossy()));
        let note = left_out(&self.images, "masks", "images of one slice", files.len());
        (files, note)
    }

    /// What a person should know of volumes beside the slices.
    ///
    /// # Errors
    /// The name of a TIFF of several pages, how many it has, and the way out.
    pub fn beside_slices(&self) -> Result<Option<String>, String> {
        if let Some((path, pages)) = self.stacks.first() {
            return Err(format!(
                "`{}` has {pages} pages, and {} beside it one each: a folder of slices has a page per image, and a volume is an input by itself",
                name(path),
                counted(self.images.len(), "image")
            ));
        }
        Ok(left_out(&self.volumes, "slices", "volumes", self.images.len() + self.unclear.len()))
    }
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

/// Names in the order in which people count: `s2` before `s10`.
pub(super) fn by_number(a: &str, b: &str) -> Ordering {
    fn piece(text: &str) -> (&str, &str) {
        let digit = text.starts_with(|c: char| c.is_ascii_digit());
        let end = text.find(|c: char| c.is_ascii_digit() != digit).unwrap_or(text.len());
        text.split_at(end)
    }
    let (mut left, mut right) = (a, b);
    while !left.is_empty() && !right.is_empty() {
        let ((p, rest), (q, others)) = (piece(left), piece(right));
        let digits = |text: &str| text.starts_with(|c: char| c.is_ascii_digit());
        let order = if digits(p) && digits(q) {
            let plain = |text: &str| text.trim_start_matches('0').to_string();
            plain(p).len().cmp(&plain(q).len()).then_with(|| plain(p).cmp(&plain(q)))
        } else {
            p.cmp(q)
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
}
