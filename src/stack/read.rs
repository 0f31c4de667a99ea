//! The front door for files: which reader a path gets.

use std::path::{Path, PathBuf};

use super::options::ReadOptions;
use super::volume::LabelVolume;
use super::{ContourStack, folder, nifti, nrrd};
use crate::error::{Error, Result};

/// What an input is, by its name.
enum Kind {
    /// A folder of slices, or its stack.json.
    Folder,
    /// A label volume and its reader.
    Volume(fn(&Path) -> Result<LabelVolume>),
    /// A DICOM RTSTRUCT.
    StructureSet,
    /// Contour lines with elevations.
    Map,
}

impl Kind {
    fn of(path: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        if metadata.is_dir() || name.ends_with(".json") {
            Ok(Kind::Folder)
        } else if name.ends_with(".nrrd") {
            Ok(Kind::Volume(nrrd::read))
        } else if name.ends_with(".nii") || name.ends_with(".nii.gz") {
            Ok(Kind::Volume(nifti::read))
        } else if name.ends_with(".dcm") {
            Ok(Kind::StructureSet)
        } else if name.ends_with(".geojson") || name.ends_with(".shp") {
            Ok(Kind::Map)
        } else {
            Err(Error::Format {
                path: path.into(),
                message:
                    "not a known input: expected a folder with stack.json, .nrrd, .nii, .nii.gz, .dcm (RTSTRUCT), .geojson or .shp"
                        .into(),
            })
        }
    }

    /// The kind, if the options are for it.
    fn for_options(path: &Path, options: &ReadOptions) -> Result<Self> {
        let kind = Kind::of(path)?;
        let chooses = "a folder of slices; it chooses from a label volume";
        let folder = matches!(kind, Kind::Folder);
        let volume = matches!(kind, Kind::Volume(_));
        let structures = matches!(kind, Kind::StructureSet);
        let map = matches!(kind, Kind::Map);
        let lines = "a contour map";
        let wrong = [
            (map && options.label.is_some(), "label", lines),
            (map && options.keep.is_some(), "keep", lines),
            (map && options.slices.is_some(), "slices", lines),
            (!map && options.elevation.is_some(), "elevation", "anything but contour maps"),
            (!map && options.border.is_some(), "border", "anything but contour maps"),
            (!map && options.crs.is_some(), "crs", "anything but contour maps"),
            (structures && options.label.is_some(), "label", "an RTSTRUCT; `roi` chooses there"),
            (!structures && !options.roi.is_empty(), "roi", "anything but an RTSTRUCT"),
            (volume && options.pixel.is_some(), "pixel", "volumes; it is the pixel size for polygons"),
            (folder && options.label.is_some(), "label", chooses),
            (folder && options.keep.is_some(), "keep", chooses),
            (folder && options.slices.is_some(), "slices", chooses),
            (!folder && options.level.is_some(), "level", "this input; it cuts grey slices"),
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
        #[cfg(feature = "terrain")]
        Kind::Map => Ok(crate::terrain::files(path)),
        _ => Ok(vec![path.into()]),
    }
}

/// Whether an input is an RTSTRUCT, by its name.
pub fn is_structure_set(path: &Path) -> bool {
    matches!(Kind::of(path), Ok(Kind::StructureSet))
}

/// Whether an input is a contour map, by its name.
pub fn is_map(path: &Path) -> bool {
    matches!(Kind::of(path), Ok(Kind::Map))
}

/// The labels of all voxels of a label volume.
///
/// # Errors
/// As [`read`]; [`Error::Format`] for a folder of slices.
pub fn labels(path: &Path) -> Result<Vec<i64>> {
    match Kind::of(path)? {
        Kind::Folder | Kind::StructureSet | Kind::Map => {
            Err(Error::Format { path: path.into(), message: "is not a label volume".into() })
        }
        Kind::Volume(read) => Ok(read(path)?.labels),
    }
}

/// Reads a stack: a folder with `stack.json` (or that file itself), a `.nrrd`, `.nii`, `.nii.gz` label volume, ROIs of a DICOM RTSTRUCT, or
/// the contour lines of a `.geojson` or `.shp` map.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`], [`Error::Slice`], [`Error::Stack`] or [`Error::Setting`], naming file, slice and value.
pub fn read(path: &Path, options: &ReadOptions) -> Result<ContourStack> {
    let stack = match Kind::for_options(path, options)? {
        Kind::Folder => folder::read(path, options)?,
        Kind::Volume(read) => read(path)?.into_stack(path, options)?,
        #[cfg(feature = "dicom")]
        Kind::StructureSet => crate::rtstruct::read(path, options)?,
        #[cfg(not(feature = "dicom"))]
        Kind::StructureSet => {
            let message = "is DICOM, which this program was built without (feature `dicom`)".into();
            return Err(Error::Format { path: path.into(), message });
        }
        #[cfg(feature = "terrain")]
        Kind::Map => crate::terrain::Terrain::read(path, options)?.stack,
        #[cfg(not(feature = "terrain"))]
        Kind::Map => {
            let message = "is a contour map, which this program was built without (feature `terrain`)".into();
            return Err(Error::Format { path: path.into(), message });
        }
    };
    stack.validate()?;
    Ok(stack)
}
