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
use crate::surface::mesh_files::{ListedWriter, StlWriter};
use crate::surface::mha::MhaWriter;
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
    Png,
    Tiff,
    Report,
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

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .mha, .zarr, .stl, .ply, .obj, .png (picture), .tif (height map), .contours.json, .geojson (contours), \
                     .dcm (completed RTSTRUCT), .json (report)";

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
    /// A picture, a height map, contours.
    View,
}

/// What an output is, by its name.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn kind(path: &Path) -> Result<Kind> {
    Ok(match Format::of(path)? {
        Format::Nrrd | Format::Nifti { .. } | Format::Mha | Format::Zarr => Kind::Volume,
        Format::Stl | Format::Ply | Format::Obj => Kind::Mesh,
        Format::Report => Kind::Report,
        Format::Png | Format::Tiff | Format::Contours | Format::GeoJson | Format::StructureSet => Kind::View,
    })
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
    let surface = |f: &Format| matches!(f, Format::Stl | Format::Ply | Format::Obj | Format::Png | Format::Report);
    let mesh = |f: &Format| matches!(f, Format::Ply | Format::Obj | Format::Png);
    let each = formats.iter().map(|format| match format {
        Format::Nrrd | Format::Nifti { .. } | Format::Mha => PER_VOLUME_PIXEL * pixels + turned,
        Format::Tiff => PER_MAP_PIXEL * pixels,
        Format::Png => PICTURE_BYTES,
        Format::Zarr => zarr_bytes(pixels as usize),
        Format::Contours | Format::GeoJson | Format::StructureSet => PER_LINE_PIXEL * pixels,
        Format::Stl | Format::Ply | Format::Obj | Format::Report => 0,
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

    /// The RTSTRUCT that was read, for a completed one
    #[cfg(feature = "dicom")]
    #[arg(skip)]
    #[serde(skip)]
    pub source: Option<Arc<Source>>,
}

impl OutputOptions {
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
            outputs.add(path, Format::Report, temporary)?;
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
        for output in &mut self.outputs.files {
            writers.push(writer(output, header, self.content, &self.options).map_err(|source| output.fails(source))?);
        }
        let folder = self.outputs.files.first().map_or(Path::new("."), |f| parent(&f.target));
        self.outputs.stream = Some(BodyStream::new(header, writers, folder));
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
) -> io::Result<Box<dyn BodyWriter>> {
    let file = match &mut output.pending {
        Pending::File(file) => file.as_file_mut(),
        Pending::Folder(folder) => return in_folder(folder.path(), header, content),
    };
    let folder = parent(&output.target);
    let mut file = file.try_clone()?;
    file.set_len(0)?;
    file.rewind()?;
    let out = BufWriter::with_capacity(BUFFER_BYTES, file);
    Ok(match output.format {
        Format::Nrrd => Box::new(nrrd::writer(out, header, content, folder)?),
        Format::Nifti { gzip } => Box::new(nifti::writer(out, header, content, gzip, folder)?),
        Format::Mha => Box::new(MhaWriter::new(out, header, content, folder)?),
        Format::Stl => Box::new(StlWriter::new(out)?),
        Format::Ply => Box::new(ListedWriter::ply(out)),
        Format::Obj => Box::new(ListedWriter::obj(out)),
        Format::Png => {
            let options = RenderOptions { contours: options.contours, ..RenderOptions::default() };
            Box::new(PictureWriter::new(out, header, options))
        }
        Format::Tiff => Box::new(HeightMapWriter::new(out, header, options.map.as_ref().map(|map| &map.crs))),
        Format::Report => Box::new(ReportWriter(out)),
        Format::Contours => Box::new(ContoursWriter::new(out, header)?),
        Format::GeoJson => {
            let crs = options.map.as_ref().map_or(&Crs::Unknown, |map| &map.crs);
            Box::new(GeoJsonWriter::new(out, header, crs)?)
        }
        Format::StructureSet => return structures(out, header, options),
        Format::Zarr => return Err(io::Error::other("a folder is needed")),
    })
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
