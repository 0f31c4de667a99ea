//! Volumes as NRRD with an attached header (teem's nrrd format 0004): signed distances, masks or labels, gzip.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::content::{Content, Scalar};
use super::deflate::Deflate;
use super::header::Header;
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;
use crate::stack::appearance::Appearance;

/// A writer of the output layers. Space is left-posterior-superior; origin and directions place the volume where its input was. Layers that
/// lie across x or y of the volume wait in a nameless file in `folder`. Where the volume is one of labels and some of `labels` has a name, they
/// are 3D Slicer's segments.
///
/// # Errors
/// The errors of `out` and that file.
pub fn writer<W: Write>(
    mut out: W,
    body: &Header,
    content: Content,
    labels: &[Appearance],
    folder: &Path,
) -> io::Result<VolumeWriter<W>> {
    let grid = VoxelGrid::of(body);
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let direction = |axis: usize| vector(grid.step(axis));
    let [nx, ny, nz] = grid.dims;
    let kind = match content.scalar() {
        Scalar::U8 => "uint8",
        Scalar::I8 => "int8",
        Scalar::U16 => "uint16",
        Scalar::I16 => "int16",
        Scalar::U32 => "uint32",
        Scalar::I32 => "int32",
        Scalar::U64 => "uint64",
        Scalar::I64 => "int64",
        Scalar::F32 => "float",
        Scalar::F64 => "double",
    };
    let unit = body.unit.replace(['"', '\n', '\r'], " ");
    write!(
        out,
        "NRRD0004\n# interslice {version}\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {x} {y} {z}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space units: \"{unit}\" \"{unit}\" \"{unit}\"\nspace origin: {origin}\n",
        version = env!("CARGO_PKG_VERSION"),
        x = direction(0),
        y = direction(1),
        z = direction(2),
        origin = vector(grid.origin),
    )?;
    if matches!(content, Content::Labels(_)) && labels.iter().any(|label| label.name.is_some()) {
        write_segments(&mut out, labels)?;
    }
    out.write_all(b"\n")?;
    VolumeWriter::new(Coded::Deflate(Deflate::gzip(out)), body, content, folder)
}

/// Key/value pairs as 3D Slicer's `.seg.nrrd` has them.
fn write_segments<W: Write>(out: &mut W, labels: &[Appearance]) -> io::Result<()> {
    writeln!(out, "Segmentation_MasterRepresentation:=Binary labelmap")?;
    writeln!(out, "Segmentation_ContainedRepresentationNames:=Binary labelmap|")?;
    for (k, label) in labels.iter().enumerate() {
        let Some(number) = label.number else { continue };
        let name = label.name.clone().unwrap_or_else(|| number.to_string());
        let name = name.replace('\\', "\\\\").replace(['\n', '\r'], " ");
        write!(out, "Segment{k}_ID:=Segment_{number}\nSegment{k}_Name:={name}\nSegment{k}_LabelValue:={number}\n")?;
        writeln!(out, "Segment{k}_Layer:=0")?;
        if let Some(colour) = label.colour {
            let [r, g, b] = colour.map(|c| f64::from(c) / 255.0);
            writeln!(out, "Segment{k}_Color:={r:.6} {g:.6} {b:.6}")?;
        }
    }
    Ok(())
}
