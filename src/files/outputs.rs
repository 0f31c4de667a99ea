//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
#[cfg(feature = "dicom")]
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::surface::mesh::{Mesh, closed_surface};
use crate::surface::nrrd::Content;
use crate::surface::render::{RenderOptions, write_png};
use crate::surface::{Reconstruction, contour_lines, heightmap, mesh_files, nifti, nrrd};

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
    Contours,
    StructureSet,
}

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .stl, .ply, .obj, .png (picture), .tif (height map), .contours.json, .dcm (completed RTSTRUCT), .json (report)";

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
            Some("dcm") => Ok(Format::StructureSet),
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

    /// The RTSTRUCT that was read, for a completed one
    #[cfg(feature = "dicom")]
    #[arg(skip)]
    #[serde(skip)]
    pub source: Option<Arc<crate::rtstruct::Source>>,
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
#[derive(Debug, Default)]
pub struct Outputs {
    files: Vec<Pending>,
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
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
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

    /// Whether any output needs the mesh.
    fn need_mesh(&self) -> bool {
        self.files
            .iter()
            .any(|f| matches!(f.format, Format::Stl | Format::Ply | Format::Obj | Format::Png | Format::Report))
    }

    /// Writes everything under temporary names. Where an output needs the surface, its volume and area are put into the report.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn complete(&mut self, body: &mut Reconstruction, options: &OutputOptions) -> Result<()> {
        let mesh = if self.need_mesh() { measured_surface(body) } else { Mesh::default() };
        self.fill(|out, format| write_one(out, format, body, &mesh, options))
    }

    /// Writes one completed RTSTRUCT, to which several reconstructions have added.
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "dicom")]
    pub fn complete_structures(
        &mut self,
        set: &crate::rtstruct::StructureSet,
        added: &[crate::rtstruct::Added],
    ) -> Result<()> {
        self.fill(|out, _| set.write_completed(out, added))
    }

    fn fill(&mut self, mut write: impl FnMut(&mut BufWriter<&mut File>, Format) -> io::Result<()>) -> Result<()> {
        for pending in &mut self.files {
            let fail = |source| Error::Write { path: pending.target.clone(), source };
            let mut out = BufWriter::with_capacity(1 << 20, pending.file.as_file_mut());
            write(&mut out, pending.format).map_err(fail)?;
            out.flush().map_err(fail)?;
            drop(out);
            pending.file.as_file().sync_all().map_err(fail)?;
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

/// The surface, with its measures put into the report.
fn measured_surface(body: &mut Reconstruction) -> Mesh {
    let mesh = closed_surface(body);
    body.report.volume = Some(mesh.volume());
    body.report.area = Some(mesh.area());
    mesh
}

fn write_one(
    out: &mut (impl Write + Seek),
    format: Format,
    body: &Reconstruction,
    mesh: &Mesh,
    options: &OutputOptions,
) -> io::Result<()> {
    let content = if options.mask { Content::Mask } else { Content::Distance };
    match format {
        Format::Nrrd => nrrd::write(out, body, content),
        Format::Nifti { gzip } => nifti::write(out, body, content, gzip),
        Format::Stl => mesh_files::write_stl(out, mesh),
        Format::Ply => mesh_files::write_ply(out, mesh),
        Format::Obj => mesh_files::write_obj(out, mesh),
        Format::Png => {
            write_png(out, body, mesh, RenderOptions { contours: options.contours, ..RenderOptions::default() })
        }
        Format::Tiff => heightmap::write_tiff(out, body),
        Format::Contours => contour_lines::write_json(out, body),
        Format::StructureSet => write_structures(out, body, options),
        Format::Report => {
            serde_json::to_writer_pretty(&mut *out, &body.report)?;
            out.write_all(b"\n")
        }
    }
}

#[cfg(feature = "dicom")]
fn write_structures(out: &mut impl Write, body: &Reconstruction, options: &OutputOptions) -> io::Result<()> {
    let Some(source) = &options.source else { return Err(io::ErrorKind::InvalidInput.into()) };
    let added = source.added(body).map_err(io::Error::other)?;
    source.set.write_completed(out, added.as_slice())
}

#[cfg(not(feature = "dicom"))]
fn write_structures(_: &mut impl Write, _: &Reconstruction, _: &OutputOptions) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}
