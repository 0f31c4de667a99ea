//! Volumes as NRRD with an attached header (teem's nrrd format 0004): float signed distance or 8-bit mask, gzip.

use std::io::{self, Write};

use super::mesh::to_world;
use super::stream::Header;
use super::volume::{Content, VolumeWriter};

/// A writer of the output layers. Space is left-posterior-superior; origin and directions place the volume where its input was.
///
/// # Errors
/// Those of `out`.
pub fn writer<W: Write>(mut out: W, body: &Header, content: Content) -> io::Result<VolumeWriter<W>> {
    let g = &body.geometry;
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let direction = |axis: usize, h: f64| vector(g.axes[axis].map(|v| v * h));
    let origin = to_world(g, [0.0, 0.0, body.grid.start]);
    let kind = if content.is_float() { "float" } else { "uint8" };
    let unit = body.unit.replace(['"', '\n', '\r'], " ");
    write!(
        out,
        "NRRD0004\n# interslice {version}\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {count}\n\
         space directions: {x} {y} {z}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace origin: {origin}\n\n",
        version = env!("CARGO_PKG_VERSION"),
        nx = body.dims[0],
        ny = body.dims[1],
        count = body.grid.count,
        x = direction(0, body.spacing[0]),
        y = direction(1, body.spacing[1]),
        z = direction(2, body.grid.step),
        origin = vector(origin),
    )?;
    VolumeWriter::gzip(out, &[], content)
}
