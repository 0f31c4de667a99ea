//! Volumes as MetaImage (`.mha`): signed distances, masks or labels, zlib, LPS.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

use super::Layer;
use super::content::{Content, Scalar};
use super::deflate::Deflate;
use super::header::Header;
use super::length::plain;
use super::stream::{BodyWriter, Ending};
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;

/// Digits that the header keeps free for the size of the compressed data.
const DIGITS: usize = 20;

/// Writes the output layers.
pub struct MhaWriter<W: Write> {
    voxels: VolumeWriter<W>,
    /// Place in the header of the size of the compressed data, and the beginning of these.
    size_at: u64,
    start: u64,
}

impl<W: Write + Seek> MhaWriter<W> {
    /// Writes the header. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
    ///
    /// # Errors
    /// The errors of `out` and that file.
    pub fn new(mut out: W, body: &Header, content: Content, folder: &Path) -> io::Result<Self> {
        let grid = VoxelGrid::of(body);
        let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let kind = match content.scalar() {
            Scalar::U8 => "MET_UCHAR",
            Scalar::I8 => "MET_CHAR",
            Scalar::U16 => "MET_USHORT",
            Scalar::I16 => "MET_SHORT",
            Scalar::U32 => "MET_UINT",
            Scalar::I32 => "MET_INT",
            Scalar::U64 => "MET_ULONG_LONG",
            Scalar::I64 => "MET_LONG_LONG",
            Scalar::F32 => "MET_FLOAT",
            Scalar::F64 => "MET_DOUBLE",
        };
        let unit = plain(&body.unit);
        let [nx, ny, nz] = grid.dims;
        write!(
            out,
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = True\n\
             TransformMatrix = {matrix}\nOffset = {origin}\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n\
             ElementSpacing = {sides}\nDistanceUnits = {unit}\nDimSize = {nx} {ny} {nz}\nElementType = {kind}\nCompressedDataSize = ",
            matrix = numbers(&grid.axes.map(|axis| axis.to_array()).concat()),
            origin = numbers(grid.origin.as_ref()),
            sides = numbers(&grid.sides),
        )?;
        let size_at = out.stream_position()?;
        write!(out, "{:DIGITS$}\nElementDataFile = LOCAL\n", "")?;
        let start = out.stream_position()?;
        let voxels = VolumeWriter::new(Coded::Deflate(Deflate::zlib(out)), body, content, folder)?;
        Ok(MhaWriter { voxels, size_at, start })
    }
}

impl<W: Write + Seek + Send> BodyWriter for MhaWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        self.voxels.layer(layer)
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        let out = self.voxels.end()?;
        let end = out.stream_position()?;
        out.seek(SeekFrom::Start(self.size_at))?;
        write!(out, "{:<DIGITS$}", end - self.start)?;
        out.seek(SeekFrom::Start(end))?;
        out.flush()
    }
}
