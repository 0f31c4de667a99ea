//! Volumes as NRRD with an attached header (teem's nrrd format 0004): float signed distance or 8-bit mask, gzip.

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::Reconstruction;
use super::voxels::{Content, VoxelGrid, write_voxels};

/// Writes the output layers. Space is left-posterior-superior; origin and directions place the volume where its input was.
///
/// # Errors
/// Those of `out`.
pub fn write(mut out: impl Write, body: &Reconstruction, content: Content) -> io::Result<()> {
    let grid = VoxelGrid::of(body);
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let direction = |axis: usize| vector(grid.axes[axis].map(|v| v * grid.sides[axis]));
    let kind = if content == Content::Distance { "float" } else { "uint8" };
    let [nx, ny, nz] = grid.dims;
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
    let mut gzip = GzEncoder::new(out, Compression::fast());
    write_voxels(&mut gzip, body, content)?;
    gzip.finish()?.flush()
}
