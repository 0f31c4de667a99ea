//! Volumes as NRRD with an attached header (teem's nrrd format 0004): signed distances, masks or labels, gzip.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::content::{Content, Scalar};
use super::deflate::Deflate;
use super::glb::colour::shown;
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
    write_header(&mut out, body, content)?;
    let painted = matches!(content, Content::Labels(_) | Content::Mask(_));
    if painted && labels.iter().any(|label| label.name.is_some()) {
        write_segments(&mut out, body, &numbered(content, labels), "")?;
    }
    begin(out, body, content, folder)
}

/// The same as 3D Slicer's `.seg.nrrd`: every label is a segment, with its number as name where it has none; a body that has no name either is
/// called `title`.
///
/// # Errors
/// The errors of [`writer`].
pub fn segments<W: Write>(
    mut out: W,
    body: &Header,
    content: Content,
    labels: &[Appearance],
    title: &str,
    folder: &Path,
) -> io::Result<VolumeWriter<W>> {
    write_header(&mut out, body, content)?;
    write_segments(&mut out, body, &numbered(content, labels), title)?;
    begin(out, body, content, folder)
}

/// The labels with the numbers that their voxels have; a mask is one label.
fn numbered(content: Content, labels: &[Appearance]) -> Vec<Appearance> {
    match content {
        Content::Mask(paint) => {
            let only = labels.first().filter(|_| labels.len() == 1).cloned();
            vec![Appearance { number: Some(paint.value), ..only.unwrap_or_default() }]
        }
        _ => labels.to_vec(),
    }
}

fn begin<W: Write>(mut out: W, body: &Header, content: Content, folder: &Path) -> io::Result<VolumeWriter<W>> {
    out.write_all(b"\n")?;
    VolumeWriter::new(Coded::Deflate(Deflate::gzip(out)), body, content, folder)
}

fn write_header<W: Write>(out: &mut W, body: &Header, content: Content) -> io::Result<()> {
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
    )
}

/// Key/value pairs as 3D Slicer's `.seg.nrrd` has them. A label without a name is called `title`, or by its number where that is empty.
fn write_segments<W: Write>(out: &mut W, body: &Header, labels: &[Appearance], title: &str) -> io::Result<()> {
    writeln!(out, "Segmentation_ContainedRepresentationNames:=Binary labelmap|")?;
    writeln!(out, "Segmentation_MasterRepresentation:=Binary labelmap")?;
    writeln!(out, "Segmentation_ReferenceImageExtentOffset:=0 0 0")?;
    let [x, y, z] = VoxelGrid::of(body).dims.map(|n| n.saturating_sub(1));
    let alone = labels.len() == 1 && !title.is_empty();
    for (k, label) in labels.iter().enumerate() {
        let Some(number) = label.number else { continue };
        let unnamed = || if alone { title.to_string() } else { number.to_string() };
        let name = label.name.clone().unwrap_or_else(unnamed);
        let known = label.segment.clone().unwrap_or_default();
        let id = known.id.unwrap_or_else(|| format!("Segment_{number}"));
        let [name, id, tags] = [name, id, known.tags.unwrap_or_else(|| "|".into())].map(|text| escaped(&text));
        let auto = [label.name.is_none(), label.colour.is_none()].map(u8::from);
        let [r, g, b] = shown(label);
        write!(
            out,
            "Segment{k}_Color:={r:.6} {g:.6} {b:.6}\nSegment{k}_ColorAutoGenerated:={auto_colour}\nSegment{k}_Extent:=0 {x} 0 {y} 0 {z}\n\
             Segment{k}_ID:={id}\nSegment{k}_LabelValue:={number}\nSegment{k}_Layer:=0\nSegment{k}_Name:={name}\n\
             Segment{k}_NameAutoGenerated:={auto_name}\nSegment{k}_Tags:={tags}\n",
            auto_name = auto[0],
            auto_colour = auto[1],
        )?;
    }
    Ok(())
}

/// A value on one line, as NRRD escapes it.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace(['\n', '\r'], " ")
}
