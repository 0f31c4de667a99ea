//! A surface kept until its end: in memory while it is small, else in a nameless file. Formats that begin with counts, or list vertices
//! before triangles, are written from it in several passes.

use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use tempfile::SpooledTempFile;

use super::marching::Piece;
use super::mesh::{EachTriangle, EachVertex, MeshSource, Vertex, cross, sub, unit};

/// Bytes kept in memory.
pub(crate) const IN_MEMORY: usize = 64 << 20;
const BUFFER: usize = 1 << 20;

/// A surface, slab after slab. A slab is stored as the numbers of its vertices and triangles (u64), the vertices (position and normal, f64)
/// and the triangles (u32, counted from the first vertex of the slab below).
#[derive(Debug)]
pub struct Spool {
    file: BufWriter<SpooledTempFile>,
    /// Vertices and triangles.
    counts: [u64; 2],
    slabs: u64,
    /// The last slab: the triangles above it still turn its normals.
    last: Slab,
    /// Number of its first vertex.
    start: u64,
}

/// A slab of the surface.
#[derive(Debug, Default)]
struct Slab {
    vertices: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
}

impl Spool {
    /// An empty surface. Its file, if there must be one, is in `folder` and has no name.
    pub fn new(folder: &Path) -> Self {
        let file = BufWriter::with_capacity(BUFFER, tempfile::spooled_tempfile_in(IN_MEMORY, folder));
        Spool { file, counts: [0; 2], slabs: 0, last: Slab::default(), start: 0 }
    }

    /// Adds the next slab.
    ///
    /// # Errors
    /// Those of the file.
    pub fn push(&mut self, piece: &Piece) -> io::Result<()> {
        let vertex = |position: &[f64; 3]| Vertex { position: *position, normal: [0.0; 3] };
        let mut slab = Slab { vertices: piece.positions().iter().map(vertex).collect(), triangles: Vec::new() };
        for (t, [a, b, c]) in piece.triangles().iter().zip(piece.corners()) {
            let n = cross(sub(b, a), sub(c, a));
            for &v in t {
                let (own, at) = piece.place(v);
                let sum = if own == 1 { &mut slab.vertices[at].normal } else { &mut self.last.vertices[at].normal };
                *sum = [sum[0] + n[0], sum[1] + n[1], sum[2] + n[2]];
            }
            slab.triangles.push(t.map(|v| (v - self.start) as u32));
        }
        self.start += self.last.vertices.len() as u64;
        let below = std::mem::replace(&mut self.last, slab);
        self.write(&below)
    }

    /// The surface ends here.
    ///
    /// # Errors
    /// Those of the file.
    pub fn finish(&mut self) -> io::Result<()> {
        let last = std::mem::take(&mut self.last);
        self.write(&last)?;
        self.file.flush()
    }

    fn write(&mut self, slab: &Slab) -> io::Result<()> {
        let counts = [slab.vertices.len() as u64, slab.triangles.len() as u64];
        (0..2).for_each(|k| self.counts[k] += counts[k]);
        self.slabs += 1;
        counts.iter().try_for_each(|n| self.file.write_all(&n.to_le_bytes()))?;
        for v in &slab.vertices {
            let normal = unit(v.normal);
            v.position.iter().chain(&normal).try_for_each(|x| self.file.write_all(&x.to_le_bytes()))?;
        }
        slab.triangles.as_flattened().iter().try_for_each(|v| self.file.write_all(&v.to_le_bytes()))
    }

    /// Whether it has left memory.
    pub fn is_on_disk(&self) -> bool {
        self.file.get_ref().is_rolled()
    }

    /// Passes over all slabs: the number of the first vertex of the slab below, that slab, the slab.
    fn pass(&mut self, each: &mut dyn FnMut(u64, &Slab, &Slab) -> io::Result<()>) -> io::Result<()> {
        let file = self.file.get_mut();
        file.rewind()?;
        let mut file = BufReader::with_capacity(BUFFER, file);
        let (mut start, mut below, mut slab) = (0, Slab::default(), Slab::default());
        for _ in 0..self.slabs {
            slab.read(&mut file)?;
            each(start, &below, &slab)?;
            start += below.vertices.len() as u64;
            std::mem::swap(&mut below, &mut slab);
        }
        Ok(())
    }
}

impl Slab {
    fn read(&mut self, file: &mut impl Read) -> io::Result<()> {
        let mut eight = || -> io::Result<[u8; 8]> {
            let mut bytes = [0; 8];
            file.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        let [vertices, triangles] = [u64::from_le_bytes(eight()?), u64::from_le_bytes(eight()?)];
        self.vertices.clear();
        for _ in 0..vertices {
            let mut x = [0.0; 6];
            for x in &mut x {
                *x = f64::from_le_bytes(eight()?);
            }
            let [px, py, pz, nx, ny, nz] = x;
            self.vertices.push(Vertex { position: [px, py, pz], normal: [nx, ny, nz] });
        }
        self.triangles.clear();
        for _ in 0..triangles {
            let mut t = [[0; 4]; 3];
            file.read_exact(t.as_flattened_mut())?;
            self.triangles.push(t.map(u32::from_le_bytes));
        }
        Ok(())
    }
}

impl MeshSource for Spool {
    fn counts(&self) -> [u64; 2] {
        self.counts
    }

    fn vertices(&mut self, each: &mut EachVertex<'_>) -> io::Result<()> {
        self.pass(&mut |_, _, slab| slab.vertices.iter().try_for_each(&mut *each))
    }

    fn triangles(&mut self, each: &mut EachTriangle<'_>) -> io::Result<()> {
        self.pass(&mut |start, below, slab| {
            let of = |v: u32| {
                let v = v as usize;
                below.vertices.get(v).unwrap_or_else(|| &slab.vertices[v - below.vertices.len()])
            };
            slab.triangles.iter().try_for_each(|t| each(t.map(|v| start + u64::from(v)), t.map(of)))
        })
    }
}
