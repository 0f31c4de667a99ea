//! The structure sets of a folder of DICOM files, as an archive exports a study: images and, among them, one structure set or several.

use std::path::{Path, PathBuf};

use dicom_dictionary_std::uids;

use super::StructureSet;
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
        let Identity { series, instance, number, label } = &self.identity;
        let number = number.map_or(String::new(), |n| format!("number {n}, "));
        let label = if label.is_empty() { String::new() } else { format!("`{label}`, ") };
        format!("{series} ({number}{label}instance {instance}, {})", self.path.display())
    }
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
        let mut found = Vec::new();
        for file in structure_sets(path)? {
            let bytes = regular::read(&file).map_err(|source| Error::Read { path: file.clone(), source })?;
            let identity = parse::identity(&bytes).map_err(|message| Error::Format { path: file.clone(), message })?;
            found.push(Found { path: file, identity });
        }
        let listed: String = found.iter().map(|one| format!("\n  {}", one.told())).collect();
        match series.map(str::trim) {
            None if found.len() > 1 => {
                fail(format!("is needed: {} has {} RTSTRUCTs:{listed}", path.display(), found.len()))
            }
            wanted => {
                found.retain(|one| wanted.is_none_or(|wanted| one.is(wanted)));
                match (&found[..], wanted.unwrap_or_default()) {
                    ([one], _) => Self::read(&one.path),
                    ([], wanted) => {
                        fail(format!("must name an RTSTRUCT of {}; got {wanted}, there are:{listed}", path.display()))
                    }
                    (_, wanted) => {
                        fail(format!("{wanted} stands for several RTSTRUCTs; name one by its instance:{listed}"))
                    }
                }
            }
        }
    }
}
