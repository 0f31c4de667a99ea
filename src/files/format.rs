//! What an output is, by its name, and what writing it takes of memory.

use std::path::Path;

use crate::error::{Error, Result};
use crate::stack::Geometry;
use crate::surface::content::Content;
use crate::surface::{spool, transposed};

/// What a file holds, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Nrrd,
    Nifti { gzip: bool },
    Mha,
    Stl,
    Ply,
    Obj,
    Glb,
    Png,
    Tiff,
    Report,
    Html,
    Zarr,
    Contours,
    GeoJson,
    StructureSet,
}

/// Bytes of an output's buffer.
pub(super) const BUFFER_BYTES: usize = 1 << 20;
/// Bytes per pixel of a layer: of some of its voxels, of a height map and the layer below, and of the two layers that marching cubes needs.
const PER_VOLUME_PIXEL: u64 = 1;
const PER_MAP_PIXEL: u64 = 28;
const PER_SURFACE_PIXEL: u64 = 4;
/// Of the vertices whose normals are not complete: per pixel of a layer along contours, and where the body ends flat, a vertex each.
const PER_MESH_PIXEL: u64 = 8;
const PER_LID_PIXEL: u64 = 64;
/// Of the field in which a layer's contour lines are found, and of the lines.
const PER_LINE_PIXEL: u64 = 24;
/// Bytes of the picture's samples, 2400 x 1800 with colour and depth, and of the picture.
const PICTURE_BYTES: u64 = 160 << 20;

/// Bytes of the page of a report: what it shows, as numbers and as text, twice over.
const PAGE_BYTES: u64 = 64 << 20;

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .mha, .zarr, .stl, .ply, .obj, .glb, .png (picture), .tif (height map), .contours.json, \
                     .geojson (contours), .dcm (completed RTSTRUCT), .json, .html (report)";

impl Format {
    /// Whether it is a folder of files.
    pub fn is_folder(self) -> bool {
        self == Format::Zarr
    }

    /// Whether it is a mesh whose positions are f32.
    pub fn is_single(self) -> bool {
        matches!(self, Format::Stl | Format::Glb)
    }

    pub fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if name.ends_with(".nii.gz") {
            return Ok(Format::Nifti { gzip: true });
        }
        if name.ends_with(".contours.json") {
            return Ok(Format::Contours);
        }
        match name.rsplit_once('.').map(|(_, extension)| extension) {
            Some("nrrd") => Ok(Format::Nrrd),
            Some("mha") => Ok(Format::Mha),
            Some("nii") => Ok(Format::Nifti { gzip: false }),
            Some("stl") => Ok(Format::Stl),
            Some("ply") => Ok(Format::Ply),
            Some("obj") => Ok(Format::Obj),
            Some("glb") => Ok(Format::Glb),
            Some("html" | "htm") => Ok(Format::Html),
            Some("png") => Ok(Format::Png),
            Some("tif" | "tiff") => Ok(Format::Tiff),
            Some("json") => Ok(Format::Report),
            Some("geojson") => Ok(Format::GeoJson),
            Some("dcm") if cfg!(feature = "dicom") => Ok(Format::StructureSet),
            Some("dcm") => {
                let message = "this program was built without DICOM (feature `dicom`)".into();
                Err(Error::Output { path: path.into(), message })
            }
            Some("zarr") if cfg!(feature = "zarr") => Ok(Format::Zarr),
            Some("zarr") => {
                let message = "this program was built without Zarr (feature `zarr`)".into();
                Err(Error::Output { path: path.into(), message })
            }
            _ => Err(Error::Output { path: path.into(), message: format!("unknown extension; expected {KNOWN}") }),
        }
    }
}

/// Whether `path` can be an output by its name, and no folder that must stay has it.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn check_name(path: &Path) -> Result<()> {
    check_place(path, Format::of(path)?.is_folder())
}

/// What outputs of many labels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A volume.
    Volume,
    /// A mesh.
    Mesh,
    /// A report.
    Report,
    /// A picture, a page, a height map, contours, origin or confidence: of one body.
    View,
}

/// What an output is, by its name.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn kind(path: &Path) -> Result<Kind> {
    Ok(match Format::of(path)? {
        Format::Nrrd | Format::Nifti { .. } | Format::Mha | Format::Zarr => match named_content(path) {
            Some(_) => Kind::View,
            None => Kind::Volume,
        },
        Format::Stl | Format::Ply | Format::Obj | Format::Glb => Kind::Mesh,
        Format::Report => Kind::Report,
        Format::Html | Format::Png | Format::Tiff | Format::Contours | Format::GeoJson | Format::StructureSet => {
            Kind::View
        }
    })
}

/// Whether a report of this name is a page.
pub fn is_page(path: &Path) -> bool {
    matches!(Format::of(path), Ok(Format::Html))
}

/// Where what a name says of the file's content begins: `.stl`, `.nii.gz`, `.contours.json`, `.origin.nrrd`.
pub fn extension_at(name: &str) -> usize {
    let name = name.to_ascii_lowercase();
    let double = [".nii.gz", ".contours.json"].into_iter().find(|e| name.ends_with(e));
    let at = double.map(|e| name.len() - e.len()).or_else(|| name.rfind('.')).unwrap_or(name.len());
    let content = [".origin", ".confidence"].into_iter().find(|e| name[..at].ends_with(e));
    at - content.map_or(0, str::len)
}

/// Whether nothing stands at `path` that an output, a file or a folder of Zarr, must not replace.
pub(super) fn check_place(path: &Path, is_folder: bool) -> Result<()> {
    let message = match (path.is_dir(), is_folder) {
        (true, true) if path.join("zarr.json").is_file() => return Ok(()),
        (true, true) => "is a folder, but none of Zarr, and is not replaced",
        (true, false) => "is a folder",
        (false, _) => return Ok(()),
    };
    Err(Error::Output { path: path.into(), message: message.into() })
}

/// Bytes of memory that writing `paths` needs at most while layers of `dims` pixels that lie so arrive, however many these are, and the
/// body ends flat on at most `lid` pixels.
pub fn bytes<'p>(paths: impl IntoIterator<Item = &'p Path>, dims: [usize; 2], geometry: &Geometry, lid: usize) -> u64 {
    needed(paths.into_iter().filter_map(|path| Format::of(path).ok()), dims, geometry, lid)
}

pub(super) fn needed(formats: impl Iterator<Item = Format>, dims: [usize; 2], geometry: &Geometry, lid: usize) -> u64 {
    let pixels = dims.iter().product::<usize>() as u64;
    let turned = if geometry.is_layered() { 0 } else { (transposed::BLOCK_BYTES + transposed::BUFFER_BYTES) as u64 };
    let formats: Vec<Format> = formats.collect();
    let mesh = |f: &Format| matches!(f, Format::Ply | Format::Obj | Format::Glb | Format::Png | Format::Html);
    let surface = |f: &Format| mesh(f) || matches!(f, Format::Stl | Format::Report);
    let each = formats.iter().map(|format| match format {
        Format::Nrrd | Format::Nifti { .. } | Format::Mha => PER_VOLUME_PIXEL * pixels + turned,
        Format::Tiff => PER_MAP_PIXEL * pixels,
        Format::Png => PICTURE_BYTES,
        Format::Zarr => zarr_bytes(pixels as usize),
        Format::Html => PAGE_BYTES,
        Format::Contours | Format::GeoJson | Format::StructureSet => PER_LINE_PIXEL * pixels,
        Format::Stl | Format::Ply | Format::Obj | Format::Glb | Format::Report => 0,
    });
    each.sum::<u64>()
        + if formats.iter().any(surface) { PER_SURFACE_PIXEL * pixels } else { 0 }
        + if formats.iter().any(mesh) {
            spool::IN_MEMORY as u64 + PER_MESH_PIXEL * pixels + PER_LID_PIXEL * lid as u64
        } else {
            0
        }
        + BUFFER_BYTES as u64 * formats.len() as u64
}

#[cfg(feature = "zarr")]
fn zarr_bytes(pixels: usize) -> u64 {
    crate::surface::zarr::bytes(pixels, rayon::current_num_threads())
}

#[cfg(not(feature = "zarr"))]
fn zarr_bytes(_pixels: usize) -> u64 {
    0
}

/// What a volume holds that its name says: `NAME.origin.nrrd`, `NAME.confidence.nrrd` (any volume format).
pub(super) fn named_content(target: &Path) -> Option<Content> {
    let name = target.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let parts: Vec<&str> = name.trim_end_matches(".gz").split('.').collect();
    match parts[..] {
        [_, .., "origin", _] => Some(Content::Origin),
        [_, .., "confidence", _] => Some(Content::Confidence),
        _ => None,
    }
}
