//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::report::Report;
use crate::surface::heightmap::HeightMapWriter;
use crate::surface::mesh_files::{ListedWriter, StlWriter};
use crate::surface::render::{PictureWriter, RenderOptions};
use crate::surface::stream::{BodyStream, BodyWriter, Ending, Failed, Header, LayerSink, Needs};
use crate::surface::volume::Content;
use crate::surface::{Layer, nifti, nrrd};

/// What a file holds, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Nrrd,
    Nifti { gzip: bool },
    Stl,
    Ply,
    Obj,
    Png,
    Tiff,
    Report,
}

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .stl, .ply, .obj, .png (picture), .tif (height map), .json (report)";

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
            Some("png") => Ok(Format::Png),
            Some("tif" | "tiff") => Ok(Format::Tiff),
            Some("json") => Ok(Format::Report),
            _ => Err(Error::Output { path: path.into(), message: format!("unknown extension; expected {KNOWN}") }),
        }
    }
}

/// Whether `path` can be an output by its name, and is no folder.
///
/// # Errors
/// [`Error::Output`] with what was expected.
pub fn check_name(path: &Path) -> Result<()> {
    Format::of(path)?;
    match path.is_dir() {
        true => Err(Error::Output { path: path.into(), message: "is a folder".into() }),
        false => Ok(()),
    }
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
}

/// Names of temporary files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Temporary {
    /// Never two alike: any number of runs may write to one folder.
    Random,
    /// The same every time, so that what a killed run has left is written over. For a caller that lets nobody else make this output.
    Fixed,
}

/// Open outputs.
#[derive(Default)]
pub struct Outputs {
    files: Vec<Pending>,
    /// The body on its way into the files.
    stream: Option<BodyStream<'static>>,
}

#[derive(Debug)]
struct Pending {
    target: PathBuf,
    format: Format,
    file: NamedTempFile,
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
        if path.is_dir() {
            return fail("is a folder".into());
        }
        let folder = folder(path);
        let mut builder = tempfile::Builder::new();
        builder.prefix(".interslice-").suffix(".tmp");
        let fixed;
        if temporary == Temporary::Fixed {
            // The target's own name may be as long as names can be.
            let name = path.file_name().unwrap_or_default().as_encoded_bytes();
            fixed = format!(".interslice-{}", &blake3::hash(name).to_hex()[..32]);
            builder.prefix(&fixed).rand_bytes(0);
            match fs::remove_file(folder.join(format!("{fixed}.tmp"))) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return fail(format!("its temporary file: {e}")),
                _ => {}
            }
        }
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the umask, as any new file
        match builder.tempfile_in(folder) {
            Ok(file) => self.files.push(Pending { target: path.into(), format, file }),
            Err(e) => return fail(format!("in folder {}: {e}", folder.display())),
        }
        Ok(())
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
        }
        for pending in &self.files {
            pending
                .file
                .as_file()
                .sync_all()
                .map_err(|source| Error::Write { path: pending.target.clone(), source })?;
        }
        Ok(())
    }

    fn failed(&self, (number, source): Failed) -> Error {
        // There are as many writers as files.
        Error::Write { path: self.files.get(number).map(|f| f.target.clone()).unwrap_or_default(), source }
    }

    /// The outputs and the temporary files that will become them.
    pub fn temporary(&self) -> impl Iterator<Item = (&Path, &Path)> {
        self.files.iter().map(|f| (f.target.as_path(), f.file.path()))
    }

    /// Renames everything.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn rename(self) -> Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        for pending in self.files {
            let target = pending.target;
            pending.file.persist(&target).map_err(|e| Error::Write { path: target.clone(), source: e.error })?;
            written.push(target);
        }
        Ok(written)
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
        for pending in &mut self.outputs.files {
            let writer = writer(pending, header, self.options);
            writers.push(writer.map_err(|source| Error::Write { path: pending.target.clone(), source })?);
        }
        let folder = self.outputs.files.first().map_or(Path::new("."), |f| folder(&f.target));
        self.outputs.stream = Some(BodyStream::new(header, writers, folder));
        Ok(())
    }

    fn layer(&mut self, layer: Layer) -> Result<()> {
        match &mut self.outputs.stream {
            Some(stream) => stream.layer(&layer).map_err(|failed| self.outputs.failed(failed)),
            None => Ok(()),
        }
    }
}

/// The folder of a file.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The writer of a file, from its beginning.
fn writer(pending: &mut Pending, header: &Header, options: &OutputOptions) -> io::Result<Box<dyn BodyWriter>> {
    let mut file = pending.file.as_file().try_clone()?;
    file.set_len(0)?;
    file.rewind()?;
    let out = BufWriter::with_capacity(1 << 20, file);
    let content = if options.mask { Content::Mask } else { Content::Distance };
    Ok(match pending.format {
        Format::Nrrd => Box::new(nrrd::writer(out, header, content)?),
        Format::Nifti { gzip } => Box::new(nifti::writer(out, header, content, gzip)?),
        Format::Stl => Box::new(StlWriter::new(out)?),
        Format::Ply => Box::new(ListedWriter::ply(out)),
        Format::Obj => Box::new(ListedWriter::obj(out)),
        Format::Png => {
            let options = RenderOptions { contours: options.contours, ..RenderOptions::default() };
            Box::new(PictureWriter::new(out, header, options))
        }
        Format::Tiff => Box::new(HeightMapWriter::new(out, header)),
        Format::Report => Box::new(ReportWriter(out)),
    })
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
