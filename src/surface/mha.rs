//! Volumes as MetaImage (`.mha`): float signed distance or 8-bit mask, zlib, LPS.

use std::io::{self, Seek, SeekFrom, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::Reconstruction;
use super::voxels::{Content, VoxelGrid, write_voxels};

/// Digits that the header keeps free for the size of the compressed data.
const DIGITS: usize = 20;

/// Writes the output layers.
///
/// # Errors
/// Those of `out`.
pub fn write(mut out: impl Write + Seek, body: &Reconstruction, content: Content) -> io::Result<()> {
    let grid = VoxelGrid::of(body);
    let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let kind = if content == Content::Distance { "MET_FLOAT" } else { "MET_UCHAR" };
    let unit = body.unit.replace(['\n', '\r'], " ");
    let [nx, ny, nz] = grid.dims;
    write!(
        out,
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = True\n\
         TransformMatrix = {matrix}\nOffset = {origin}\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n\
         ElementSpacing = {sides}\nDistanceUnits = {unit}\nDimSize = {nx} {ny} {nz}\nElementType = {kind}\nCompressedDataSize = ",
        matrix = numbers(grid.axes.as_flattened()),
        origin = numbers(&grid.origin),
        sides = numbers(&grid.sides),
    )?;
    let size_at = out.stream_position()?;
    write!(out, "{:DIGITS$}\nElementDataFile = LOCAL\n", "")?;
    let start = out.stream_position()?;
    let mut zlib = ZlibEncoder::new(&mut out, Compression::fast());
    write_voxels(&mut zlib, body, content)?;
    zlib.finish()?;
    let end = out.stream_position()?;
    out.seek(SeekFrom::Start(size_at))?;
    write!(out, "{:<DIGITS$}", end - start)?;
    out.seek(SeekFrom::Start(end))?;
    out.flush()
}
