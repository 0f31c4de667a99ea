//! The front door for files: which reader a path gets.

use std::path::{Path, PathBuf};

use super::options::ReadOptions;
use super::volume::survey::Survey;
use super::volume::{Volume, axis, slices};
use super::{ContourStack, folder, mha, nifti, npy, nrrd, pages};
use crate::error::{Error, Result};

/// Names of volumes.
pub const VOLUMES: &str = ".nrrd, .nii, .nii.gz, .mha, .mhd, .tif or .npy";

/// What an input is, by its name.
enum Kind {
    /// A folder of slices, or its stack.json.
    Folder,
    /// A label volume and the reader of its header.
    Volume(fn(&Path) -> Result<Volume>),
}

impl Kind {
    fn of(path: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        if metadata.is_dir() || name.ends_with(".json") {
            return Ok(Kind::Folder);
        }
        let extension = name.strip_suffix(".gz").filter(|n| n.ends_with(".nii")).unwrap_or(&name).rsplit_once('.');
        match extension.map(|(_, extension)| extension) {
            Some("nrrd" | "nhdr") => Ok(Kind::Volume(nrrd::read)),
            Some("nii") => Ok(Kind::Volume(nifti::read)),
            Some("mha" | "mhd") => Ok(Kind::Volume(mha::read)),
            Some("tif" | "tiff") => Ok(Kind::Volume(pages::read)),
            Some("npy") => Ok(Kind::Volume(npy::read)),
            _ => {
                let message = format!("not a known input: expected a folder with stack.json, {VOLUMES}");
                Err(Error::Format { path: path.into(), message })
            }
        }
    }

    /// The kind, if the options are for it.
    fn for_options(path: &Path, options: &ReadOptions) -> Result<Self> {
        let kind = Kind::of(path)?;
        let chooses = "a folder of slices; it chooses from a label volume";
        let folder = matches!(kind, Kind::Folder);
        let wrong = [
            (folder && options.label.is_some(), "label", chooses),
            (folder && options.keep.is_some(), "keep", chooses),
            (folder && options.slices.is_some(), "slices", chooses),
            (folder && options.axis != axis::Axis::Auto, "axis", chooses),
            (folder && options.spacing.is_some(), "spacing", "a folder of slices; stack.json has its own"),
            (!folder && options.level.is_some(), "level", "label volumes; it cuts grey slices"),
            (options.keep.is_some() && options.slices.is_some(), "keep", "a volume whose `slices` are named"),
        ];
        match wrong.into_iter().find(|(wrong, ..)| *wrong) {
            Some((_, option, what)) => {
                Err(Error::Setting { name: option.into(), message: format!("is not for {what}") })
            }
            None => Ok(kind),
        }
    }
}

/// Checks that an input is there, and that the options are for its kind; its content is not looked at.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`] or [`Error::Setting`].
pub fn check(path: &Path, options: &ReadOptions) -> Result<()> {
    Kind::for_options(path, options).map(drop)
}

/// The files whose content makes up an input.
///
/// # Errors
/// [`Error::Read`] or [`Error::Format`].
pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
    match Kind::of(path)? {
        Kind::Folder => folder::files(path),
        Kind::Volume(header) => Ok(header(path)?.files()),
    }
}

/// The labels of a label volume, and which of its slices have any.
///
/// # Errors
/// As [`read`]; [`Error::Format`] for a folder of slices.
pub fn survey(path: &Path) -> Result<Survey> {
    match Kind::of(path)? {
        Kind::Folder => Err(Error::Format { path: path.into(), message: "is not a label volume".into() }),
        Kind::Volume(header) => Survey::of(&header(path)?, None),
    }
}

/// A label volume as it was read.
#[derive(Debug, Clone)]
pub struct Surveyed {
    /// The volume.
    pub volume: Volume,
    /// What is in it.
    pub survey: Survey,
    /// Across which axis it was cut.
    pub axis: axis::Choice,
}

/// Reads a stack, and says what was found if it is a volume.
///
/// # Errors
/// As [`read`].
pub fn read_surveyed(path: &Path, options: &ReadOptions) -> Result<(ContourStack, Option<Surveyed>)> {
    let (stack, surveyed) = match Kind::for_options(path, options)? {
        Kind::Folder => (folder::read(path, options.level)?, None),
        Kind::Volume(header) => {
            let mut volume = header(path)?;
            if let Some(sides) = &options.spacing {
                volume = volume.with_spacing(sides)?;
            }
            let survey = Survey::of(&volume, options.label)?;
            let axis = axis::choose(options.axis, &volume.grid, &survey);
            let stack = slices::stack(&volume, &survey, &axis, options)?;
            (stack, Some(Surveyed { volume, survey, axis }))
        }
    };
    stack.validate()?;
    Ok((stack, surveyed))
}

/// Reads a stack: a folder with `stack.json` (or that file itself), or a label volume.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`], [`Error::Slice`], [`Error::Stack`] or [`Error::Setting`], naming file, slice and value.
pub fn read(path: &Path, options: &ReadOptions) -> Result<ContourStack> {
    read_surveyed(path, options).map(|(stack, _)| stack)
}
