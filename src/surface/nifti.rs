//! Volumes as NIfTI-1 (`.nii`, `.nii.gz`): signed distances, masks or labels, geometry in the sform, RAS.

use std::io::{self, Write};
use std::path::Path;

use super::content::{Content, Scalar};
use super::deflate::Deflate;
use super::header::Header;
use super::length::plain;
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;

/// Part of a voxel by which a volume may lie elsewhere without a word.
const ROUNDED: f64 = 0.01;

/// Size of header and empty extension block.
const DATA_OFFSET: usize = 352;

/// A writer of the output layers, compressed where `gzip` says so. Layers that lie across x or y of the volume wait in a nameless file in
/// `folder`.
///
/// # Errors
/// The errors of `out` and that file; [`io::ErrorKind::InvalidInput`] where an axis has more than 32767 voxels, which the format cannot hold.
pub fn writer<W: Write>(
    out: W,
    body: &Header,
    content: Content,
    gzip: bool,
    folder: &Path,
) -> io::Result<VolumeWriter<W>> {
    let grid = VoxelGrid::of(body);
    let header = header(&grid, body, content)?;
    let mut out = if gzip { Coded::Deflate(Deflate::gzip(out)) } else { Coded::Raw(out) };
    out.write_all(&header)?;
    VolumeWriter::new(out, body, content, folder)
}

/// Note about the place of a volume for a person: the format holds that as f32.
pub fn told(body: &Header) -> Option<String> {
    let grid = VoxelGrid::of(body);
    let off = (grid.origin.as_vec3().as_dvec3() - grid.origin).abs().max_element();
    let part = off / grid.sides.iter().copied().fold(f64::INFINITY, f64::min);
    (part > ROUNDED).then(|| {
        format!(
            "NIfTI holds where a volume lies as 32-bit numbers: it lies {off:.2e} {} ({part:.2} voxels) off",
            body.unit
        )
    })
}

/// The format's number of a unit.
fn code(unit: &str) -> Option<u8> {
    let numbers = [("m", 1), ("mm", 2), ("um", 3)];
    numbers.into_iter().find(|(name, _)| *name == plain(unit)).map(|(_, number)| number)
}

/// Note for a person about a length that the format does not know; pixels are none.
pub fn told_unit(unit: &str) -> Option<String> {
    let known = code(unit).is_some() || ["px", ""].contains(&unit.trim());
    (!known)
        .then(|| format!("NIfTI does not know the unit {unit}: numbers are in {unit}, but programs take them as mm"))
}

fn header(grid: &VoxelGrid, body: &Header, content: Content) -> io::Result<Vec<u8>> {
    let mut h = vec![0u8; DATA_OFFSET];
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    let mut dim = [3i16, 0, 0, 0, 1, 1, 1, 1];
    for (slot, n) in dim[1..4].iter_mut().zip(grid.dims) {
        *slot = i16::try_from(n).map_err(|_| {
            io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("NIfTI-1 holds at most 32767 voxels along an axis; got {n}"),
            )
        })?;
    }
    dim.iter().enumerate().for_each(|(k, d)| put(40 + 2 * k, &d.to_le_bytes()));
    let (datatype, bits) = match content.scalar() {
        Scalar::U8 => (2i16, 8i16),
        Scalar::I8 => (256, 8),
        Scalar::U16 => (512, 16),
        Scalar::I16 => (4, 16),
        Scalar::U32 => (768, 32),
        Scalar::I32 => (8, 32),
        Scalar::U64 => (1280, 64),
        Scalar::I64 => (1024, 64),
        Scalar::F32 => (16, 32),
        Scalar::F64 => (64, 64),
    };
    put(70, &datatype.to_le_bytes());
    put(72, &bits.to_le_bytes());
    put(76, &1f32.to_le_bytes());
    grid.sides.iter().enumerate().for_each(|(k, s)| put(80 + 4 * k, &(*s as f32).to_le_bytes()));
    put(108, &(DATA_OFFSET as f32).to_le_bytes());
    put(112, &1f32.to_le_bytes()); // scl_slope
    put(123, &[code(&body.unit).unwrap_or(0)]);
    put(254, &body.geometry.space.code().to_le_bytes()); // sform_code
    for (row, offset) in grid.origin.to_array().into_iter().enumerate() {
        // LPS to RAS turns the first two axes.
        let sign = if row < 2 { -1.0 } else { 1.0 };
        let columns = (0..3).map(|axis| grid.step(axis)[row]);
        for (column, v) in columns.chain([offset]).enumerate() {
            put(280 + 16 * row + 4 * column, &((sign * v) as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_that_it_has_no_number_for_are_told() {
        assert_eq!(["m", "mm", "um", "\u{b5}m", "\u{3bc}m"].map(code), [1, 2, 3, 3, 3].map(Some));
        for unit in ["cm", "nm", "ft"] {
            assert!(told_unit(unit).is_some_and(|note| note.contains(unit)), "{unit}");
        }
        assert_eq!(["mm", "\u{b5}m", "px"].map(told_unit), [None, None, None]);
    }
}
