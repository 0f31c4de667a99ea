//! Volumes as NRRD with an attached header (teem's nrrd format 0004): float signed distance or 8-bit mask, gzip.

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::Reconstruction;
use super::mesh::to_world;

/// What a volume holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// u8, 1 inside and 0 outside.
    Mask,
}

/// Voxels of the output layers as little-endian bytes, x fastest.
pub(super) fn write_voxels(out: &mut impl Write, body: &Reconstruction, content: Content) -> io::Result<()> {
    let mut bytes = Vec::new();
    for layer in body.output_layers() {
        bytes.clear();
        match content {
            Content::Distance => layer.phi.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes())),
            Content::Mask => bytes.extend(layer.phi.iter().map(|v| u8::from(*v < 0.0))),
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes the output layers. Space is left-posterior-superior; origin and directions place the volume where its input was.
///
/// # Errors
/// Those of `out`.
pub fn write(mut out: impl Write, body: &Reconstruction, content: Content) -> io::Result<()> {
    let (count, first, step) = body.output_grid();
    let g = &body.geometry;
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let direction = |axis: usize, h: f64| vector(g.axes[axis].map(|v| v * h));
    let origin = to_world(g, [0.0, 0.0, first]);
    let kind = if content == Content::Distance { "float" } else { "uint8" };
    let unit = body.unit.replace(['"', '\n', '\r'], " ");
    write!(
        out,
        "NRRD0004\n# interslice {version}\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {count}\n\
         space directions: {x} {y} {z}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace origin: {origin}\n\n",
        version = env!("CARGO_PKG_VERSION"),
        nx = body.dims[0],
        ny = body.dims[1],
        x = direction(0, body.spacing[0]),
        y = direction(1, body.spacing[1]),
        z = direction(2, step),
        origin = vector(origin),
    )?;
    let mut gzip = GzEncoder::new(out, Compression::fast());
    write_voxels(&mut gzip, body, content)?;
    gzip.finish()?.flush()
}
