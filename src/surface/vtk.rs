//! Meshes and volumes as VTK's XML files: `.vtp` (PolyData) and `.vti` (ImageData), data appended as they are (little-endian), behind an
//! underscore and the number of bytes each. World coordinates are LPS; the unit and the space stand in the field data.

use std::io::{self, Write};
use std::path::Path;

use super::Layer;
use super::content::{Content, Scalar};
use super::glb::About;
use super::header::Header;
use super::mesh::MeshSource;
use super::mesh_files::le_bytes;
use super::stream::{BodyWriter, Ending};
use super::volume::{Coded, VolumeWriter};
use super::voxels::VoxelGrid;

/// Bytes of a length, before the data that it counts.
const LENGTH: u64 = 8;
const TAIL: &[u8] = b"\n</AppendedData>\n</VTKFile>\n";

/// Writes a mesh: f64 points with f32 normals, triangles of i64.
///
/// # Errors
/// The errors of `out`.
pub fn write_vtp<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, about: &About) -> io::Result<()> {
    let [vertices, triangles] = mesh.counts();
    let lengths = [24 * vertices, 12 * vertices, 24 * triangles, 8 * triangles];
    let mut offset = 0;
    let [points, normals, corners, ends] = lengths.map(|length| {
        let at = offset;
        offset += LENGTH + length;
        at
    });
    head(out, "PolyData")?;
    let name = about.appearance.name.as_deref().unwrap_or_default();
    fields(out, &[("unit", &about.unit), ("space", "left-posterior-superior"), ("name", name)])?;
    write!(
        out,
        "<Piece NumberOfPoints=\"{vertices}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"{triangles}\">\n\
         <PointData Normals=\"Normals\">\n{}</PointData>\n<Points>\n{}</Points>\n<Polys>\n{}{}</Polys>\n</Piece>\n</PolyData>\n",
        array("Float32", "Normals", 3, normals),
        array("Float64", "Points", 3, points),
        array("Int64", "connectivity", 1, corners),
        array("Int64", "offsets", 1, ends),
    )?;
    out.write_all(b"<AppendedData encoding=\"raw\">\n_")?;
    out.write_all(&lengths[0].to_le_bytes())?;
    mesh.vertices(&mut |v| out.write_all(v.position.to_array().map(f64::to_le_bytes).as_flattened()))?;
    out.write_all(&lengths[1].to_le_bytes())?;
    mesh.vertices(&mut |v| out.write_all(&le_bytes(v.normal.as_vec3())))?;
    out.write_all(&lengths[2].to_le_bytes())?;
    mesh.triangles(&mut |t, _| out.write_all(t.map(u64::to_le_bytes).as_flattened()))?;
    out.write_all(&lengths[3].to_le_bytes())?;
    (1..=triangles).try_for_each(|n| out.write_all(&(3 * n).to_le_bytes()))?;
    out.write_all(TAIL)?;
    out.flush()
}

/// Writes the output layers as `.vti`.
pub struct VtiWriter<W: Write>(VolumeWriter<W>);

impl<W: Write> VtiWriter<W> {
    /// Writes the header. Layers that lie across x or y of the volume wait in a nameless file in `folder`.
    ///
    /// # Errors
    /// The errors of `out` and that file.
    pub fn new(mut out: W, body: &Header, content: Content, folder: &Path) -> io::Result<Self> {
        let grid = VoxelGrid::of(body);
        let (kind, name) = (kind(content.scalar()), name(content));
        let extent = grid.dims.map(|n| format!("0 {}", n.saturating_sub(1))).join(" ");
        let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        // A row for x, y, z of the world, a column for each axis.
        let direction: Vec<f64> = (0..3).flat_map(|row| grid.axes.map(|axis| axis[row])).collect();
        let place = format!(
            "WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\"",
            numbers(grid.origin.as_ref()),
            numbers(&grid.sides),
            numbers(&direction),
        );
        head(&mut out, &format!("ImageData {place}"))?;
        fields(&mut out, &[("unit", &body.unit), ("space", "left-posterior-superior")])?;
        write!(
            out,
            "<Piece Extent=\"{extent}\">\n<PointData Scalars=\"{name}\">\n{}</PointData>\n</Piece>\n</ImageData>\n\
             <AppendedData encoding=\"raw\">\n_",
            array(kind, name, 1, 0),
        )?;
        let bytes = grid.dims.iter().map(|n| *n as u64).product::<u64>() * content.size() as u64;
        out.write_all(&bytes.to_le_bytes())?;
        Ok(VtiWriter(VolumeWriter::new(Coded::Raw(out), body, content, folder)?))
    }
}

impl<W: Write + Send> BodyWriter for VtiWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        self.0.layer(layer)
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        let out = self.0.end()?;
        out.write_all(TAIL)?;
        out.flush()
    }
}

/// The beginning of a file up to the element of its data set, which is opened.
fn head<W: Write>(out: &mut W, element: &str) -> io::Result<()> {
    let kind = element.split(' ').next().unwrap_or_default();
    write!(
        out,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <!-- interslice {} -->\n<{element}>\n",
        env!("CARGO_PKG_VERSION")
    )
}

/// Words about the data, as arrays of a string each: the numbers of its bytes, and 0.
fn fields<W: Write>(out: &mut W, words: &[(&str, &str)]) -> io::Result<()> {
    out.write_all(b"<FieldData>\n")?;
    for (name, text) in words {
        let bytes: String = text.bytes().map(|b| format!("{b} ")).collect();
        writeln!(
            out,
            "<DataArray type=\"String\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">{bytes}0</DataArray>"
        )?;
    }
    out.write_all(b"</FieldData>\n")
}

fn array(kind: &str, name: &str, components: usize, offset: u64) -> String {
    format!(
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"{offset}\"/>\n"
    )
}

fn name(content: Content) -> &'static str {
    match content {
        Content::Distance => "distance",
        Content::Mask(_) => "mask",
        Content::Origin => "origin",
        Content::Confidence => "confidence",
        Content::Labels(_) => "labels",
    }
}

fn kind(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::U8 => "UInt8",
        Scalar::I8 => "Int8",
        Scalar::U16 => "UInt16",
        Scalar::I16 => "Int16",
        Scalar::U32 => "UInt32",
        Scalar::I32 => "Int32",
        Scalar::U64 => "UInt64",
        Scalar::I64 => "Int64",
        Scalar::F32 => "Float32",
        Scalar::F64 => "Float64",
    }
}
