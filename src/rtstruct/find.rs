//! The structure sets of a folder of DICOM files, as an archive exports a study: images and, among them, one structure set or several. What this program
//! has completed may lie beside the one that it was made of, which stays the one that is meant.

use std::path::{Path, PathBuf};

use dicom_dictionary_std::uids;

use super::StructureSet;
use super::complete::is_own;
use super::guard;
use super::parse::{self, Identity};
use crate::error::{Error, Result};
use crate::storage::folders::files_below;
use crate::storage::regular;

/// Bytes at a file's begin among which its SOP Class UID is found.
const BEGIN: u64 = 1 << 14;

/// A structure set in a folder.
struct Found {
    path: PathBuf,
    identity: Identity,
}

impl Found {
    /// Whether a UID, or a number that is unlike a UID, is its own.
    fn is(&self, wanted: &str) -> bool {
        let Identity { series, instance, number, .. } = &self.identity;
        [series, instance].into_iter().any(|uid| uid == wanted) || number.is_some_and(|n| wanted.parse() == Ok(n))
    }

    /// Line of a list.
    fn told(&self) -> String {
        let Identity { series, instance, number, label, .. } = &self.identity;
        let number = number.map_or(String::new(), |n| format!("number {n}, "));
        let label = if label.is_empty() { String::new() } else { format!("`{label}`, ") };
        format!("{series} ({number}{label}instance {instance}, {})", self.path.display())
    }

    /// Whether this program has made it of one of `all`.
    fn is_made_of(&self, all: &[Found]) -> bool {
        let Identity { instance, predecessor, .. } = &self.identity;
        let old =
            |one: &Found| predecessor.as_ref() == Some(&one.identity.instance) && one.identity.instance != *instance;
        is_own(instance) && all.iter().any(old)
    }
}

/// Structure sets of a folder: those that are meant by `series`, or all, and what this program has made of them, of which one is meant by its own UIDs alone.
struct Sets {
    all: Vec<Found>,
    /// Places of those that are meant.
    meant: Vec<usize>,
    /// Places of those that would be, were they not made of others there.
    made: Vec<usize>,
}

impl Sets {
    /// # Errors
    /// The errors of [`structure_sets`]; [`Error::Read`], [`Error::Format`].
    fn of(folder: &Path, series: Option<&str>) -> Result<Self> {
        let mut all = Vec::new();
        for file in structure_sets(folder)? {
            let bytes = regular::read(&file).map_err(|source| Error::Read { path: file.clone(), source })?;
            let identity = parse::identity(&bytes).map_err(|message| Error::Format { path: file.clone(), message })?;
            all.push(Found { path: file, identity });
        }
        let wanted = (0..all.len()).filter(|&k| series.is_none_or(|wanted| all[k].is(wanted.trim())));
        let (made, meant): (Vec<usize>, Vec<usize>) = wanted.partition(|&k| all[k].is_made_of(&all));
        let [meant, made] = if meant.is_empty() { [made, meant] } else { [meant, made] };
        Ok(Sets { all, meant, made })
    }
}

/// Files of a folder that decide what is read of it where `series` is named: all of its structure sets but those that this program has made of others there.
///
/// # Errors
/// The errors of [`StructureSet::choose_file`], but for a choice among several.
pub fn read_of(folder: &Path, series: Option<&str>) -> Result<Vec<PathBuf>> {
    let Sets { all, meant, .. } = Sets::of(folder, series)?;
    let is_read = |k: &usize| meant.contains(k) || !all[*k].is_made_of(&all);
    Ok((0..all.len()).filter(is_read).map(|k| all[k].path.clone()).collect())
}

/// Structure sets of a folder and the folders below, sorted by name.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] where there is none.
pub fn structure_sets(folder: &Path) -> Result<Vec<PathBuf>> {
    let files = files_below(folder).map_err(|source| Error::Read { path: folder.into(), source })?;
    let (mut sets, mut others, mut segmentations) = (Vec::new(), 0, 0);
    for path in files {
        match class(&path) {
            Some(class) if class == uids::RT_STRUCTURE_SET_STORAGE => sets.push(path),
            Some(class) => {
                others += 1;
                segmentations += usize::from(parse::is_segmentation(&class));
            }
            None => {}
        }
    }
    if sets.is_empty() {
        let instead = if segmentations > 0 { format!("; there is {}", parse::SEGMENTATION) } else { String::new() };
        let message = format!("has {others} DICOM files, but no RTSTRUCT among them{instead}");
        return Err(Error::Format { path: folder.into(), message });
    }
    Ok(sets)
}

/// SOP Class UID of a DICOM file; nothing of any other, and of what cannot be read.
fn class(path: &Path) -> Option<String> {
    let bytes = regular::begin(path, BEGIN).ok()?;
    guard::class(&bytes)
}

impl StructureSet {
    /// Reads an RTSTRUCT, or the one in a folder that `series` names by the UID of its series or of itself, or by its series' number.
    ///
    /// # Errors
    /// The errors of [`StructureSet::read`] and [`structure_sets`]; [`Error::Setting`] where none or several are meant.
    pub fn choose_file(path: &Path, series: Option<&str>) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "series".into(), message });
        if !path.is_dir() {
            return match series {
                None => Self::read(path),
                Some(_) => fail("is not for a single file; it chooses in a folder of DICOM files".into()),
            };
        }
        let Sets { all, meant, made } = Sets::of(path, series)?;
        let listed: String = all.iter().map(|one| format!("\n  {}", one.told())).collect();
        match (&meant[..], series.map(str::trim)) {
            ([one], _) => {
                let mut set = Self::read(&all[*one].path)?;
                let told = |k: &usize| {
                    let Found { path, identity } = &all[*k];
                    format!(
                        "{} is not read: interslice has made it of {}; --series {} takes it",
                        path.display(),
                        set.path.display(),
                        identity.instance
                    )
                };
                let told: Vec<String> = made.iter().map(told).collect();
                set.left_out.extend(told);
                Ok(set)
            }
            (_, None) => fail(format!("is needed: {} has {} RTSTRUCTs:{listed}", path.display(), all.len())),
            ([], Some(wanted)) => {
                fail(format!("must name an RTSTRUCT of {}; got {wanted}, there are:{listed}", path.display()))
            }
            (_, Some(wanted)) => {
                fail(format!("{wanted} stands for several RTSTRUCTs; name one by its instance:{listed}"))
            }
        }
    }
}
