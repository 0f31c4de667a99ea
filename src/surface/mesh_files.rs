//! Meshes as binary STL, binary PLY and OBJ, in world coordinates: f64 in PLY and OBJ; f32 in STL, whose header names the origin where that is
//! not the world's.

use std::io::{self, Seek, SeekFrom, Write};

use glam::{DVec3, Vec3};

use super::marching::Piece;
use super::mesh::MeshSource;
use super::space::unit;
use super::stream::{BodyWriter, Ending, WriterNeeds};

/// Byte of a STL at which the number of its triangles stands.
const STL_COUNT: u64 = 80;

/// Binary STL: f32 facets with their normals, written as they arise; their number is filled in at the end.
pub struct StlWriter<W> {
    out: W,
    origin: DVec3,
    count: u64,
}

impl<W: Write + Seek> StlWriter<W> {
    /// Writes the header. Positions will be relative to `origin`, see [`local`](super::local).
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn new(mut out: W, origin: DVec3) -> io::Result<Self> {
        let mut header = [b' '; STL_COUNT as usize];
        let mut text = concat!("interslice ", env!("CARGO_PKG_VERSION"), ", binary STL").to_string();
        if origin != DVec3::ZERO {
            let [x, y, z] = origin.as_vec3().to_array().map(shorter);
            text += &format!(", origin {x} {y} {z}");
        }
        let length = text.len().min(header.len());
        header[..length].copy_from_slice(&text.as_bytes()[..length]);
        out.write_all(&header)?;
        out.write_all(&0u32.to_le_bytes())?;
        Ok(StlWriter { out, origin, count: 0 })
    }

    /// Writes triangles, given by their corners.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn facets(&mut self, corners: impl Iterator<Item = [DVec3; 3]>) -> io::Result<()> {
        let mut facet = Vec::with_capacity(50);
        for [a, b, c] in corners {
            facet.clear();
            let [p, q, r] = [a, b, c].map(|p| p - self.origin);
            for p in [unit((b - a).cross(c - a)), p, q, r] {
                facet.extend(le_bytes(p.as_vec3()));
            }
            facet.extend([0, 0]);
            self.out.write_all(&facet)?;
            self.count += 1;
        }
        Ok(())
    }

    /// Fills in the number of triangles.
    ///
    /// # Errors
    /// The errors of `out`; [`io::ErrorKind::InvalidInput`] beyond 2^32 triangles.
    pub fn close(&mut self) -> io::Result<()> {
        let count = u32::try_from(self.count).map_err(|_| too_many("STL holds at most 2^32 triangles"))?;
        self.out.seek(SeekFrom::Start(STL_COUNT))?;
        self.out.write_all(&count.to_le_bytes())?;
        self.out.seek(SeekFrom::End(0))?;
        self.out.flush()
    }

    /// Writer that it was written into.
    pub fn into_inner(self) -> W {
        self.out
    }
}

impl<W: Write + Seek + Send> BodyWriter for StlWriter<W> {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Surface
    }

    fn shows_surface(&self) -> bool {
        true
    }

    fn piece(&mut self, piece: &Piece) -> io::Result<()> {
        self.facets(piece.corners())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.close()
    }
}

/// Writes a whole mesh to where it belongs.
pub type WriteMesh = Box<dyn FnMut(&mut dyn MeshSource) -> io::Result<()> + Send>;

/// A format that begins with counts, or lists vertices before triangles; or one of a mesh that is made from the whole.
pub struct ListedWriter(pub WriteMesh);

impl BodyWriter for ListedWriter {
    fn needs(&self) -> WriterNeeds {
        WriterNeeds::Mesh
    }

    fn shows_surface(&self) -> bool {
        true
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        (self.0)(end.mesh)
    }
}

/// Three f32 as files have them.
pub(super) fn le_bytes(v: Vec3) -> [u8; 12] {
    bytemuck::cast(v.to_array().map(f32::to_le_bytes))
}

fn too_many(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what)
}

/// A number as text, in the shorter of two ways.
fn shorter(x: f32) -> String {
    let (plain, power) = (x.to_string(), format!("{x:e}"));
    if power.len() < plain.len() { power } else { plain }
}

/// Binary STL, as [`StlWriter`] writes it.
///
/// # Errors
/// The errors of [`StlWriter`].
pub fn write_stl<W: Write + Seek>(out: &mut W, mesh: &mut dyn MeshSource, origin: DVec3) -> io::Result<()> {
    let mut stl = StlWriter::new(out, origin)?;
    mesh.triangles(&mut |_, corners| stl.facets([corners.map(|v| v.position)].into_iter()))?;
    stl.close()
}

/// Binary little-endian PLY: f64 vertices with f32 normals, triangles.
///
/// # Errors
/// The errors of `out`; [`io::ErrorKind::InvalidInput`] beyond 2^31 vertices.
pub fn write_ply<W: Write>(out: &mut W, mesh: &mut dyn MeshSource) -> io::Result<()> {
    let [vertices, triangles] = mesh.counts();
    if vertices > 1 << 31 {
        return Err(too_many("PLY holds at most 2^31 vertices"));
    }
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment interslice {}\nelement vertex {vertices}\nproperty double x\nproperty double y\n\
         property double z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face {triangles}\n\
         property list uchar int vertex_indices\nend_header\n",
        env!("CARGO_PKG_VERSION"),
    )?;
    mesh.vertices(&mut |v| {
        out.write_all(v.position.to_array().map(f64::to_le_bytes).as_flattened())?;
        out.write_all(&le_bytes(v.normal.as_vec3()))
    })?;
    mesh.triangles(&mut |t, _| {
        let mut face = [3u8; 13];
        for (k, v) in t.iter().enumerate() {
            face[1 + 4 * k..5 + 4 * k].copy_from_slice(&(*v as u32).to_le_bytes());
        }
        out.write_all(&face)
    })?;
    out.flush()
}

/// Wavefront OBJ: vertices and normals as text, vertices with as many digits as tell an f64 from all others.
///
/// # Errors
/// The errors of `out`.
pub fn write_obj<W: Write>(out: &mut W, mesh: &mut dyn MeshSource) -> io::Result<()> {
    obj_head(out)?;
    write_obj_body(out, mesh, 0)?;
    out.flush()
}

pub(super) fn obj_head<W: Write>(out: &mut W) -> io::Result<()> {
    writeln!(out, "# interslice {}", env!("CARGO_PKG_VERSION"))
}

/// A mesh behind `before` vertices of others.
pub(super) fn write_obj_body<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, before: u64) -> io::Result<()> {
    mesh.vertices(&mut |v| {
        let DVec3 { x, y, z } = v.position;
        writeln!(out, "v {x} {y} {z}")
    })?;
    mesh.vertices(&mut |v| writeln!(out, "vn {:.5} {:.5} {:.5}", v.normal.x, v.normal.y, v.normal.z))?;
    mesh.triangles(&mut |t, _| {
        let [a, b, c] = t.map(|v| before + v + 1);
        writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")
    })
}
