//! Formats of outputs: by which name each is known, and what writing it takes of memory.

use std::fs::Metadata;
use std::io::ErrorKind;
use std::path::Path;

use super::places::place_of;
use crate::error::{Error, Result};
use crate::stack::Geometry;
use crate::surface::content::Content;
use crate::surface::{marching, own_store, spool, transposed};

/// Format of a file, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Nrrd,
    Nifti { gzip: bool },
    Mha,
    Vti,
    Stl,
    Ply,
    Obj,
    ObjGroups,
    Glb,
    ThreeMf,
    Vtp,
    Png,
    Dem,
    ImageJ,
    OmeTiff,
    Npy,
    Npz,
    Segments,
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
/// Bytes of the vertices whose normals are not complete: per pixel of a layer along contours, and where the body ends flat, a vertex each.
const PER_MESH_PIXEL: u64 = 8;
const PER_LID_PIXEL: u64 = 64;
/// Bytes of a cell of a surface while it is made.
const PER_LID_CELL: u64 = 400;
/// Bytes of the field in which a layer's contour lines are found, and of the lines.
const PER_LINE_PIXEL: u64 = 24;
/// Bytes of the picture's samples, 2400 x 1800 with colour and depth, and of the picture.
const PICTURE_BYTES: u64 = 160 << 20;

/// Bytes of the page of a report: what it shows, as numbers and as text, twice over.
const PAGE_BYTES: u64 = 64 << 20;

/// Memory that writing a format takes besides its buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cost {
    /// Voxels of some of a layer, or a whole block of layers where the input's axes are not the stack's.
    Volume,
    /// Chunks.
    Chunks,
    /// The surface as it arises.
    Surface,
    /// Its vertices and triangles, in a temporary file.
    Mesh,
    /// A mesh and the picture's samples.
    Picture,
    /// A mesh and the page.
    Page,
    /// A height map.
    Map,
    /// The contour lines of a layer.
    Lines,
}

/// A format that is written: one row for all that command line, manifests, messages and the memory estimate know of it.
struct Row {
    format: Format,
    /// Extensions, the usual one first.
    extensions: &'static [&'static str],
    /// Content in words.
    holds: &'static str,
    kind: Kind,
    cost: Cost,
    /// Whether it holds places in the world as 32-bit numbers.
    single: bool,
    /// Whether it holds none.
    placeless: bool,
    /// The feature that it needs, and whether the program has it.
    feature: Option<(&'static str, bool)>,
}

impl Row {
    const fn new(
        format: Format,
        extensions: &'static [&'static str],
        holds: &'static str,
        kind: Kind,
        cost: Cost,
    ) -> Self {
        Row { format, extensions, holds, kind, cost, single: false, placeless: false, feature: None }
    }

    const fn single(self) -> Self {
        Row { single: true, ..self }
    }

    const fn placeless(self) -> Self {
        Row { placeless: true, ..self }
    }

    const fn needing(self, feature: &'static str, built: bool) -> Self {
        Row { feature: Some((feature, built)), ..self }
    }
}

/// All formats, in the order in which help lists them; neighbours with the same words share them there.
const FORMATS: &[Row] = &[
    Row::new(Format::Nrrd, &["nrrd"], "volume", Kind::Volume, Cost::Volume),
    Row::new(Format::Nifti { gzip: false }, &["nii"], "volume", Kind::Volume, Cost::Volume).single(),
    Row::new(Format::Nifti { gzip: true }, &["nii.gz"], "volume", Kind::Volume, Cost::Volume).single(),
    Row::new(Format::Mha, &["mha"], "volume", Kind::Volume, Cost::Volume),
    Row::new(Format::Zarr, &["zarr"], "volume", Kind::Volume, Cost::Chunks).needing("zarr", cfg!(feature = "zarr")),
    Row::new(Format::ImageJ, &["tif", "tiff"], "volume", Kind::Volume, Cost::Volume).placeless(),
    Row::new(Format::OmeTiff, &["ome.tif", "ome.tiff"], "volume", Kind::Volume, Cost::Volume).placeless(),
    Row::new(Format::Npy, &["npy"], "volume", Kind::Volume, Cost::Volume).placeless(),
    Row::new(Format::Npz, &["npz"], "volume", Kind::Volume, Cost::Volume),
    Row::new(Format::Vti, &["vti"], "volume", Kind::Volume, Cost::Volume),
    Row::new(Format::Segments, &["seg.nrrd"], "segments", Kind::Volume, Cost::Volume),
    Row::new(Format::Stl, &["stl"], "mesh", Kind::Mesh, Cost::Surface).single(),
    Row::new(Format::Ply, &["ply"], "mesh", Kind::Mesh, Cost::Mesh),
    Row::new(Format::Obj, &["obj"], "mesh", Kind::Mesh, Cost::Mesh),
    Row::new(Format::Glb, &["glb"], "mesh", Kind::Mesh, Cost::Mesh).single(),
    Row::new(Format::ObjGroups, &["groups.obj"], "mesh", Kind::Mesh, Cost::Mesh),
    Row::new(Format::ThreeMf, &["3mf"], "mesh", Kind::Mesh, Cost::Mesh),
    Row::new(Format::Vtp, &["vtp"], "mesh", Kind::Mesh, Cost::Mesh),
    Row::new(Format::Png, &["png"], "picture", Kind::View, Cost::Picture),
    Row::new(Format::Dem, &["dem.tif", "dem.tiff"], "height map", Kind::View, Cost::Map),
    Row::new(Format::Contours, &["contours.json"], "polygons", Kind::View, Cost::Lines),
    Row::new(Format::GeoJson, &["geojson"], "contour lines", Kind::View, Cost::Lines),
    Row::new(Format::StructureSet, &["dcm"], "the RTSTRUCT, completed", Kind::View, Cost::Lines)
        .needing("dicom", cfg!(feature = "dicom")),
    Row::new(Format::Report, &["json"], "report", Kind::Report, Cost::Surface),
    Row::new(Format::Html, &["html", "htm"], "report", Kind::View, Cost::Page),
];

/// All that is written, for messages and help: `.nrrd .nii .. (volume), ..`.
pub fn known() -> String {
    let mut kinds: Vec<(&str, Vec<String>)> = Vec::new();
    for row in FORMATS {
        let names = names(std::iter::once(row));
        match kinds.last_mut().filter(|(holds, _)| *holds == row.holds) {
            Some((_, known)) => known.extend(names),
            None => kinds.push((row.holds, names)),
        }
    }
    let kinds: Vec<String> = kinds.iter().map(|(holds, names)| format!("{} ({holds})", names.join(" "))).collect();
    kinds.join(", ")
}

/// The help of an output's option.
pub fn help() -> String {
    let origin = "NAME.origin.nrrd and NAME.confidence.nrrd (any volume format) say where voxels come from";
    format!("Output file, by extension: {}; {origin}; repeatable", known())
}

/// The help of `--simplify`.
pub fn simplify_help() -> String {
    let meshes = FORMATS.iter().filter(|row| row.kind == Kind::Mesh);
    format!(
        "Meshes ({}) with fewer triangles, closed, no farther than this from the full one (measured both ways); the whole mesh must fit in memory",
        names(meshes).join(" ")
    )
}

/// Formats of a kind that hold places in the world as 32-bit numbers, or those that hold 64 bits: `.nrrd, .mha and .zarr`.
pub(super) fn places(kind: Kind, single: bool) -> String {
    let built = |row: &&Row| row.feature.is_none_or(|(_, built)| built);
    let alike = |row: &&Row| row.kind == kind && row.single == single && !row.placeless;
    let names = names(FORMATS.iter().filter(built).filter(alike));
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => names.concat(),
    }
}

fn names<'r>(rows: impl Iterator<Item = &'r Row>) -> Vec<String> {
    rows.flat_map(|row| row.extensions).map(|e| format!(".{e}")).collect()
}

/// The row of a file's name, and where its extension begins, at the dot. The longest extension wins.
fn row(name: &str) -> Option<(&'static Row, usize)> {
    let name = name.to_ascii_lowercase();
    let ends = |extension: &str| name.strip_suffix(extension)?.strip_suffix('.').map(str::len);
    let found = FORMATS.iter().flat_map(|row| row.extensions.iter().filter_map(move |e| Some((row, ends(e)?))));
    found.min_by_key(|(_, at)| *at)
}

impl Format {
    /// Whether it is a folder of files.
    pub fn is_folder(self) -> bool {
        self == Format::Zarr
    }

    /// Whether it is of this kind and holds places in the world as 32-bit numbers.
    pub fn is_single(self, kind: Kind) -> bool {
        self.row().is_some_and(|row| row.single && row.kind == kind)
    }

    /// Whether it has voxels or pixels that lie on a grid of one's choice.
    pub fn is_on_grid(self) -> bool {
        self == Format::Dem || self.row().is_some_and(|row| row.kind == Kind::Volume)
    }

    /// The format of an output, by its name.
    pub fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        Format::named(&name).map_err(|message| Error::Output { path: path.into(), message })
    }

    fn named(name: &str) -> std::result::Result<Self, String> {
        match row(name) {
            None => Err(format!("unknown extension; expected {}", known())),
            Some((Row { feature: Some((feature, false)), holds, .. }, _)) => {
                Err(format!("this program was built without what writes it ({holds}; feature `{feature}`)"))
            }
            Some((row, _)) => Ok(row.format),
        }
    }

    /// Usual extension of its files, with the dot.
    pub fn extension(self) -> String {
        self.row().map_or(String::new(), |row| format!(".{}", row.extensions[0]))
    }

    fn row(self) -> Option<&'static Row> {
        FORMATS.iter().find(|row| row.format == self)
    }

    /// Whether it is that of a volume, whatever its voxels hold.
    pub(super) fn is_volume(self) -> bool {
        self.row().is_some_and(|row| row.kind == Kind::Volume)
    }
}

/// Whether `path` can be an output by its name, and no folder that must stay has it.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn check_name(path: &Path) -> Result<()> {
    let format = Format::of(path)?;
    check_place(path, &place_of(path)?, format.is_folder())
}

/// Whether `path` can be a page by its name.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn check_page(path: &Path) -> Result<()> {
    match Format::of(path) {
        Ok(Format::Html) => Ok(()),
        _ => {
            let message = format!("is no page; expected {}", Format::Html.extension());
            Err(Error::Output { path: path.into(), message })
        }
    }
}

/// Whether outputs may have an extension.
///
/// # Errors
/// A message with those that there are.
pub fn check_extension(extension: &str) -> std::result::Result<(), String> {
    Format::named(&format!("id.{extension}")).map(drop)
}

/// Kind of an output where there are many labels.
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

/// Kind of an output, by its name.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn kind(path: &Path) -> Result<Kind> {
    let kind = Format::of(path)?.row().map_or(Kind::View, |row| row.kind);
    Ok(if kind == Kind::Volume && named_content(path).is_some() { Kind::View } else { kind })
}

/// The format of a report, by its name: a page, else JSON.
///
/// # Errors
/// [`Error::Output`] for the name of something else, which a report in it would not be.
pub(super) fn of_report(path: &Path) -> Result<Format> {
    match row(&path.file_name().unwrap_or_default().to_string_lossy()) {
        Some((Row { format: Format::Html, .. }, _)) => Ok(Format::Html),
        Some((row, _)) if row.format != Format::Report => {
            let [data, page] = [Format::Report, Format::Html].map(Format::extension);
            let message = format!("is a name for another output ({}); a report is {data} or {page}", row.holds);
            Err(Error::Output { path: path.into(), message })
        }
        _ => Ok(Format::Report),
    }
}

/// Words before an extension that say what a volume holds: `NAME.origin.nrrd`.
const CONTENTS: [(&str, Content); 2] = [("origin", Content::Origin), ("confidence", Content::Confidence)];

/// Words before an extension that make a file of another kind of it: `dem` of `.dem.tif`, `origin` of `.origin.nrrd`.
pub(super) fn telling_words() -> impl Iterator<Item = &'static str> {
    let of_formats = FORMATS.iter().flat_map(|row| row.extensions).filter_map(|e| e.split_once('.'));
    of_formats.map(|(word, _)| word).chain(CONTENTS.map(|(word, _)| word))
}

/// Place in a name at which the words about the file's content begin: `.stl`, `.nii.gz`, `.contours.json`, `.origin.nrrd`.
pub fn extension_at(name: &str) -> usize {
    let name = name.to_ascii_lowercase();
    let at = row(&name).map(|(_, at)| at).or_else(|| name.rfind('.')).unwrap_or(name.len());
    let content = CONTENTS.into_iter().find_map(|(word, _)| name[..at].strip_suffix(word)?.strip_suffix('.'));
    content.map_or(at, str::len)
}

/// Whether `target` is a name that the system takes, and nothing stands at its `place`, behind all links, that an output must not replace: a folder, for an
/// output of Zarr one that holds anything but such an output, or what nobody may write.
pub(super) fn check_place(target: &Path, place: &Path, is_folder: bool) -> Result<()> {
    let fail = |message: String| Err(Error::Output { path: target.into(), message });
    if let Err(e) = std::fs::symlink_metadata(place)
        && matches!(e.kind(), ErrorKind::InvalidFilename | ErrorKind::InvalidInput)
    {
        let bytes = place.file_name().map_or(0, |name| name.as_encoded_bytes().len());
        return fail(format!("is no name for a file here: {e} ({bytes} bytes; most systems take up to 255)"));
    }
    if let Some(file) = place.ancestors().skip(1).find(|above| above.is_file()) {
        return fail(format!("lies below {}, which is a file, no folder", file.display()));
    }
    // Of a link to a pipe its own metadata tells.
    let Ok(found) = target.metadata() else { return Ok(()) };
    match (found.is_dir(), is_folder) {
        (true, true) => match own_store::what_stays(place) {
            Ok(None) => {}
            Ok(Some(message)) => return fail(message),
            Err(e) => return fail(format!("is a folder that cannot be read, and is not replaced: {e}")),
        },
        (true, false) => return fail("is a folder".into()),
        (false, _) if !found.is_file() => {
            return fail("is no plain file: a pipe, a device or a socket is not replaced".into());
        }
        (false, _) => {}
    }
    match is_protected(place, &found) {
        true => fail("is write-protected, and is not replaced; give the output a name of its own".into()),
        false => Ok(()),
    }
}

/// Whether what stands at a place says that it is not to be written, be it by anybody or by who asks.
fn is_protected(place: &Path, found: &Metadata) -> bool {
    // A folder of Windows that is called read-only can be written.
    let nobody = found.permissions().readonly() && (cfg!(unix) || found.is_file());
    #[cfg(any(target_os = "linux", target_os = "macos"))]
    let asked = rustix::fs::access(place, rustix::fs::Access::WRITE_OK) == Err(rustix::io::Errno::ACCESS);
    #[cfg(not(any(target_os = "linux", target_os = "macos")))]
    let (asked, _) = (false, place);
    nobody || asked
}

/// Bytes of memory that writing `paths` needs at most while layers of `dims` pixels that lie so arrive, however many these are, and the
/// body ends flat on at most `lid` pixels.
pub fn bytes<'p>(paths: impl IntoIterator<Item = &'p Path>, dims: [usize; 2], geometry: &Geometry, lid: usize) -> u64 {
    needed(paths.into_iter().filter_map(|path| Format::of(path).ok()), dims, geometry, lid)
}

/// Bytes of the pieces of a surface that are made together: of two layers all cells at most.
fn surface_bytes(pixels: u64) -> u64 {
    (marching::BYTES as u64).min(PER_LID_CELL * pixels)
}

pub(super) fn needed(formats: impl Iterator<Item = Format>, dims: [usize; 2], geometry: &Geometry, lid: usize) -> u64 {
    let pixels = dims.iter().product::<usize>() as u64;
    let turned = if geometry.is_layered() { 0 } else { (transposed::BLOCK_BYTES + transposed::BUFFER_BYTES) as u64 };
    let costs: Vec<Cost> = formats.filter_map(|format| Some(format.row()?.cost)).collect();
    let mesh = |c: &Cost| matches!(c, Cost::Mesh | Cost::Picture | Cost::Page);
    let surface = |c: &Cost| mesh(c) || *c == Cost::Surface;
    let each = costs.iter().map(|cost| match cost {
        Cost::Volume => PER_VOLUME_PIXEL * pixels + turned,
        Cost::Map => PER_MAP_PIXEL * pixels,
        Cost::Picture => PICTURE_BYTES,
        Cost::Chunks => zarr_bytes(pixels as usize),
        Cost::Page => PAGE_BYTES,
        Cost::Lines => PER_LINE_PIXEL * pixels,
        Cost::Surface | Cost::Mesh => 0,
    });
    each.sum::<u64>()
        + if costs.iter().any(surface) { PER_SURFACE_PIXEL * pixels + surface_bytes(pixels) } else { 0 }
        + if costs.iter().any(mesh) {
            spool::IN_MEMORY as u64 + PER_MESH_PIXEL * pixels + PER_LID_PIXEL * lid as u64
        } else {
            0
        }
        + BUFFER_BYTES as u64 * costs.len() as u64
}

#[cfg(feature = "zarr")]
fn zarr_bytes(pixels: usize) -> u64 {
    crate::surface::zarr::bytes(pixels, rayon::current_num_threads())
}

#[cfg(not(feature = "zarr"))]
fn zarr_bytes(_pixels: usize) -> u64 {
    0
}

/// Content of a volume that its name says: `NAME.origin.nrrd`, `NAME.confidence.nrrd` (any volume format).
pub(super) fn named_content(target: &Path) -> Option<Content> {
    let name = target.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let (_, at) = row(&name)?;
    let (_, word) = name[..at].rsplit_once('.')?;
    CONTENTS.into_iter().find_map(|(own, content)| (own == word).then_some(content))
}
