//! Files of a folder without `stack.json`: images of one slice each, and volumes. The folder is of those that are more; the others are left out, and told.

use std::cmp::Ordering;
use std::collections::BTreeMap;
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

/// Words where the names of slices, in order, have a number twice, or one is another with something behind its number: a file may be a copy.
pub(super) fn repeats(names: &[&str]) -> Option<String> {
    let numbered: Vec<Option<(String, Vec<u64>)>> = names.iter().map(|name| numbers(name)).collect();
    let same =
        |k: usize| numbered[k].as_ref().is_some_and(|(_, own)| !own.is_empty()) && numbered[k] == numbered[k + 1];
    let alike = |k: &usize| same(*k) || is_more_of(names[*k], names[k + 1]) || is_more_of(names[k + 1], names[*k]);
    let places: Vec<usize> = (0..names.len().saturating_sub(1)).filter(alike).collect();
    let &k = places.first()?;
    let more = if places.len() > 1 {
        format!(" (and so at {} more)", counted(places.len() - 1, "place"))
    } else {
        String::new()
    };
    Some(format!(
        "`{}` and `{}` have the same number{more}: both are taken as slices, one above the other; if one is a copy, move it out of the folder",
        names[k],
        names[k + 1]
    ))
}

/// Whether a name is another one, that has a number, with something behind it, as a copy's is: `s02 copy.png`, `s02 (1).png`.
fn is_more_of(name: &str, other: &str) -> bool {
    let stem = |name| Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let (name, other) = (stem(name), stem(other));
    let more = name.strip_prefix(&other).and_then(|more| more.chars().next());
    // A point, a comma or a hyphen may belong to a number.
    other.ends_with(|c: char| c.is_ascii_digit()) && more.is_some_and(|c| c.is_alphabetic() || " _(".contains(c))
}

/// Words where the numbers in the names of slices, in order, leave some out: a file may be missing.
pub(super) fn skips(names: &[&str]) -> Option<String> {
    let numbered: Vec<(String, Vec<u64>)> = names.iter().map(|name| numbers(name)).collect::<Option<_>>()?;
    let (template, first) = numbered.first()?;
    if numbered.iter().any(|(own, _)| own != template) {
        return None;
    }
    let varies = |at: &usize| numbered.iter().any(|(_, own)| own[*at] != first[*at]);
    let varying: Vec<usize> = (0..first.len()).filter(varies).collect();
    let [at] = varying[..] else { return None };
    let steps: Vec<u64> = numbered.windows(2).map(|w| w[1].1[at].saturating_sub(w[0].1[at])).collect();
    let mut often: BTreeMap<u64, usize> = BTreeMap::new();
    steps.iter().for_each(|step| *often.entry(*step).or_default() += 1);
    let usual = *often.iter().max_by_key(|(_, count)| **count)?.0;
    let longer: Vec<usize> = (0..steps.len()).filter(|&k| steps[k] > usual).collect();
    let (&k, few) = (longer.first()?, 2 * longer.len() < steps.len());
    let more =
        if longer.len() > 1 { format!(", and at {} more", counted(longer.len() - 1, "place")) } else { String::new() };
    few.then(|| {
        format!(
            "between `{}` and `{}` numbers are left out{more}: the slices are taken as equally far apart all the same; if one is missing, \
             write a stack.json with their heights",
            names[k],
            names[k + 1]
        )
    })
}

/// A name with a mark for every number in it, and these; nothing where one is too large.
fn numbers(name: &str) -> Option<(String, Vec<u64>)> {
    let (mut template, mut found) = (String::new(), Vec::new());
    let mut digits = String::new();
    for c in name.chars().map(Some).chain([None]) {
        match c {
            Some(c) if c.is_ascii_digit() => digits.push(c),
            c => {
                if !digits.is_empty() {
                    found.push(std::mem::take(&mut digits).parse().ok()?);
                    template.push('#');
                }
                template.extend(c);
            }
        }
    }
    Some((template, found))
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
fn sort_by_number(names: &mut [String]) {
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
    fn numbers_that_are_left_out_are_told() {
        for names in [
            &["s1.png", "s2.png", "s3.png"][..],
            &["v2_004.tif", "v2_008.tif", "v2_012.tif", "v2_016.tif"],
            &["z-2.5.png", "z-0.0.png", "z2.5.png"],
            &["a1.png", "b7.png", "b8.png", "b9.png"],
            &["s1.png", "s4.png", "s9.png"],
            &["s1.png"],
            &[],
            &["99999999999999999999.png", "99999999999999999999999.png"],
        ] {
            assert_eq!(skips(names), None, "{names:?}");
        }
        for names in [
            &["s1.png", "s2.png", "s10.png"][..],
            &["a1.png", "b1.png"],
            &["a.png", "b.png"],
            &["s1.png", "s1.tif"],
            &["z1.png", "z1.5.png", "z2.png", "z10.png"],
            &["mask.png", "mask copy.png"],
            &[],
        ] {
            assert_eq!(repeats(names), None, "{names:?}");
        }
        let told =
            repeats(&["m_0.png", "m_000.png", "m_1.png", "m_2.png", "m_002.png"]).expect("0 and 2 are there twice");
        assert!(told.starts_with("`m_0.png` and `m_000.png` have the same number (and so at 1 place more)"), "{told}");
        for copy in ["s2 copy.png", "s2 (1).png", "s2_old.png", "s2b.tif"] {
            let mut names = vec!["s1.png".to_string(), "s2.png".into(), copy.into(), "s3.png".into(), "s10.png".into()];
            sort_by_number(&mut names);
            let told = repeats(&names.iter().map(String::as_str).collect::<Vec<_>>()).unwrap_or_default();
            assert!(
                told.contains(copy) && told.contains("`s2.png`") && told.contains("same number:"),
                "{copy}: {told}"
            );
        }
        let told = skips(&["s1.png", "s2.png", "s4.png", "s5.png", "s6.png"]).expect("3 is missing");
        assert!(told.starts_with("between `s2.png` and `s4.png` numbers are left out: the slices"), "{told}");
        let names = ["a 0.tif", "a 5.tif", "a 15.tif", "a 20.tif", "a 25.tif", "a 30.tif", "a 40.tif", "a 45.tif"];
        let told = skips(&names).expect("10 and 35 are missing");
        assert!(
            told.starts_with("between `a 5.tif` and `a 15.tif` numbers are left out, and at 1 place more"),
            "{told}"
        );
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
