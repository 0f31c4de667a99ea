//! The formats of inputs, one row each: what the command line, templates, messages and fuzz targets know of them.

use std::path::Path;

use super::contents::Contents;
use super::volume::Volume;
use super::{masks, mha, nifti, npy, npz, nrrd, sniff, tiff};
use crate::error::{Error, Result};
use crate::storage::regular;

/// A format that is read.
#[derive(Debug, Clone, Copy)]
pub struct InputFormat {
    /// Its name, as the fuzz target's.
    pub name: &'static str,
    /// Extensions of its files, the usual one first.
    pub extensions: &'static [&'static str],
    /// Files that may lie beside one of them and hold part of it: extensions with a dot in front, or whole names.
    pub companions: &'static [&'static str],
    /// Whether its files can say how large a pixel or voxel is.
    pub sized: bool,
    /// Content.
    pub(crate) kind: Kind,
}

/// Content of an input, and its reader.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Kind {
    /// A folder of slices, or its stack.json.
    Folder,
    /// A label volume and the reader of its header.
    Volume(fn(&Path) -> Result<Volume>),
    /// A DICOM RTSTRUCT.
    StructureSet,
    /// Contour lines with elevations.
    Map,
}

/// All formats of files, in the order in which messages list them; neighbours of one kind share its words. A folder is read by its `stack.json`.
pub const FORMATS: &[InputFormat] = &[
    row("folder", &["json"], &["s.png"], Kind::Folder),
    row("nrrd", &["nrrd", "nhdr"], &["data"], Kind::Volume(nrrd::read)),
    row("nifti", &["nii", "nii.gz"], &[], Kind::Volume(nifti::read)),
    row("analyze", &["hdr", "img"], &["a.img"], Kind::Volume(nifti::read)),
    row("mha", &["mha", "mhd"], &["data"], Kind::Volume(mha::read)),
    row("tiff", &["tif", "tiff"], &[], Kind::Volume(tiff::read)),
    InputFormat { sized: false, ..row("npy", &["npy"], &[], Kind::Volume(npy::read)) },
    row("npz", &["npz"], &[], Kind::Volume(npz::read)),
    row("zarr", &["zarr"], &[], Kind::Volume(zarr)),
    row("rtstruct", &["dcm"], &[], Kind::StructureSet),
    row("geojson", &["geojson"], &[], Kind::Map),
    row("geopackage", &["gpkg"], &[], Kind::Map),
    row("shapefile", &["shp"], &[".dbf", ".prj", ".shx"], Kind::Map),
];

#[cfg(feature = "zarr")]
fn zarr(path: &Path) -> Result<Volume> {
    super::ome_zarr::read(path)
}

#[cfg(not(feature = "zarr"))]
fn zarr(path: &Path) -> Result<Volume> {
    let message = "is Zarr, which this program was built without (feature `zarr`)".into();
    Err(Error::Format { path: path.into(), message })
}

const fn row(
    name: &'static str,
    extensions: &'static [&'static str],
    companions: &'static [&'static str],
    kind: Kind,
) -> InputFormat {
    InputFormat { name, extensions, companions, sized: true, kind }
}

impl InputFormat {
    /// Whether it is a label volume.
    pub fn is_volume(&self) -> bool {
        matches!(self.kind, Kind::Volume(_))
    }

    /// The format of a file of this name, and where its extension begins, at the dot. The longest extension wins.
    pub fn of_name(name: &str) -> Option<(&'static Self, usize)> {
        let name = name.to_ascii_lowercase();
        let ends = |extension: &str| name.strip_suffix(extension)?.strip_suffix('.').map(str::len);
        let found = FORMATS.iter().flat_map(|f| f.extensions.iter().filter_map(move |e| Some((f, ends(e)?))));
        found.min_by_key(|(_, at)| *at)
    }
}

impl Kind {
    /// Kind of what is at `path`: by its content where that tells, else by its name.
    pub fn of(path: &Path) -> Result<Self> {
        let metadata = std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
        if metadata.is_dir() {
            return Ok(if path.join("stack.json").is_file() {
                Kind::Folder
            } else if sniff::is_zarr(path) {
                Kind::Volume(zarr)
            } else if sniff::has_dicom(path) {
                Kind::StructureSet
            } else if Contents::of(path).is_ok_and(|contents| contents.is_of_masks()) {
                Kind::Volume(masks::read)
            } else {
                Kind::Folder
            });
        }
        regular::check(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        // Voxels alone may begin like anything.
        if nifti::is_pair(path) && InputFormat::of_name(&name).is_some_and(|(format, _)| format.name == "analyze") {
            return Ok(Kind::Volume(nifti::read));
        }
        if let Some(format) = sniff::format(path).and_then(|name| FORMATS.iter().find(|f| f.name == name)) {
            return Ok(format.kind);
        }
        let unknown = || {
            let message = format!("not a known input: expected {}", expected());
            Error::Format { path: path.into(), message }
        };
        InputFormat::of_name(&name).map(|(format, _)| format.kind).ok_or_else(unknown)
    }

    /// Name of the kind.
    const fn words(self) -> &'static str {
        match self {
            Kind::Folder => "a folder with stack.json, of images, or of masks",
            Kind::Volume(_) => "a label volume",
            Kind::StructureSet => "a folder of DICOM files, an RTSTRUCT",
            Kind::Map => "a contour map",
        }
    }
}

/// All that is read, for messages and help: `a folder with stack.json, a label volume (.nrrd, ..), ..`.
pub fn expected() -> String {
    let mut kinds: Vec<(&str, Vec<String>)> = Vec::new();
    for format in FORMATS {
        let words = format.kind.words();
        if kinds.last().is_none_or(|(last, _)| *last != words) {
            kinds.push((words, Vec::new()));
        }
        if let (Some((_, names)), false) = (kinds.last_mut(), matches!(format.kind, Kind::Folder)) {
            names.extend(format.extensions.iter().map(|e| format!(".{e}")));
        }
    }
    let said = |(words, names): (&str, Vec<String>)| match names[..] {
        [] => words.to_string(),
        _ => format!("{words} ({})", names.join(", ")),
    };
    let said: Vec<String> = kinds.into_iter().map(said).collect();
    match said.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}

/// The help of an input's argument.
pub fn help() -> String {
    let expected = expected();
    let mut letters = expected.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
