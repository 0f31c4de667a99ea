//! Volumes as NIfTI-1 (`.nii`, `.nii.gz`): float signed distance or 8-bit mask, geometry in the sform, RAS.

use std::io::{self, Write};

use super::mesh::to_world;
use super::stream::Header;
use super::volume::{Content, VolumeWriter};

/// Size of header and empty extension block.
const DATA_OFFSET: usize = 352;

/// A writer of the output layers, compressed where `gzip` says so.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::InvalidInput`] where an axis has more than 32767 voxels, which the format cannot hold.
pub fn writer<W: Write>(mut out: W, body: &Header, content: Content, gzip: bool) -> io::Result<VolumeWriter<W>> {
    let header = header(body, content)?;
    if gzip {
        return VolumeWriter::gzip(out, &header, content);
    }
    out.write_all(&header)?;
    Ok(VolumeWriter::raw(out, content))
}

fn header(body: &Header, content: Content) -> io::Result<Vec<u8>> {
    let mut h = vec![0u8; DATA_OFFSET];
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    let mut dim = [3i16, 0, 0, 0, 1, 1, 1, 1];
    for (slot, n) in dim[1..4].iter_mut().zip([body.dims[0], body.dims[1], body.grid.count]) {
        *slot = i16::try_from(n).map_err(|_| {
            io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("NIfTI-1 holds at most 32767 voxels along an axis; got {n}"),
            )
        })?;
    }
    dim.iter().enumerate().for_each(|(k, d)| put(40 + 2 * k, &d.to_le_bytes()));
    let (datatype, bits) = if content.is_float() { (16i16, 32i16) } else { (2, 8) };
    put(70, &datatype.to_le_bytes());
    put(72, &bits.to_le_bytes());
    let sides = [body.spacing[0], body.spacing[1], body.grid.step];
    put(76, &1f32.to_le_bytes());
    sides.iter().enumerate().for_each(|(k, s)| put(80 + 4 * k, &(*s as f32).to_le_bytes()));
    put(108, &(DATA_OFFSET as f32).to_le_bytes());
    put(112, &1f32.to_le_bytes()); // scl_slope
    let unit = match body.unit.as_str() {
        "m" => 1u8,
        "mm" => 2,
        "um" | "µm" => 3,
        _ => 0,
    };
    put(123, &[unit]);
    put(254, &1i16.to_le_bytes()); // sform_code: scanner
    let origin = to_world(&body.geometry, [0.0, 0.0, body.grid.start]);
    for (row, offset) in origin.iter().enumerate() {
        // LPS to RAS turns the first two axes.
        let sign = if row < 2 { -1.0 } else { 1.0 };
        let columns = body.geometry.axes.iter().zip(sides).map(|(axis, side)| axis[row] * side);
        for (column, v) in columns.chain([*offset]).enumerate() {
            put(280 + 16 * row + 4 * column, &((sign * v) as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(h)
}
