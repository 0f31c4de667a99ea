//! Volumes as NRRD with an attached header (teem's nrrd format 0004): float signed distance or 8-bit mask, gzip.

use std::io::{self, Write};
use std::path::Path;

use super::stream::Header;
use super::volume::{Coded, Content, Scalar, VolumeWriter};
use super::voxels::VoxelGrid;

/// A writer of the output layers. Space is left-posterior-superior; origin and directions place the volume where its input was. Layers that
/// lie across x or y of the volume wait in a nameless file in `folder`.
///
/// # Errors
/// Those of `out` and that file.
pub fn writer<W: Write>(mut out: W, body: &Header, content: Content, folder: &Path) -> io::Result<VolumeWriter<W>> {
    let grid = VoxelGrid::of(body);
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let direction = |axis: usize| vector(grid.step(axis));
    let [nx, ny, nz] = grid.dims;
    let kind = match content.scalar() {
        Scalar::F32 => "float",
        Scalar::U8 => "uint8",
        Scalar::U16 => "uint16",
        Scalar::I32 => "int32",
    };
    let unit = body.unit.replace(['"', '\n', '\r'], " ");
    write!(
        out,
        "NRRD0004\n# interslice {version}\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {x} {y} {z}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace origin: {origin}\n\n",
        version = env!("CARGO_PKG_VERSION"),
        x = direction(0),
        y = direction(1),
        z = direction(2),
        origin = vector(grid.origin),
    )?;
    VolumeWriter::new(Coded::gzip(out), body, content, folder)
}
