//! Output files: opened before the work starts under a temporary name beside their target, renamed when all are complete. Whatever
//! fails before leaves what the user had as it was.

use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use interslice::surface::mesh::{Mesh, closed_surface};
use interslice::surface::nrrd::Content;
use interslice::surface::render::{RenderOptions, write_png};
use interslice::surface::{heightmap, mesh_files, nifti, nrrd};
use interslice::{Error, Reconstruction, Result};
use tempfile::NamedTempFile;

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

const KNOWN: &str = ".nrrd, .nii, .nii.gz, .stl, .ply, .obj, .png (picture), .tif (height map)";

impl Format {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        if name.ends_with(".nii.gz") {
            return Some(Format::Nifti { gzip: true });
        }
        match name.rsplit_once('.')?.1 {
            "nrrd" => Some(Format::Nrrd),
            "nii" => Some(Format::Nifti { gzip: false }),
            "stl" => Some(Format::Stl),
            "ply" => Some(Format::Ply),
            "obj" => Some(Format::Obj),
            "png" => Some(Format::Png),
            "tif" | "tiff" => Some(Format::Tiff),
            _ => None,
        }
    }
}

/// How outputs are made.
#[derive(Debug, Clone, Copy)]
pub struct OutputOptions {
    /// Volumes hold 8-bit masks.
    pub mask: bool,
    /// Pictures show the input contours.
    pub contours: bool,
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
    pub fn open(paths: &[PathBuf], report: Option<&Path>) -> Result<Self> {
        let mut outputs = Outputs::default();
        for path in paths {
            let format = Format::of(path).ok_or_else(|| Error::Output {
                path: path.clone(),
                message: format!("unknown extension; expected {KNOWN}"),
            })?;
            outputs.add(path, format)?;
        }
        if let Some(path) = report {
            outputs.add(path, Format::Report)?;
        }
        Ok(outputs)
    }

    fn add(&mut self, path: &Path, format: Format) -> Result<()> {
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
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the umask, as any new file
        match builder.tempfile_in(folder) {
            Ok(file) => self.files.push(Pending { target: path.into(), format, file }),
            Err(e) => return fail(format!("in folder {}: {e}", folder.display())),
        }
        Ok(())
    }

    /// Whether any output needs the mesh.
    pub fn need_mesh(&self) -> bool {
        self.files
            .iter()
            .any(|f| matches!(f.format, Format::Stl | Format::Ply | Format::Obj | Format::Png | Format::Report))
    }

    /// Writes everything, then renames everything.
    pub fn write(mut self, body: &Reconstruction, mesh: &Mesh, options: OutputOptions) -> Result<Vec<PathBuf>> {
        for pending in &mut self.files {
            let fail = |source| Error::Write { path: pending.target.clone(), source };
            let mut out = BufWriter::with_capacity(1 << 20, pending.file.as_file_mut());
            write_one(&mut out, pending.format, body, mesh, options).map_err(fail)?;
            out.flush().map_err(fail)?;
            drop(out);
            pending.file.as_file().sync_all().map_err(fail)?;
        }
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
pub fn measured_surface(body: &mut Reconstruction) -> Mesh {
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
    options: OutputOptions,
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
        Format::Report => {
            serde_json::to_writer_pretty(&mut *out, &body.report)?;
            out.write_all(b"\n")
        }
    }
}
