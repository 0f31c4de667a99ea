//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::pending::{Pending, Temporary, files_below, parent};
use crate::error::{Error, Result};
use crate::report::Report;
use crate::surface::heightmap::HeightMapWriter;
use crate::surface::html::HtmlWriter;
use crate::surface::mesh_files::{ListedWriter, MeshFormat, StlWriter, write_obj, write_ply, write_stl};
use crate::surface::origin::OriginWriter;
use crate::surface::render::{PictureWriter, RenderOptions};
use crate::surface::stream::{BodyStream, BodyWriter, Ending, Failed, Header, LayerSink, Needs};
use crate::surface::volume::Content;
use crate::surface::{Layer, nifti, nrrd, spool};

/// What a file holds, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Nrrd,
    Nifti { gzip: bool },
    Stl,
    Ply,
    Obj,
    Glb,
    Png,
    Tiff,
    Report,
    Html,
    Zarr,
}

/// Bytes of an output's buffer.
const BUFFER_BYTES: usize = 1 << 20;
/// Bytes per pixel of a layer: of its voxels, of a height map and the layer below, of the two layers and the vertices on their edges that
/// marching cubes needs, and of the slab of the mesh whose normals are not finished.
const PER_VOLUME_PIXEL: u64 = 4;
const PER_MAP_PIXEL: u64 = 8;
const PER_SURFACE_PIXEL: u64 = 48;
const PER_MESH_PIXEL: u64 = 16;
/// Bytes of the picture's samples, 2400 x 1800 with colour and depth, and of the picture.
const PICTURE_BYTES: u64 = 160 << 20;

/// Bytes of the page of a report: what it shows, as numbers and as text, twice over.
const PAGE_BYTES: u64 = 64 << 20;

const KNOWN: &str =
    ".nrrd, .nii, .nii.gz, .zarr, .stl, .ply, .obj, .glb, .png (picture), .tif (height map), .json, .html (report)";

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if name.ends_with(".nii.gz") {
            return Ok(Format::Nifti { gzip: true });
        }
        match name.rsplit_once('.').map(|(_, extension)| extension) {
            Some("nrrd") => Ok(Format::Nrrd),
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

/// Bytes of memory that writing `paths` needs at most while layers of `dims` pixels arrive, however many these are.
pub fn bytes<'p>(paths: impl IntoIterator<Item = &'p Path>, dims: [usize; 2]) -> u64 {
    needed(paths.into_iter().filter_map(|path| Format::of(path).ok()), dims)
}

fn needed(formats: impl Iterator<Item = Format>, dims: [usize; 2]) -> u64 {
    let pixels = dims.iter().product::<usize>() as u64;
    let formats: Vec<Format> = formats.collect();
    let mesh = |f: &Format| matches!(f, Format::Ply | Format::Obj | Format::Glb | Format::Png | Format::Html);
    let surface = |f: &Format| mesh(f) || matches!(f, Format::Stl | Format::Report);
    let each = formats.iter().map(|format| match format {
        Format::Nrrd | Format::Nifti { .. } => PER_VOLUME_PIXEL * pixels,
        Format::Tiff => PER_MAP_PIXEL * pixels,
        Format::Png => PICTURE_BYTES,
        Format::Zarr => zarr_bytes(pixels as usize),
        Format::Html => PAGE_BYTES,
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

    /// Volumes hold 8-bit masks instead of signed distances
    #[arg(long)]
    pub mask: bool,

    /// Draw the input contours into pictures
    #[arg(long)]
    pub contours: bool,

    /// Meshes (.stl .ply .obj .glb) with fewer triangles, closed, no farther than this from the full one (measured both ways); the
    /// whole mesh must fit in memory
    #[arg(long, value_name = "ERROR")]
    pub simplify: Option<f64>,
}

impl OutputOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`] with name, range and value.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [("dz", self.dz), ("simplify", self.simplify)] {
            if let Some(v) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(Error::Setting {
                    name: name.into(),
                    message: format!("must be a positive number; got {v}"),
                });
            }
        }
        if self.simplify.is_some() && cfg!(not(feature = "simplify")) {
            let message = "this program was built without it (feature `simplify`)".into();
            return Err(Error::Setting { name: "simplify".into(), message });
        }
        Ok(())
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
            let format = if let Ok(Format::Html) = Format::of(path) { Format::Html } else { Format::Report };
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

    /// Bytes of memory that writing needs at most while layers of `dims` pixels arrive.
    pub fn bytes(&self, dims: [usize; 2]) -> u64 {
        needed(self.files.iter().map(|f| f.format), dims)
    }

    /// Takes the layers of a body and writes them under temporary names.
    pub fn sink<'o>(&'o mut self, options: &'o OutputOptions) -> impl LayerSink + 'o {
        Sink { outputs: self, options }
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
    options: &'o OutputOptions,
}

impl LayerSink for Sink<'_> {
    fn begin(&mut self, header: &Header) -> Result<()> {
        self.outputs.stream = None;
        let mut writers = Vec::new();
        let meshes = Meshes::new(self.options);
        for output in &mut self.outputs.files {
            writers.push(writer(output, header, self.options, &meshes).map_err(|source| output.fails(source))?);
        }
        let folder = self.outputs.files.first().map_or(Path::new("."), |f| parent(&f.target));
        self.outputs.stream = Some(BodyStream::new(header, writers, folder));
        self.outputs.meshes = meshes;
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
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
    options: &OutputOptions,
    meshes: &Meshes,
) -> io::Result<Box<dyn BodyWriter>> {
    let content = content(&output.target, options);
    let volume = |writer: Box<dyn BodyWriter>| -> Box<dyn BodyWriter> {
        match content {
            Content::Distance | Content::Mask => writer,
            Content::Origin | Content::Confidence => {
                Box::new(OriginWriter::new(writer, content, parent(&output.target)))
            }
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
        Format::Nrrd => volume(Box::new(nrrd::writer(out, header, content)?)),
        Format::Nifti { gzip } => volume(Box::new(nifti::writer(out, header, content, gzip)?)),
        Format::Stl if options.simplify.is_none() => Box::new(StlWriter::new(out)?),
        Format::Stl => meshes.writer(out, Box::new(write_stl)),
        Format::Ply => meshes.writer(out, Box::new(write_ply)),
        Format::Obj => meshes.writer(out, Box::new(write_obj)),
        Format::Glb => meshes.writer(out, glb(header, &output.target)),
        Format::Png => {
            let options = RenderOptions { contours: options.contours, ..RenderOptions::default() };
            Box::new(PictureWriter::new(out, header, options))
        }
        Format::Tiff => Box::new(HeightMapWriter::new(out, header)),
        Format::Report => Box::new(ReportWriter(out)),
        Format::Html => Box::new(HtmlWriter::new(out, header, stem(&output.target))),
        Format::Zarr => return Err(io::Error::other("a folder is needed")),
    })
}

/// What a volume holds: `NAME.origin.nrrd` and `NAME.confidence.nrrd` (any volume format) say so themselves.
fn content(target: &Path, options: &OutputOptions) -> Content {
    let name = target.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let parts: Vec<&str> = name.trim_end_matches(".gz").split('.').collect();
    match parts[..] {
        [_, .., "origin", _] => Content::Origin,
        [_, .., "confidence", _] => Content::Confidence,
        _ if options.mask => Content::Mask,
        _ => Content::Distance,
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
