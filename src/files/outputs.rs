//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

#[cfg(feature = "dicom")]
use std::fs::File;
use std::io;
#[cfg(feature = "dicom")]
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;

#[cfg(feature = "dicom")]
use super::format::BUFFER_BYTES;
use super::format::{Format, Kind, kind, needed, of_report, places};
use super::options::OutputOptions;
use super::pending::{Pending, Temporary, parent};
use super::places::Places;
use super::preview::Preview;
use super::scenes::{Scenes, SharedScene};
use super::writers::{Meshes, writer};
use crate::error::{Error, Result};
use crate::progress::Stop;
use crate::report::Report;
#[cfg(feature = "dicom")]
use crate::rtstruct::{Added, StructureSet};
use crate::stack::Geometry;
use crate::stack::appearance::Appearance;
use crate::surface::Layer;
use crate::surface::content::{Content, Scalar};
use crate::surface::header::Header;
use crate::surface::stream::{BodyStream, Failed, LayerSink};
use crate::surface::tiff_volume::{self, Dialect};
use crate::surface::{local, nifti, three_mf};

/// Open outputs.
#[derive(Default)]
pub struct Outputs {
    files: Vec<Output>,
    /// The scene that takes a mesh of the body too.
    scene: Option<SharedScene>,
    /// Where a small picture is kept.
    preview: Option<Preview>,
    /// The body on its way into the files.
    stream: Option<BodyStream<'static>>,
    /// Ends the writing.
    stop: Stop,
}

struct Output {
    target: PathBuf,
    format: Format,
    pending: Pending,
}

impl Outputs {
    /// Opens all outputs, and the report where one is wanted; they become some of the `places` that the run writes to.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written, or is that of an input or another output.
    pub fn open(paths: &[PathBuf], report: Option<&Path>, temporary: Temporary, places: &mut Places) -> Result<Self> {
        let mut outputs = Outputs::default();
        for path in paths {
            outputs.add(path, Format::of(path)?, temporary, places)?;
        }
        if let Some(path) = report {
            outputs.add(path, of_report(path)?, temporary, places)?;
        }
        Ok(outputs)
    }

    /// These outputs, with a mesh of the body for a scene of many.
    pub fn with_scene(self, scene: Option<&Scenes>) -> Self {
        Outputs { scene: scene.map(Scenes::share), ..self }
    }

    /// These outputs, and a small picture of the body that is no file of theirs: no byte of them depends on it.
    pub fn with_preview(self) -> Self {
        Outputs { preview: Some(Preview::default()), ..self }
    }

    /// These outputs, none of which gets its name once `stop` is asked for: every step then ends with [`Error::Interrupted`].
    pub fn until(self, stop: Stop) -> Self {
        Outputs { stop, ..self }
    }

    fn go_on(&self) -> Result<()> {
        if self.stop.is_asked() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// The small picture as PNG, when everything is complete.
    pub fn take_preview(&self) -> Option<Vec<u8>> {
        self.preview.as_ref().and_then(Preview::take)
    }

    fn add(&mut self, path: &Path, format: Format, temporary: Temporary, places: &mut Places) -> Result<()> {
        self.files.push(Output {
            target: path.into(),
            format,
            pending: Pending::open(path, format.is_folder(), temporary, places)?,
        });
        Ok(())
    }

    /// Refuses outputs that cannot be made of the input.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn check(&self, options: &OutputOptions) -> Result<()> {
        self.files.iter().try_for_each(|f| options.check(&f.target, f.format))
    }

    /// Bytes of memory that writing needs at most while layers of `dims` pixels that lie so arrive, and the body ends flat on at most `lid`
    /// pixels.
    pub fn bytes(&self, dims: [usize; 2], geometry: &Geometry, lid: usize) -> u64 {
        needed(self.formats(), dims, geometry, lid)
    }

    /// Formats of the files, and of those that hold many bodies.
    fn formats(&self) -> impl Iterator<Item = Format> {
        self.files.iter().map(|f| f.format).chain(self.scene.iter().flat_map(SharedScene::formats))
    }

    /// Whether there is a mesh among them.
    pub fn has_mesh(&self) -> bool {
        self.scene.is_some() || self.files.iter().any(|f| matches!(kind(&f.target), Ok(Kind::Mesh)))
    }

    /// Whether there is a completed RTSTRUCT among them.
    pub fn has_structures(&self) -> bool {
        self.files.iter().any(|f| f.format == Format::StructureSet)
    }

    /// Whether there is a report among them.
    pub fn has_report(&self) -> bool {
        self.files.iter().any(|f| matches!(f.format, Format::Report | Format::Html))
    }

    /// Takes the layers of a body and writes them under temporary names.
    pub fn sink(&mut self, options: &OutputOptions) -> impl LayerSink + '_ {
        Sink { outputs: self, content: options.content(), options: options.clone(), dims: [0; 2] }
    }

    /// Sink for layers of label numbers; `bodies` are the labels.
    pub fn label_sink<'o>(
        &'o mut self,
        numbers: Scalar,
        bodies: &[Appearance],
        options: &OutputOptions,
    ) -> impl LayerSink + 'o {
        let options =
            OutputOptions { bodies: bodies.to_vec(), target: options.target.clone(), ..OutputOptions::default() };
        Sink { outputs: self, content: Content::Labels(numbers), options, dims: [0; 2] }
    }

    /// Completes everything under temporary names, when the last layer has come. Where an output needs the surface, its volume and area are
    /// put into the report, and why meshes are no simpler.
    ///
    /// # Errors
    /// [`Error::Write`]; [`Error::Interrupted`].
    pub fn complete(&mut self, report: &mut Report) -> Result<()> {
        if let Some(stream) = self.stream.take() {
            let finished = stream.finish(report);
            self.go_on()?;
            finished.map_err(|failed| self.failed(failed))?;
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

    /// Origin of positions in meshes that hold them as f32; 0 where there is no such mesh.
    ///
    /// # Errors
    /// [`Error::Output`] where one of them cannot hold the body.
    fn origin(&self, header: &Header) -> Result<DVec3> {
        let file = self.files.iter().find(|f| f.format.is_single(Kind::Mesh)).map(|f| f.target.as_path());
        let Some(target) = file.or(self.scene.as_ref().and_then(SharedScene::single)) else { return Ok(DVec3::ZERO) };
        local::origin(header).map_err(|wide| {
            let message = format!("{wide}; {} hold 64 bits", places(Kind::Mesh, false));
            Error::Output { path: target.into(), message }
        })
    }

    fn failed(&self, (number, source): Failed) -> Error {
        // There are as many writers as files, behind them the scene's, and then that of the small picture.
        let target = self.files.get(number).map(|f| f.target.clone());
        let target = target.or_else(|| self.scene.as_ref().map(|scene| scene.target().into()));
        let path = target.or_else(|| self.files.first().map(|f| f.target.clone())).unwrap_or_default();
        Error::Write { path, source }
    }

    /// The outputs, by their names.
    pub fn targets(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|f| f.target.as_path())
    }

    /// The outputs and the temporary files, or folders, that will become them.
    pub fn temporary(&self) -> impl Iterator<Item = (&Path, &Path)> {
        self.files.iter().map(|f| (f.target.as_path(), f.pending.path()))
    }

    /// Renames everything.
    ///
    /// # Errors
    /// [`Error::Write`]; [`Error::Interrupted`] before the first.
    pub fn rename(self) -> Result<Vec<PathBuf>> {
        self.go_on()?;
        let mut written = Vec::new();
        for Output { target, pending, .. } in self.files {
            pending.rename().map_err(|source| Error::Write { path: target.clone(), source })?;
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

/// Note about the origin of positions in meshes for a person; nothing about the world's own.
fn moved(origin: DVec3) -> Option<String> {
    let DVec3 { x, y, z } = origin;
    let [single, double] = [true, false].map(|single| places(Kind::Mesh, single));
    (origin != DVec3::ZERO).then(|| {
        format!(
            "positions in {single} are 32-bit and relative to ({x}, {y}, {z}), or they would lose their shape; {double} are in world coordinates"
        )
    })
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
        let origin = self.outputs.origin(header)?;
        let meshes = Meshes::new(&self.options, origin, self.outputs.stop.clone());
        for output in &mut self.outputs.files {
            let Output { target, format, pending } = &mut *output;
            let writer = writer(target, *format, pending, header, self.content, &self.options, &meshes);
            writers.push(writer.map_err(|source| output.fails(source))?);
        }
        let scene = self.outputs.scene.as_ref();
        writers.extend(scene.map(|scene| meshes.writer(scene.write_mesh(&self.options, &header.unit, origin))));
        let target = self.outputs.files.first().map(|f| f.target.as_path()).or(scene.map(SharedScene::target));
        let folder = target.map_or(Path::new("."), parent);
        let single = self.outputs.files.iter().any(|f| f.format.is_single(Kind::Volume));
        let of_volumes = if single { nifti::told(header) } else { None };
        let of_volumes = of_volumes.map(|note| format!("{note}; {} do not", places(Kind::Volume, false)));
        let has = |wanted: Format| self.outputs.formats().any(|format| format == wanted);
        let of_3mf = if has(Format::ThreeMf) { three_mf::told(&header.unit) } else { None };
        let of_nifti = if has(Format::Nifti { gzip: false }) || has(Format::Nifti { gzip: true }) {
            nifti::told_unit(&header.unit)
        } else {
            None
        };
        let tiffs = [(Format::ImageJ, Dialect::ImageJ), (Format::OmeTiff, Dialect::Ome)];
        let of_tiff = tiffs.into_iter().filter(|(format, _)| has(*format));
        let of_tiff = of_tiff.filter_map(|(_, dialect)| tiff_volume::told(header, dialect));
        let notes = moved(origin).into_iter().chain(of_volumes).chain(of_3mf).chain(of_nifti).chain(of_tiff).collect();
        writers.extend(self.outputs.preview.as_ref().map(|preview| preview.writer(header)));
        let stream = BodyStream::new(header, writers, folder).telling(origin, notes);
        self.outputs.stream = Some(stream.until(self.outputs.stop.clone()));
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        self.outputs.go_on()?;
        let layer = match &self.options.map {
            Some(map) => map.layer(&layer),
            None => layer,
        };
        match &mut self.outputs.stream {
            Some(stream) => stream.layer(&layer).map_err(|failed| self.outputs.failed(failed)),
            None => Ok(()),
        }
    }
}
