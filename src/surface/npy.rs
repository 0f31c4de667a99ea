//! Volumes as arrays of numpy, axes (z, y, x) in C order: `.npy`, or in a `.npz` with where they lie.

use std::io::{self, Seek, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::content::{Content, Scalar};
use super::header::Header;
use super::length::plain;
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;

/// Multiple of bytes at which voxels begin.
const ALIGNMENT: usize = 64;
/// Bytes of a `.npy` before its text.
const BEFORE: usize = 10;

/// The array of a `.npz` that holds the volume.
pub(crate) const VOLUME: &str = "volume";
/// Those beside it that say where it lies, of f64, and their sizes: voxel sides x, y, z; the first voxel (LPS); a unit vector a row, for x, y, z.
pub(crate) const PLACE: [(&str, &[usize]); 3] = [("spacing", &[3]), ("origin", &[3]), ("directions", &[3, 3])];
/// That of the unit of lengths, a text.
pub(crate) const UNIT: &str = "unit";

/// A writer of the output layers as `.npy`. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
///
/// # Errors
/// The errors of `out` and that file.
pub fn writer<W: Write>(mut out: W, body: &Header, content: Content, folder: &Path) -> io::Result<VolumeWriter<W>> {
    let [nx, ny, nz] = VoxelGrid::of(body).dims;
    out.write_all(&head(content.scalar(), &[nz, ny, nx]))?;
    VolumeWriter::new(Coded::Raw(out), body, content, folder)
}

/// A writer of the output layers as `.npz`: the array `volume`, as arrays of f64 `spacing` (x, y, z), `origin` (LPS) and `directions` (a unit vector a
/// row, for x, y, z), and the text `unit`. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
///
/// # Errors
/// The errors of `out` and that file.
pub fn packed<W: Write + Seek>(
    out: W,
    body: &Header,
    content: Content,
    folder: &Path,
) -> io::Result<VolumeWriter<Archive<W>>> {
    let grid = VoxelGrid::of(body);
    let mut archive = ZipWriter::new(out);
    let vectors = grid.axes.map(|axis| axis.to_array()).concat();
    let origin = grid.origin.to_array();
    let place: [&[f64]; 3] = [&grid.sides, &origin, &vectors];
    for ((name, shape), values) in PLACE.into_iter().zip(place) {
        archive.start_file(format!("{name}.npy"), options())?;
        archive.write_all(&head(Scalar::F64, shape))?;
        values.iter().try_for_each(|v| archive.write_all(&v.to_le_bytes()))?;
    }
    let unit: Vec<char> = plain(&body.unit).chars().collect();
    if !unit.is_empty() {
        archive.start_file(format!("{UNIT}.npy"), options())?;
        archive.write_all(&header(&format!("<U{}", unit.len()), &[]))?;
        unit.into_iter().try_for_each(|letter| archive.write_all(&u32::from(letter).to_le_bytes()))?;
    }
    archive.start_file(format!("{VOLUME}.npy"), options())?;
    let [nx, ny, nz] = grid.dims;
    archive.write_all(&head(content.scalar(), &[nz, ny, nx]))?;
    VolumeWriter::new(Coded::Raw(Archive(Some(archive))), body, content, folder)
}

/// Options of an archive's entry: packed, of any size, and without the time of day.
pub(super) fn options() -> SimpleFileOptions {
    let plain = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated).large_file(true);
    plain.last_modified_time(DateTime::default()).compression_level(Some(1))
}

/// An archive whose last entry is being written; a flush is its end.
pub struct Archive<W: Write + Seek>(Option<ZipWriter<W>>);

impl<W: Write + Seek> Write for Archive<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Some(archive) => archive.write(bytes),
            None => Err(io::Error::other("the archive has ended")),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.0.take() {
            Some(archive) => archive.finish()?.flush(),
            None => Ok(()),
        }
    }
}

/// Header of an array (format 1.0).
fn head(scalar: Scalar, shape: &[usize]) -> Vec<u8> {
    let kind = match scalar {
        Scalar::U8 => "|u1",
        Scalar::I8 => "|i1",
        Scalar::U16 => "<u2",
        Scalar::I16 => "<i2",
        Scalar::U32 => "<u4",
        Scalar::I32 => "<i4",
        Scalar::U64 => "<u8",
        Scalar::I64 => "<i8",
        Scalar::F32 => "<f4",
        Scalar::F64 => "<f8",
    };
    header(kind, shape)
}

/// Header of an array whose type numpy calls `kind`.
fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let sizes = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    // A tuple of one has a comma, too.
    let comma = if shape.len() == 1 { "," } else { "" };
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sizes}{comma}), }}");
    let length = (BEFORE + text.len() + 1).next_multiple_of(ALIGNMENT);
    text += &" ".repeat(length - BEFORE - text.len() - 1);
    text.push('\n');
    // At most three sizes: the text is short.
    [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_as_numpy_writes_them() {
        let head = head(Scalar::U16, &[3, 4, 5]);
        assert_eq!(head.len() % ALIGNMENT, 0);
        assert_eq!(&head[..10], b"\x93NUMPY\x01\x00\x76\x00");
        assert!(head[10..].starts_with(b"{'descr': '<u2', 'fortran_order': False, 'shape': (3, 4, 5), }   "));
        assert_eq!(head.last(), Some(&b'\n'));
    }
}
