//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::pending::{Pending, Temporary, files_below, parent};
use crate::error::{Error, Result};
use crate::map::{Crs, Map};
use crate::report::Report;
#[cfg(feature = "dicom")]
use crate::rtstruct::{Added, Source, StructureSet, StructuresWriter};
use crate::stack::{ContourStack, Geometry};
use crate::surface::contour_lines::ContoursWriter;
use crate::surface::geojson::GeoJsonWriter;
use crate::surface::heightmap::HeightMapWriter;
use crate::surface::html::HtmlWriter;
use crate::surface::mesh_files::{ListedWriter, MeshFormat, StlWriter, write_obj, write_ply, write_stl};
use crate::surface::mha::MhaWriter;
use crate::surface::origin::OriginWriter;
use crate::surface::render::{PictureWriter, RenderOptions};
use crate::surface::stream::{BodyStream, BodyWriter, Ending, Failed, Header, LayerSink, Needs};
use crate::surface::volume::{Content, Whole};
use crate::surface::{Layer, nifti, nrrd, spool, transposed};

/// What a file holds, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
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
const BUFFER_BYTES: usize = 1 << 20;
/// Bytes per pixel of a layer: of its voxels, of a height map and the layer below, of the two layers and the vertices on their edges that
/// marching cubes needs, and of the slab of the mesh whose normals are not finished.
const PER_VOLUME_PIXEL: u64 = 4;
const PER_MAP_PIXEL: u64 = 8;
const PER_SURFACE_PIXEL: u64 = 48;
const PER_MESH_PIXEL: u64 = 16;
/// Of the field in which a layer's contour lines are found, and of the lines.
const PER_LINE_PIXEL: u64 = 24;
/// Bytes of the picture's samples, 2400 x 1800 with colour and depth, and of the picture.
const PICTURE_BYTES: u64 = 160 << 20;

/// Bytes of the page of a report: what it shows, as numbers and as text, twice over.
const PAGE_BYTES: u64 = 64 << 20;

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .mha, .zarr, .stl, .ply, .obj, .glb, .png (picture), .tif (height map), .contours.json, \
                     .geojson (contours), .dcm (completed RTSTRUCT), .json, .html (report)";

impl Format {
    fn of(path: &Path) -> Result<Self> {
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
            Some("glb") if cfg!(feature = "glb") => Ok(Format::Glb),
            Some("glb") => {
                let message = "this program was built without glTF (feature `glb`)".into();
                Err(Error::Output { path: path.into(), message })
            }
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
    check_place(path, Format::of(path)?)
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

/// Whether nothing stands at `path` that an output of this format must not replace.
fn check_place(path: &Path, format: Format) -> Result<()> {
    let message = match (path.is_dir(), format) {
        (true, Format::Zarr) if path.join("zarr.json").is_file() => return Ok(()),
        (true, Format::Zarr) => "is a folder, but none of Zarr, and is not replaced",
        (true, _) => "is a folder",
        (false, _) => return Ok(()),
    };
    Err(Error::Output { path: path.into(), message: message.into() })
}

/// Bytes of memory that writing `paths` needs at most while layers of `dims` pixels that lie so arrive, however many these are.
pub fn bytes<'p>(paths: impl IntoIterator<Item = &'p Path>, dims: [usize; 2], geometry: &Geometry) -> u64 {
    needed(paths.into_iter().filter_map(|path| Format::of(path).ok()), dims, geometry)
}

fn needed(formats: impl Iterator<Item = Format>, dims: [usize; 2], geometry: &Geometry) -> u64 {
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
        + if formats.iter().any(mesh) { spool::IN_MEMORY as u64 + PER_MESH_PIXEL * pixels } else { 0 }
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

/// What is made of the result.
#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Output")]
pub struct OutputOptions {
    /// Distance between output heights [default: the input's own z_out, else the smaller pixel side]
    #[arg(long, value_name = "HEIGHT")]
    pub dz: Option<f64>,

    /// Output heights as far apart as the smaller pixel side, whatever the input says
    #[arg(long, conflicts_with = "dz")]
    pub isotropic: bool,

    /// Volumes hold 8-bit masks instead of signed distances
    #[arg(long)]
    pub mask: bool,

    /// Draw the input contours into pictures
    #[arg(long)]
    pub contours: bool,

    /// The contour map that was read: where outputs lie, and which part of the stack they show
    #[arg(skip)]
    #[serde(skip)]
    pub map: Option<Arc<Map>>,
    /// Meshes (.stl .ply .obj .glb) with fewer triangles, closed, no farther than this from the full one (measured both ways); the
    /// whole mesh must fit in memory
    #[arg(long, value_name = "ERROR")]
    pub simplify: Option<f64>,

    /// The RTSTRUCT that was read, for a completed one
    #[cfg(feature = "dicom")]
    #[arg(skip)]
    #[serde(skip)]
    pub source: Option<Arc<Source>>,
}

impl OutputOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`] with name, range and value.
    pub fn check_ranges(&self) -> Result<()> {
        let fail = |name: &str, message: String| Err(Error::Setting { name: name.into(), message });
        if self.isotropic && self.dz.is_some() {
            return fail("isotropic", "sets the distance that `dz` names".into());
        }
        for (name, value) in [("dz", self.dz), ("simplify", self.simplify)] {
            if let Some(v) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return fail(name, format!("must be a positive number; got {v}"));
            }
        }
        if self.simplify.is_some() && cfg!(not(feature = "simplify")) {
            return fail("simplify", "this program was built without it (feature `simplify`)".into());
        }
        Ok(())
    }

    /// Refuses a completed RTSTRUCT where none was read.
    fn check(&self, path: &Path, format: Format) -> Result<()> {
        if format != Format::StructureSet {
            return Ok(());
        }
        #[cfg(feature = "dicom")]
        if let Some(source) = &self.source {
            return source.check_output(path);
        }
        let message = "a completed RTSTRUCT needs an RTSTRUCT as input".into();
        Err(Error::Output { path: path.into(), message })
    }

    /// Distance between output heights, where the options say it.
    pub fn step(&self, stack: &ContourStack) -> Option<f64> {
        let [dx, dy] = stack.spacing;
        if self.isotropic { Some(dx.min(dy)) } else { self.dz }
    }
}

/// Open outputs.
#[derive(Default)]
pub struct Outputs {
    files: Vec<Output>,
    /// The body on its way into the files.
    stream: Option<BodyStream<'static>>,
    meshes: Meshes,
}

struct Output {
    target: PathBuf,
    format: Format,
    pending: Pending,
}

impl Outputs {
    /// Opens all outputs, and the report where one is wanted.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written.
    pub fn open(paths: &[PathBuf], report: Option<&Path>, temporary: Temporary) -> Result<Self> {
        let mut outputs = Outputs::default();
        for path in paths {
            outputs.add(path, Format::of(path)?, temporary)?;
        }
        if let Some(path) = report {
            let format = if is_page(path) { Format::Html } else { Format::Report };
            outputs.add(path, format, temporary)?;
        }
        Ok(outputs)
    }

    fn add(&mut self, path: &Path, format: Format, temporary: Temporary) -> Result<()> {
        let fail = |message: String| Err(Error::Output { path: path.into(), message });
        if self.files.iter().any(|f| f.target == path) {
            return fail("is named twice".into());
        }
        check_place(path, format)?;
        match Pending::open(path, format == Format::Zarr, temporary) {
            Ok(pending) => self.files.push(Output { target: path.into(), format, pending }),
            Err(e) => return fail(format!("in folder {}: {e}", parent(path).display())),
        }
        Ok(())
    }

    /// Refuses outputs that cannot be made of the input.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn check(&self, options: &OutputOptions) -> Result<()> {
        self.files.iter().try_for_each(|f| options.check(&f.target, f.format))
    }

    /// Bytes of memory that writing needs at most while layers of `dims` pixels that lie so arrive.
    pub fn bytes(&self, dims: [usize; 2], geometry: &Geometry) -> u64 {
        needed(self.files.iter().map(|f| f.format), dims, geometry)
    }

    /// Takes the layers of a body and writes them under temporary names.
    pub fn sink(&mut self, options: &OutputOptions) -> impl LayerSink + '_ {
        let content = if options.mask { Content::Mask } else { Content::Distance };
        Sink { outputs: self, content, options: options.clone(), dims: [0; 2] }
    }

    /// The same for layers of label numbers.
    pub fn label_sink(&mut self, numbers: Whole) -> impl LayerSink + '_ {
        Sink { outputs: self, content: Content::Labels(numbers), options: OutputOptions::default(), dims: [0; 2] }
    }

    /// Completes everything under temporary names, when the last layer has come. Where an output needs the surface, its volume and area are
    /// put into the report.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn complete(&mut self, report: &mut Report) -> Result<()> {
        if let Some(stream) = self.stream.take() {
            stream.finish(report).map_err(|failed| self.failed(failed))?;
            report.warnings.extend(self.meshes.warning());
        }
        self.files.iter().try_for_each(|f| f.pending.sync().map_err(|source| f.fails(source)))
    }

    /// Completes one structure set, to which several bodies have added, under its temporary name.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "dicom")]
    pub fn complete_structures(&self, set: &StructureSet, added: &[Added]) -> Result<()> {
        self.files.iter().try_for_each(|output| {
            let write = || {
                let mut out = BufWriter::with_capacity(BUFFER_BYTES, File::create(output.pending.path())?);
                set.write_completed(&mut out, added)?;
                out.flush()?;
                output.pending.sync()
            };
            write().map_err(|source| output.fails(source))
        })
    }

    fn failed(&self, (number, source): Failed) -> Error {
        // There are as many writers as files.
        Error::Write { path: self.files.get(number).map(|f| f.target.clone()).unwrap_or_default(), source }
    }

    /// The outputs and the temporary files, or folders, that will become them.
    pub fn temporary(&self) -> impl Iterator<Item = (&Path, &Path)> {
        self.files.iter().map(|f| (f.target.as_path(), f.pending.path()))
    }

    /// Renames everything.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn rename(self) -> Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        for Output { target, pending, .. } in self.files {
            pending.rename(&target).map_err(|source| Error::Write { path: target.clone(), source })?;
            written.push(target);
        }
        Ok(written)
    }
}

impl Output {
    fn fails(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }
}

/// Layers on their way into the files.
struct Sink<'o> {
    outputs: &'o mut Outputs,
    content: Content,
    options: OutputOptions,
    /// Pixels of the layers that arrive.
    dims: [usize; 2],
}

impl LayerSink for Sink<'_> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.outputs.stream = None;
        self.dims = header.dims;
        let within = self.options.map.as_ref().map(|map| map.header(header));
        let header = within.as_ref().unwrap_or(header);
        let mut writers = Vec::new();
        let meshes = Meshes::new(&self.options);
        for output in &mut self.outputs.files {
            let writer = writer(output, header, self.content, &self.options, &meshes);
            writers.push(writer.map_err(|source| output.fails(source))?);
        }
        let folder = self.outputs.files.first().map_or(Path::new("."), |f| parent(&f.target));
        self.outputs.stream = Some(BodyStream::new(header, writers, folder));
        self.outputs.meshes = meshes;
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        let layer = match &self.options.map {
            Some(map) => map.layer(&layer, self.dims),
            None => layer,
        };
        match &mut self.outputs.stream {
            Some(stream) => stream.layer(&layer).map_err(|failed| self.outputs.failed(failed)),
            None => Ok(()),
        }
    }
}

/// The writer of an output, from its beginning.
fn writer(
    output: &mut Output,
    header: &Header,
    content: Content,
    options: &OutputOptions,
    meshes: &Meshes,
) -> io::Result<Box<dyn BodyWriter>> {
    let folder = parent(&output.target);
    let content = named_content(&output.target).filter(|_| !matches!(content, Content::Labels(_))).unwrap_or(content);
    let volume = |writer: Box<dyn BodyWriter>| -> Box<dyn BodyWriter> {
        match content {
            Content::Distance | Content::Mask | Content::Labels(_) => writer,
            Content::Origin | Content::Confidence => Box::new(OriginWriter::new(writer, content, folder)),
        }
    };
    let file = match &mut output.pending {
        Pending::File(file) => file.as_file_mut(),
        Pending::Folder(folder) => return in_folder(folder.path(), header, content).map(volume),
    };
    let mut file = file.try_clone()?;
    file.set_len(0)?;
    file.rewind()?;
    let out = BufWriter::with_capacity(BUFFER_BYTES, file);
    Ok(match output.format {
        Format::Nrrd => volume(Box::new(nrrd::writer(out, header, content, folder)?)),
        Format::Nifti { gzip } => volume(Box::new(nifti::writer(out, header, content, gzip, folder)?)),
        Format::Mha => volume(Box::new(MhaWriter::new(out, header, content, folder)?)),
        Format::Stl if options.simplify.is_none() => Box::new(StlWriter::new(out)?),
        Format::Stl => meshes.writer(out, Box::new(write_stl)),
        Format::Ply => meshes.writer(out, Box::new(write_ply)),
        Format::Obj => meshes.writer(out, Box::new(write_obj)),
        Format::Glb => meshes.writer(out, glb(header, &output.target)),
        Format::Png => {
            let options = RenderOptions { contours: options.contours, ..RenderOptions::default() };
            Box::new(PictureWriter::new(out, header, options))
        }
        Format::Tiff => Box::new(HeightMapWriter::new(out, header, options.map.as_ref().map(|map| &map.crs))),
        Format::Report => Box::new(ReportWriter(out)),
        Format::Html => Box::new(HtmlWriter::new(out, header, stem(&output.target))),
        Format::Contours => Box::new(ContoursWriter::new(out, header)?),
        Format::GeoJson => {
            let crs = options.map.as_ref().map_or(&Crs::Unknown, |map| &map.crs);
            Box::new(GeoJsonWriter::new(out, header, crs)?)
        }
        Format::StructureSet => return structures(out, header, options),
        Format::Zarr => return Err(io::Error::other("a folder is needed")),
    })
}

/// What a volume holds that its name says: `NAME.origin.nrrd`, `NAME.confidence.nrrd` (any volume format).
fn named_content(target: &Path) -> Option<Content> {
    let name = target.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let parts: Vec<&str> = name.trim_end_matches(".gz").split('.').collect();
    match parts[..] {
        [_, .., "origin", _] => Some(Content::Origin),
        [_, .., "confidence", _] => Some(Content::Confidence),
        _ => None,
    }
}

/// An output's name without its extension, as a title.
fn stem(target: &Path) -> String {
    target.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(feature = "glb")]
fn glb(header: &Header, target: &Path) -> MeshFormat<BufWriter<File>> {
    let named = crate::surface::glb::Named { name: stem(target), unit: header.unit.clone() };
    Box::new(move |out, mesh| crate::surface::glb::write_glb(out, mesh, &named))
}

#[cfg(not(feature = "glb"))]
fn glb(header: &Header, _target: &Path) -> MeshFormat<BufWriter<File>> {
    let unit = header.unit.clone();
    Box::new(move |_, _| Err(io::Error::other(format!("no glTF in this program (unit {unit})"))))
}

/// The meshes of a run: the whole one, or one simpler one for all files.
#[derive(Default)]
struct Meshes {
    #[cfg(feature = "simplify")]
    simplifier: Option<std::sync::Arc<crate::surface::simplify::Simplifier>>,
}

impl Meshes {
    #[cfg_attr(not(feature = "simplify"), expect(unused_variables, reason = "options have been checked"))]
    fn new(options: &OutputOptions) -> Self {
        Meshes {
            #[cfg(feature = "simplify")]
            simplifier: options.simplify.map(|error| crate::surface::simplify::Simplifier::new(error).into()),
        }
    }

    /// What is to be said at the end.
    fn warning(&self) -> Option<String> {
        #[cfg(feature = "simplify")]
        if self.simplifier.as_ref().is_some_and(|s| s.gave_up()) {
            return Some("simplify: no closed surface with fewer triangles was found; meshes are the full one".into());
        }
        None
    }

    fn writer(&self, out: BufWriter<File>, format: MeshFormat<BufWriter<File>>) -> Box<dyn BodyWriter> {
        #[cfg(feature = "simplify")]
        if let Some(simplifier) = self.simplifier.clone() {
            let simpler: MeshFormat<_> = Box::new(move |out, mesh| format(out, &mut &*simplifier.simpler(mesh)?));
            return Box::new(ListedWriter::new(out, simpler));
        }
        Box::new(ListedWriter::new(out, format))
    }
}

/// The writer of a completed RTSTRUCT.
#[cfg(feature = "dicom")]
fn structures(out: BufWriter<File>, header: &Header, options: &OutputOptions) -> io::Result<Box<dyn BodyWriter>> {
    let source = options.source.as_ref().ok_or_else(|| io::Error::other("no RTSTRUCT was read"))?;
    Ok(Box::new(StructuresWriter::new(out, source, header).map_err(io::Error::other)?))
}

#[cfg(not(feature = "dicom"))]
fn structures(_: BufWriter<File>, header: &Header, options: &OutputOptions) -> io::Result<Box<dyn BodyWriter>> {
    Err(io::Error::other(format!("no DICOM in this program: {header:?}, {options:?}")))
}

/// The writer of a Zarr into a folder, which is emptied.
fn in_folder(folder: &Path, header: &Header, content: Content) -> io::Result<Box<dyn BodyWriter>> {
    for file in files_below(folder)? {
        fs::remove_file(file)?;
    }
    #[cfg(feature = "zarr")]
    return crate::surface::zarr::writer(folder, header, content);
    #[cfg(not(feature = "zarr"))]
    Err(io::Error::other(format!("no Zarr in this program: {header:?}, {content:?}")))
}

/// Writes the report, at the end.
struct ReportWriter(BufWriter<File>);

impl BodyWriter for ReportWriter {
    fn needs(&self) -> Needs {
        Needs::Surface
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut self.0, end.report)?;
        self.0.write_all(b"\n")?;
        self.0.flush()
    }
}
