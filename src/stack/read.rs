//! The front door for files: which reader a path gets.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::volume::LabelVolume;
use super::{ContourStack, folder, nifti, nrrd};
use crate::error::{Error, Result};

/// What to read from an input.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Input")]
pub struct ReadOptions {
    /// Grey slices: the contour runs where the value crosses this level, inside is above [default: the middle of the stack's range]
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub level: Option<f64>,

    /// Label volumes: reconstruct this label only [default: all that is not zero]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub label: Option<i64>,

    /// Label volumes: use every K-th slice only [default: the slices that have the label]
    #[arg(long, value_name = "K", conflicts_with = "slices")]
    pub keep: Option<usize>,

    /// Label volumes: use these slices only, numbered from 0
    #[arg(long, value_name = "I,J,..", value_delimiter = ',')]
    pub slices: Option<Vec<usize>>,
}

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
