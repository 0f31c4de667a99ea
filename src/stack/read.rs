//! The front door for files: which reader a path gets.

use std::path::Path;

use super::options::ReadOptions;
use super::volume::LabelVolume;
use super::{ContourStack, folder, nifti, nrrd};
use crate::error::{Error, Result};

/// Reads a stack: a folder with `stack.json` (or that file itself), or a `.nrrd`, `.nii`, `.nii.gz` label volume.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`], [`Error::Slice`], [`Error::Stack`] or [`Error::Setting`], naming file, slice and value.
pub fn read(path: &Path, options: &ReadOptions) -> Result<ContourStack> {
    let metadata = std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    let volume = |read: fn(&Path) -> Result<LabelVolume>| -> Result<ContourStack> {
        if options.level.is_some() {
            return Err(not_for("level", "label volumes; it cuts grey slices"));
        }
        read(path)?.into_stack(path, options)
    };
    let stack = if metadata.is_dir() || name.ends_with(".json") {
        for (given, option) in
            [(options.label.is_some(), "label"), (options.keep.is_some(), "keep"), (options.slices.is_some(), "slices")]
        {
            if given {
                return Err(not_for(option, "a folder of slices; it chooses from a label volume"));
            }
        }
        folder::read(path, options.level)?
    } else if name.ends_with(".nrrd") {
        volume(nrrd::read)?
    } else if name.ends_with(".nii") || name.ends_with(".nii.gz") {
        volume(nifti::read)?
    } else {
        return Err(Error::Format {
            path: path.into(),
            message: "not a known input: expected a folder with stack.json, .nrrd, .nii or .nii.gz".into(),
        });
    };
    stack.validate()?;
    Ok(stack)
}

fn not_for(option: &str, why: &str) -> Error {
    Error::Setting { name: option.into(), message: format!("is not for {why}") }
}
