//! Voxels of a body that was cut across x or y of its input: the layers wait in a nameless file and are read back in the input's axis order,
//! a block at a time, so that the volume need not fit in memory.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use super::content::Content;
use super::header::Header;
use super::voxels::VoxelGrid;

/// Bytes that are read back at a time, more only where a row of the volume has more.
pub(crate) const BLOCK_BYTES: usize = 32 << 20;
/// Bytes of the buffer in front of the file.
pub(crate) const BUFFER_BYTES: usize = 1 << 20;

/// Layers in, rows of the volume out.
pub(super) struct Transposed {
    file: BufWriter<File>,
    /// Voxels along the volume's axes, the first runs fastest.
    dims: [usize; 3],
    /// The volume's axes along which the layers' columns, rows and heights run.
    order: [usize; 3],
    /// Bytes of a voxel.
    size: usize,
    /// Bytes that have come.
    bytes: u64,
}

impl Transposed {
    /// A volume without layers yet. Its file is in `folder`.
    ///
    /// # Errors
    /// The errors of making the file.
    pub fn new(body: &Header, content: Content, folder: &Path) -> io::Result<Self> {
        let VoxelGrid { dims, order, .. } = VoxelGrid::of(body);
        let file = BufWriter::with_capacity(BUFFER_BYTES, tempfile::tempfile_in(folder)?);
        Ok(Transposed { file, dims, order, size: content.size(), bytes: 0 })
    }

    /// Adds the next layer.
    ///
    /// # Errors
    /// The errors of the file.
    pub fn push(&mut self, layer: &[u8]) -> io::Result<()> {
        self.bytes += layer.len() as u64;
        self.file.write_all(layer)
    }

    /// All rows of the volume, in its order.
    ///
    /// # Errors
    /// The errors of the file and of `each`; too few or too many layers.
    pub fn rows(&mut self, mut each: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        let expected = self.dims.iter().map(|n| *n as u64).product::<u64>() * self.size as u64;
        if self.bytes != expected {
            return Err(io::Error::other(format!("{} of {expected} bytes of voxels have come", self.bytes)));
        }
        if expected == 0 {
            return Ok(());
        }
        self.file.flush()?;
        let [nx, ny, nz] = self.dims;
        let rows = (BLOCK_BYTES / (nx * self.size)).max(1);
        let [high, deep] = [rows.min(ny), (rows / ny).clamp(1, nz)];
        let (mut block, mut row) = (Vec::new(), Vec::new());
        for z in (0..nz).step_by(deep) {
            for y in (0..ny).step_by(high) {
                let part = [0..nx, y..(y + high).min(ny), z..(z + deep).min(nz)];
                self.read(&part, &mut block)?;
                self.turn(&part, &block, &mut row, &mut each)?;
            }
        }
        Ok(())
    }

    /// Reads a part of the volume as it lies in the layers.
    fn read(&mut self, part: &[Range<usize>; 3], block: &mut Vec<u8>) -> io::Result<()> {
        let [i, j, k] = self.order.map(|axis| part[axis].clone());
        let [columns, rows, _] = self.order.map(|axis| self.dims[axis]);
        let run = i.len() * self.size;
        // Whole rows are neighbours.
        let (runs, run) = if i.len() == columns { (1, run * j.len()) } else { (j.len(), run) };
        block.resize(run * runs * k.len(), 0);
        let mut layers = k.flat_map(|k| (0..runs).map(move |n| (k, n)));
        let file = self.file.get_mut();
        block.chunks_exact_mut(run).try_for_each(|bytes| {
            let Some((k, n)) = layers.next() else { return Ok(()) };
            let voxel = (k * rows + j.start + n) * columns + i.start;
            file.seek(SeekFrom::Start((voxel * self.size) as u64))?;
            file.read_exact(bytes)
        })
    }

    /// Hands on the rows of a part.
    fn turn(
        &self,
        part: &[Range<usize>; 3],
        block: &[u8],
        row: &mut Vec<u8>,
        each: &mut impl FnMut(&[u8]) -> io::Result<()>,
    ) -> io::Result<()> {
        // How far apart neighbours along the volume's axes lie in the block.
        let mut strides = [0; 3];
        let mut stride = self.size;
        for axis in self.order {
            strides[axis] = stride;
            stride *= part[axis].len();
        }
        let [x, y, z] = part.each_ref().map(ExactSizeIterator::len);
        for start in (0..z).flat_map(|c| (0..y).map(move |b| b * strides[1] + c * strides[2])) {
            row.clear();
            let voxels = block[start..].chunks(strides[0]).take(x);
            voxels.for_each(|voxel| row.extend_from_slice(&voxel[..self.size]));
            each(row)?;
        }
        Ok(())
    }
}
