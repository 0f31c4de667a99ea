//! Meshes as binary glTF 2.0 (`.glb`): for each body one mesh with its name and colour, f32 positions and normals, u32 triangles.
//!
//! Positions are those of all other outputs: world coordinates (LPS) in the stack's unit, so that files of one case fit each other. A node above
//! all bodies scales them to glTF's metres and turns y upwards where that is asked for ([`SceneFrame`]). The `extras` of meshes and scene say how
//! each lies: `unit` and `space`; `number` is that of the label or ROI. Far from the world's origin a mesh has one of its own, which its node adds again (`translation`), and `extras` name it too
//! (`origin`).

pub(in crate::surface) mod colour;
mod describe;
mod frame;
mod part;

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Seek, Write};
use std::path::Path;

use glam::DVec3;

use super::mesh::MeshSource;
use super::mesh_files::le_bytes;
use describe::described;
pub use frame::{SceneFrame, SceneUnit};
pub use part::About;
use part::MeshPart;

const BUFFER_BYTES: usize = 1 << 20;

/// Writes one mesh.
///
/// # Errors
/// The errors of `out`; [`io::ErrorKind::InvalidInput`] beyond the 4 GiB that the format holds.
pub fn write_glb<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
    let part = MeshPart::of(mesh, about)?;
    write_head(out, std::slice::from_ref(&part))?;
    write_data(out, mesh, about.origin)?;
    out.flush()
}

/// Writes everything before the meshes' own data.
fn write_head<W: Write>(out: &mut W, parts: &[MeshPart]) -> io::Result<()> {
    let bytes: u64 = parts.iter().map(MeshPart::bytes).sum();
    let mut json = serde_json::to_vec(&described(parts)?)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let whole = 12 + 8 + json.len() as u64 + if bytes > 0 { 8 + bytes } else { 0 };
    let length = |n: u64| {
        let fits = u32::try_from(n);
        fits.map_err(|_| {
            io::Error::new(io::ErrorKind::InvalidInput, "GLB holds at most 4 GiB: use another format, or --simplify")
        })
    };
    out.write_all(b"glTF")?;
    for n in [2, length(whole)?, length(json.len() as u64)?] {
        out.write_all(&n.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&json)?;
    if bytes > 0 {
        out.write_all(&length(bytes)?.to_le_bytes())?;
        out.write_all(b"BIN\0")?;
    }
    Ok(())
}

/// Positions, normals, triangles.
fn write_data<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, origin: DVec3) -> io::Result<()> {
    let mut three = |v: DVec3| out.write_all(&le_bytes(v.as_vec3()));
    mesh.vertices(&mut |v| three(v.position - origin))?;
    mesh.vertices(&mut |v| three(v.normal))?;
    mesh.triangles(&mut |t, _| out.write_all(t.map(|v| (v as u32).to_le_bytes()).as_flattened()))
}

/// Several bodies on their way into one file. Their data wait in a nameless file.
#[derive(Debug)]
pub struct GlbScene {
    parts: Vec<MeshPart>,
    data: BufWriter<File>,
}

impl GlbScene {
    /// A scene without meshes; its nameless file is in `folder`.
    ///
    /// # Errors
    /// The errors of making that file.
    pub fn new(folder: &Path) -> io::Result<Self> {
        let data = BufWriter::with_capacity(BUFFER_BYTES, tempfile::tempfile_in(folder)?);
        Ok(GlbScene { parts: Vec::new(), data })
    }

    /// Adds a body.
    ///
    /// # Errors
    /// The errors of the nameless file.
    pub fn add(&mut self, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
        self.parts.push(MeshPart::of(mesh, about)?);
        write_data(&mut self.data, mesh, about.origin)
    }

    /// Writes all bodies, in their order.
    ///
    /// # Errors
    /// The errors of [`write_glb`].
    pub fn write<W: Write>(&mut self, out: &mut W) -> io::Result<()> {
        write_head(out, &self.parts)?;
        self.data.flush()?;
        let file = self.data.get_mut();
        file.rewind()?;
        io::copy(&mut BufReader::with_capacity(BUFFER_BYTES, &mut *file), out)?;
        file.seek(io::SeekFrom::End(0))?;
        out.flush()
    }
}
