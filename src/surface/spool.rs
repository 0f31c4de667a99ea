//! A surface kept until its end: in memory while it is small, else in nameless files. Formats that begin with counts, or list vertices
//! before triangles, are written from it in several passes.

use std::collections::VecDeque;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use glam::DVec3;
use tempfile::SpooledTempFile;

use super::marching::Piece;
use super::mesh::{EachTriangle, EachVertex, MeshSource, Vertex};
use super::space::unit;

/// Bytes of a file kept in memory.
pub(crate) const FILE_IN_MEMORY: usize = 16 << 20;
/// Bytes that a surface keeps in memory, without the vertices that later triangles still turn.
pub(crate) const IN_MEMORY: usize = 2 * (FILE_IN_MEMORY + 2 * BUFFER);
const BUFFER: usize = 1 << 20;

/// A surface, piece after piece, in two files: the vertices (position and normal, f64), and for each piece how many vertices there are until
/// then, the first that it or a later one may need, its number of triangles (u64 each) and the triangles (u32, counted from that vertex).
#[derive(Debug)]
pub struct Spool {
    vertices: BufWriter<SpooledTempFile>,
    triangles: BufWriter<SpooledTempFile>,
    /// Vertices and triangles.
    counts: [u64; 2],
    pieces: u64,
    /// Vertices whose normals are not complete.
    open: SpoolWindow,
}

/// Vertices of a block of a window: more than the system's allocator keeps.
const BLOCK: usize = 1 << 15;

/// The last vertices, from a number on, in blocks that are given back one by one.
#[derive(Debug, Default)]
struct SpoolWindow {
    start: u64,
    end: u64,
    /// The first block begins with a vertex whose number is a multiple of a block.
    blocks: VecDeque<Vec<Vertex>>,
}

impl SpoolWindow {
    fn push(&mut self, vertex: Vertex) {
        if self.end.is_multiple_of(BLOCK as u64) {
            self.blocks.push_back(Vec::with_capacity(BLOCK));
        }
        if let Some(last) = self.blocks.back_mut() {
            last.push(vertex);
        }
        self.end += 1;
    }

    /// Block and place in it of a vertex.
    fn place(&self, vertex: u64) -> (usize, usize) {
        let block = BLOCK as u64;
        ((vertex / block - self.start / block) as usize, (vertex % block) as usize)
    }

    fn at(&self, vertex: u64) -> &Vertex {
        let (block, place) = self.place(vertex);
        &self.blocks[block][place]
    }

    fn at_mut(&mut self, vertex: u64) -> &mut Vertex {
        let (block, place) = self.place(vertex);
        &mut self.blocks[block][place]
    }

    /// Lets go of the vertices below number `first`, which `each` sees.
    fn leave(&mut self, first: u64, mut each: impl FnMut(&Vertex) -> io::Result<()>) -> io::Result<()> {
        while self.start < first.min(self.end) {
            each(self.at(self.start))?;
            self.start += 1;
            if self.start.is_multiple_of(BLOCK as u64) {
                self.blocks.pop_front();
            }
        }
        Ok(())
    }
}

impl Spool {
    /// An empty surface. Its files, if there must be any, are in `folder` and have no names.
    pub fn new(folder: &Path) -> Self {
        let file = || BufWriter::with_capacity(BUFFER, tempfile::spooled_tempfile_in(FILE_IN_MEMORY, folder));
        Spool { vertices: file(), triangles: file(), counts: [0; 2], pieces: 0, open: SpoolWindow::default() }
    }

    /// Adds the next piece.
    ///
    /// # Errors
    /// The errors of the files.
    pub fn push(&mut self, piece: &Piece) -> io::Result<()> {
        let start = self.open.start;
        let vertex = |position: &DVec3| Vertex { position: *position, normal: DVec3::ZERO };
        piece.positions().iter().map(vertex).for_each(|v| self.open.push(v));
        let count = piece.triangles().count() as u64;
        [self.open.end, start, count].iter().try_for_each(|n| self.triangles.write_all(&n.to_le_bytes()))?;
        for (t, [a, b, c]) in piece.triangles().zip(piece.corners()) {
            let n = (b - a).cross(c - a);
            for v in t {
                self.open.at_mut(v).normal += n;
                self.triangles.write_all(&((v - start) as u32).to_le_bytes())?;
            }
        }
        self.pieces += 1;
        self.counts = [self.open.end, self.counts[1] + count];
        self.write(piece.settled())
    }

    /// The surface ends here.
    ///
    /// # Errors
    /// The errors of the files.
    pub fn finish(&mut self) -> io::Result<()> {
        self.write(u64::MAX)?;
        self.open = SpoolWindow::default();
        self.vertices.flush()?;
        self.triangles.flush()
    }

    /// Writes the vertices below number `first`, whose normals are complete.
    fn write(&mut self, first: u64) -> io::Result<()> {
        let file = &mut self.vertices;
        self.open.leave(first, |v| {
            let six = [v.position, unit(v.normal)].map(|v| v.to_array().map(f64::to_le_bytes));
            file.write_all(six.as_flattened().as_flattened())
        })
    }

    /// Whether it has left memory.
    pub fn is_on_disk(&self) -> bool {
        self.vertices.get_ref().is_rolled()
    }
}

/// A file from its beginning.
fn from_beginning(file: &mut BufWriter<SpooledTempFile>) -> io::Result<impl Read> {
    file.get_mut().rewind()?;
    Ok(BufReader::with_capacity(BUFFER, file.get_mut()))
}

fn read_number(file: &mut impl Read) -> io::Result<u64> {
    let mut bytes = [0; 8];
    file.read_exact(&mut bytes)?;
    Ok(u64::from_le_bytes(bytes))
}

fn read_vertex(file: &mut impl Read) -> io::Result<Vertex> {
    let mut three = || -> io::Result<DVec3> {
        let mut bytes = [[0; 8]; 3];
        file.read_exact(bytes.as_flattened_mut())?;
        Ok(bytes.map(f64::from_le_bytes).into())
    };
    Ok(Vertex { position: three()?, normal: three()? })
}

impl MeshSource for Spool {
    fn counts(&self) -> [u64; 2] {
        self.counts
    }

    fn vertices(&mut self, each: &mut EachVertex<'_>) -> io::Result<()> {
        let mut file = from_beginning(&mut self.vertices)?;
        (0..self.counts[0]).try_for_each(|_| each(&read_vertex(&mut file)?))
    }

    fn triangles(&mut self, each: &mut EachTriangle<'_>) -> io::Result<()> {
        let mut vertices = from_beginning(&mut self.vertices)?;
        let mut triangles = from_beginning(&mut self.triangles)?;
        let mut window = SpoolWindow::default();
        for _ in 0..self.pieces {
            let [end, start, count] = [(); 3].map(|()| read_number(&mut triangles));
            let (end, start, count) = (end?, start?, count?);
            while window.end < end {
                window.push(read_vertex(&mut vertices)?);
            }
            window.leave(start, |_| Ok(()))?;
            for _ in 0..count {
                let mut t = [[0; 4]; 3];
                triangles.read_exact(t.as_flattened_mut())?;
                let numbers = t.map(|v| start + u64::from(u32::from_le_bytes(v)));
                each(numbers, numbers.map(|v| window.at(v)))?;
            }
        }
        Ok(())
    }
}
