//! The writer of each format.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

use glam::DVec3;

use super::format::{BUFFER_BYTES, Format, extension_at, named_content};
use super::options::OutputOptions;
use super::pending::{Made, Pending, parent};
use crate::progress::Stop;
#[cfg(feature = "dicom")]
use crate::rtstruct::StructuresWriter;
use crate::stack::appearance::Appearance;
use crate::storage::folders::files_below;
use crate::surface::content::{Content, Paint};
use crate::surface::contour_lines::ContoursWriter;
use crate::surface::geojson::GeoJsonWriter;
use crate::surface::glb::{About, write_glb};
use crate::surface::groups::write_group;
use crate::surface::header::Header;
use crate::surface::heightmap::HeightMapWriter;
use crate::surface::html::HtmlWriter;
use crate::surface::map::Crs;
use crate::surface::mesh::MeshSource;
use crate::surface::mesh_files::{ListedWriter, StlWriter, WriteMesh, write_obj, write_ply, write_stl};
use crate::surface::mha::MhaWriter;
use crate::surface::origin::OriginWriter;
use crate::surface::render::{PictureWriter, RenderOptions};
#[cfg(feature = "simplify")]
use crate::surface::spool::Spool;
use crate::surface::stream::{BodyWriter, Ending, WriterNeeds};
use crate::surface::three_mf::write_3mf;
use crate::surface::tiff_volume::Dialect;
use crate::surface::vtk::{VtiWriter, write_vtp};
use crate::surface::{nifti, npy, nrrd, tiff_volume};

/// The writer of an output, from its beginning.
pub(super) fn writer(
    target: &Path,
    format: Format,
    pending: &mut Pending,
    header: &Header,
    content: Content,
    options: &OutputOptions,
    meshes: &Meshes,
) -> io::Result<Box<dyn BodyWriter>> {
    let origin = meshes.origin;
    let folder = parent(target);
    let content = named_content(target).filter(|_| !matches!(content, Content::Labels(_))).unwrap_or(content);
    let body = header;
    let like = options.target.as_ref().filter(|_| format.is_on_grid());
    let frame = like.map(|like| like.grid.frame(&body.geometry)).transpose().map_err(io::Error::other)?;
    let on_grid = frame.as_ref().map(|frame| frame.header(body));
    let header = on_grid.as_ref().unwrap_or(body);
    let placed = |writer: Box<dyn BodyWriter>| match &frame {
        Some(frame) => frame.writer(writer, body, matches!(content, Content::Labels(_))),
        None => writer,
    };
    let volume = |writer: Box<dyn BodyWriter>| -> Box<dyn BodyWriter> {
        let writer = frame.iter().fold(writer, |writer, frame| frame.turned(writer));
        placed(match content {
            Content::Distance | Content::Mask(_) | Content::Labels(_) => writer,
            Content::Origin | Content::Confidence => Box::new(OriginWriter::new(writer, content, folder)),
        })
    };
    let file = match &mut pending.made {
        Made::File(file, _) => file.as_file_mut(),
        Made::Folder(folder, _) => return in_folder(folder.path(), header, content, &options.bodies).map(volume),
    };
    let mut file = file.try_clone()?;
    file.set_len(0)?;
    file.rewind()?;
    let out = BufWriter::with_capacity(BUFFER_BYTES, file);
    Ok(match format {
        Format::Nrrd => volume(Box::new(nrrd::writer(out, header, content, &options.bodies, folder)?)),
        Format::Segments => {
            // Segments have voxels, not distances.
            let content = if content == Content::Distance { Content::Mask(Paint::default()) } else { content };
            let title = stem(target);
            volume(Box::new(nrrd::segments(out, header, content, &options.bodies, &title, folder)?))
        }
        Format::ImageJ | Format::OmeTiff => {
            let dialect = if format == Format::OmeTiff { Dialect::Ome } else { Dialect::ImageJ };
            volume(Box::new(tiff_volume::writer(out, header, content, dialect, &stem(target), folder)?))
        }
        Format::Npy => volume(Box::new(npy::writer(out, header, content, folder)?)),
        Format::Npz => volume(Box::new(npy::packed(out, header, content, folder)?)),
        Format::Nifti { gzip } => volume(Box::new(nifti::writer(out, header, content, gzip, folder)?)),
        Format::Mha => volume(Box::new(MhaWriter::new(out, header, content, folder)?)),
        Format::Vti => volume(Box::new(VtiWriter::new(out, header, content, folder)?)),
        Format::Stl if options.simplify.is_none() => Box::new(StlWriter::new(out, origin)?),
        Format::Stl => meshes.writer(written(out, move |out, mesh| write_stl(out, mesh, origin))),
        Format::Ply => meshes.writer(written(out, write_ply)),
        Format::Obj => meshes.writer(written(out, write_obj)),
        Format::Glb | Format::ObjGroups | Format::ThreeMf | Format::Vtp => {
            let appearance = options.bodies.first().cloned().unwrap_or_default();
            let appearance = Appearance { name: appearance.name.or_else(|| Some(stem(target))), ..appearance };
            let about = About { appearance, unit: header.unit.clone(), origin, frame: options.frame() };
            let write = match format {
                Format::ObjGroups => write_group,
                Format::ThreeMf => write_3mf,
                Format::Vtp => write_vtp,
                _ => write_glb,
            };
            meshes.writer(written(out, move |out, mesh| write(out, mesh, &about)))
        }
        Format::Png => {
            let options = RenderOptions { contours: options.contours, ..RenderOptions::default() };
            Box::new(PictureWriter::new(out, header, options))
        }
        Format::Dem => placed(Box::new(HeightMapWriter::new(out, header, body, options.map.as_deref()))),
        Format::Report => Box::new(ReportWriter(out)),
        Format::Html => Box::new(HtmlWriter::new(out, header, stem(target), options.simplify)),
        Format::Contours => Box::new(ContoursWriter::new(out, header)?),
        Format::GeoJson => {
            let crs = options.map.as_ref().map_or(&Crs::Unknown, |map| &map.crs);
            Box::new(GeoJsonWriter::new(out, header, crs)?)
        }
        Format::StructureSet => return structures(out, header, options),
        Format::Zarr => return Err(io::Error::other("a folder is needed")),
    })
}

/// An output's name without its extension, as a title.
fn stem(target: &Path) -> String {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    name[..extension_at(&name)].to_string()
}

/// A mesh's way into `out`.
fn written(
    mut out: BufWriter<File>,
    mut format: impl FnMut(&mut BufWriter<File>, &mut dyn MeshSource) -> io::Result<()> + Send + 'static,
) -> WriteMesh {
    Box::new(move |mesh| format(&mut out, mesh))
}

/// The meshes of a run: the whole one, or one simpler one for all files.
pub(super) struct Meshes {
    /// Origin of positions where a format holds them as f32.
    origin: DVec3,
    #[cfg(feature = "simplify")]
    simplifier: Option<std::sync::Arc<crate::surface::simplify::Simplifier>>,
}

impl Meshes {
    #[cfg_attr(not(feature = "simplify"), expect(unused_variables, reason = "options have been checked"))]
    pub fn new(options: &OutputOptions, origin: DVec3, stop: Stop) -> Self {
        Meshes {
            origin,
            #[cfg(feature = "simplify")]
            simplifier: options.simplify.map(|error| crate::surface::simplify::Simplifier::new(error, stop).into()),
        }
    }

    /// The writer of a mesh that `write` takes.
    pub fn writer(&self, write: WriteMesh) -> Box<dyn BodyWriter> {
        #[cfg(feature = "simplify")]
        if let Some(simplifier) = self.simplifier.clone() {
            return Box::new(SimplerWriter { write, simplifier });
        }
        Box::new(ListedWriter(write))
    }
}

/// Writes the simpler mesh, or where there is none the whole one.
#[cfg(feature = "simplify")]
struct SimplerWriter {
    write: WriteMesh,
    simplifier: std::sync::Arc<crate::surface::simplify::Simplifier>,
}

#[cfg(feature = "simplify")]
impl BodyWriter for SimplerWriter {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Mesh
    }

    fn shows_surface(&self) -> bool {
        true
    }

    fn prepare(&mut self, mesh: &mut Spool) -> io::Result<Option<String>> {
        Ok(self.simplifier.simpler(mesh)?.map_or_else(Some, |simpler| simpler.warning()))
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        match self.simplifier.simpler(end.mesh)? {
            Ok(simpler) => (self.write)(&mut &*simpler.mesh),
            Err(_) => (self.write)(end.mesh),
        }
    }
}

/// The writer of a completed RTSTRUCT.
#[cfg(feature = "dicom")]
fn structures(out: BufWriter<File>, header: &Header, options: &OutputOptions) -> io::Result<Box<dyn BodyWriter>> {
    let source = options.source.as_ref().ok_or_else(|| io::Error::other("no RTSTRUCT was read"))?;
    Ok(Box::new(StructuresWriter::new(out, source, header).map_err(io::Error::other)?))
}

#[cfg(not(feature = "dicom"))]
fn structures(_: BufWriter<File>, _: &Header, _: &OutputOptions) -> io::Result<Box<dyn BodyWriter>> {
    Err(io::Error::other("this program was built without DICOM (feature `dicom`)"))
}

/// The writer of a Zarr into a folder, which is emptied.
fn in_folder(
    folder: &Path,
    header: &Header,
    content: Content,
    labels: &[Appearance],
) -> io::Result<Box<dyn BodyWriter>> {
    for file in files_below(folder)? {
        fs::remove_file(file)?;
    }
    #[cfg(feature = "zarr")]
    return crate::surface::zarr::writer(folder, header, content, labels);
    #[cfg(not(feature = "zarr"))]
    {
        let _ = (header, content, labels);
        Err(io::Error::other("this program was built without Zarr (feature `zarr`)"))
    }
}

/// Writes the report, at the end.
struct ReportWriter(BufWriter<File>);

impl BodyWriter for ReportWriter {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Surface
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut self.0, end.report)?;
        self.0.write_all(b"\n")?;
        self.0.flush()
    }
}
