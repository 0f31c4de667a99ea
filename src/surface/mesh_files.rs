//! Meshes as binary STL, binary PLY and OBJ, in world coordinates.

use std::io::{self, Write};

use super::mesh::{Mesh, cross, length, sub};

/// Binary STL: f32 facets with their normals.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::InvalidInput`] beyond 2^32 triangles.
pub fn write_stl(mut out: impl Write, mesh: &Mesh) -> io::Result<()> {
    let mut header = [b' '; 80];
    let text = concat!("interslice ", env!("CARGO_PKG_VERSION"), ", binary STL");
    header[..text.len()].copy_from_slice(text.as_bytes());
    out.write_all(&header)?;
    let count = u32::try_from(mesh.triangles.len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "STL holds at most 2^32 triangles"))?;
    out.write_all(&count.to_le_bytes())?;
    let mut facet = Vec::with_capacity(50);
    for [a, b, c] in mesh.corners() {
        let n = cross(sub(b, a), sub(c, a));
        let l = length(n).max(f64::MIN_POSITIVE);
        facet.clear();
        for p in [n.map(|v| v / l), a, b, c] {
            facet.extend(p.iter().flat_map(|v| (*v as f32).to_le_bytes()));
        }
        facet.extend([0, 0]);
        out.write_all(&facet)?;
    }
    out.flush()
}

/// Binary little-endian PLY: f32 vertices with normals, triangles.
///
/// # Errors
/// Those of `out`.
pub fn write_ply(mut out: impl Write, mesh: &Mesh) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment interslice {}\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        env!("CARGO_PKG_VERSION"),
        mesh.positions.len(),
        mesh.triangles.len()
    )?;
    for (p, n) in mesh.positions.iter().zip(mesh.normals()) {
        let vertex: Vec<u8> = p.iter().chain(&n).flat_map(|v| (*v as f32).to_le_bytes()).collect();
        out.write_all(&vertex)?;
    }
    for t in &mesh.triangles {
        let mut face = [3u8; 13];
        for (k, v) in t.iter().enumerate() {
            face[1 + 4 * k..5 + 4 * k].copy_from_slice(&v.to_le_bytes());
        }
        out.write_all(&face)?;
    }
    out.flush()
}

/// Wavefront OBJ: vertices and normals as text.
///
/// # Errors
/// Those of `out`.
pub fn write_obj(mut out: impl Write, mesh: &Mesh) -> io::Result<()> {
    writeln!(out, "# interslice {}", env!("CARGO_PKG_VERSION"))?;
    for p in &mesh.positions {
        writeln!(out, "v {} {} {}", p[0] as f32, p[1] as f32, p[2] as f32)?;
    }
    for n in mesh.normals() {
        writeln!(out, "vn {:.5} {:.5} {:.5}", n[0], n[1], n[2])?;
    }
    for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| v + 1)) {
        writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
    }
    out.flush()
}
