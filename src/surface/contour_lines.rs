//! The closed lines at which layers cross zero, and layers as polygons in JSON (the schema of a `stack.json` with polygons).

use std::io::{self, Write};

use glam::{DVec2, DVec3};
use serde::Serialize;

use super::Layer;
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use crate::contour::seeds::trace_loops;
use crate::grid::field::Field;
use crate::grid::sparse_image::SQUARE;
use crate::polygons::Polygon;
use crate::stack::Geometry;

/// The closed contour lines of a layer, pixels: marching squares with linear crossings; in a saddle cell the mean of the four corners says
/// which are joined. The inside lies to the left in a frame with y upward: lines around a part turn counter-clockwise, those around a hole
/// clockwise. Where the body touches the image's border, its line runs half a pixel beyond.
pub fn contour_lines(layer: &Layer, [nx, ny]: [usize; 2]) -> Vec<Polygon> {
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    for square in layer.phi.each_square() {
        if layer.phi.whole(square).is_some_and(|v| v >= 0.0) {
            continue;
        }
        for (j, row) in layer.phi.of_square(square).enumerate() {
            for (i, _) in row.iter().enumerate().filter(|(_, v)| **v < 0.0) {
                let at = [square[0] * SQUARE + i, square[1] * SQUARE + j];
                (0..2).for_each(|a| (low[a], high[a]) = (low[a].min(at[a]), high[a].max(at[a])));
            }
        }
    }
    if low[0] > high[0] {
        return Vec::new();
    }
    // The box around the inside and one ring of outside; beyond the image the border's own pixels count, as outside.
    let dims = [0, 1].map(|a| high[a] - low[a] + 3);
    let field = Field::from_fn(dims, |i, j| {
        let [x, y] = [(low[0] + i).wrapping_sub(1), (low[1] + j).wrapping_sub(1)];
        let (cx, cy) = ((low[0] + i).saturating_sub(1).min(nx - 1), (low[1] + j).saturating_sub(1).min(ny - 1));
        let v = f64::from(layer.phi.at(cx, cy));
        if [x, y] == [cx, cy] { v } else { v.abs() }
    });
    let first = DVec2::from(low.map(|n| n as f64));
    trace_loops(&field).into_iter().map(|path| path.into_iter().map(|c| c.x + first - 1.0).collect()).collect()
}

/// Coordinates along the axes of a geometry from the world's origin: `u a0 + v a1 + w a2` is the point `i dx, j dy, z` of the stack.
#[derive(Debug, Clone, Copy)]
pub struct AlongAxes {
    spacing: DVec2,
    origin: DVec3,
}

impl AlongAxes {
    /// The coordinates of a stack's geometry and pixel sides.
    pub fn new(geometry: &Geometry, spacing: [f64; 2]) -> Self {
        AlongAxes { spacing: spacing.into(), origin: solve(geometry.axes, geometry.origin) }
    }

    /// A position in pixels.
    pub fn point(&self, x: DVec2) -> DVec2 {
        self.origin.truncate() + x * self.spacing
    }

    /// A height of the stack.
    pub fn height(&self, z: f64) -> f64 {
        self.origin.z + z
    }
}

/// Solution of `u a0 + v a1 + w a2 = p` (Cramer); the axes are nearly perpendicular.
fn solve([x, y, z]: [DVec3; 3], p: DVec3) -> DVec3 {
    let det = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c));
    DVec3::new(det(p, y, z), det(x, p, z), det(x, y, p)) / det(x, y, z)
}

/// Beginning of a file of contour lines, before its slices.
#[derive(Serialize)]
struct Head<'a> {
    unit: &'a str,
    spacing_xy: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    axes: Option<[DVec3; 3]>,
}

#[derive(Serialize)]
struct DrawnSlice {
    z: f64,
    polygons: Vec<Polygon>,
}

/// Writes the contour lines of the output layers as these arrive. Coordinates are the world's (LPS), along `axes` where these are not the
/// world's own.
pub struct ContoursWriter<W> {
    out: W,
    dims: [usize; 2],
    along: AlongAxes,
    slices: usize,
}

impl<W: Write> ContoursWriter<W> {
    /// The file as far as the slices.
    ///
    /// # Errors
    /// The errors of `out`.
    pub fn new(mut out: W, header: &Header) -> io::Result<Self> {
        let straight = header.geometry.axes == Geometry::default().axes;
        let axes = (!straight).then_some(header.geometry.axes);
        let head = serde_json::to_string(&Head { unit: &header.unit, spacing_xy: header.spacing, axes })?;
        write!(out, "{},\"slices\":[", head.trim_end_matches('}'))?;
        let along = AlongAxes::new(&header.geometry, header.spacing);
        Ok(ContoursWriter { out, dims: header.dims, along, slices: 0 })
    }
}

impl<W: Write + Send> BodyWriter for ContoursWriter<W> {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if !layer.output {
            return Ok(());
        }
        let line = |path: Polygon| path.into_iter().map(|x| self.along.point(x)).collect();
        let polygons = contour_lines(layer, self.dims).into_iter().map(line).collect();
        if self.slices > 0 {
            self.out.write_all(b",")?;
        }
        self.slices += 1;
        serde_json::to_writer(&mut self.out, &DrawnSlice { z: self.along.height(layer.z), polygons })?;
        Ok(())
    }

    fn finish(&mut self, _end: &mut Ending<'_>) -> io::Result<()> {
        self.out.write_all(b"]}\n")?;
        self.out.flush()
    }
}
