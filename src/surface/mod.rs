//! What goes out: the reconstructed body as layers of signed distance, and one writer per format.

mod cases;
pub mod contour_lines;
pub mod heightmap;
pub mod mesh;
pub mod mesh_files;
pub mod nifti;
pub mod nrrd;
pub mod render;

use crate::report::Report;
use crate::stack::Geometry;

/// The body as in-plane signed distance on layers of increasing height.
///
/// Layers are the output heights, the heights of all input contours, and the two end planes. Between neighbouring layers the body
/// is what linear interpolation along z says; where it is still inside at `extent`, it is cut flat there.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// Pixels per layer, `[nx, ny]`, those of the input.
    pub dims: [usize; 2],
    /// Pixel spacing `[dx, dy]`.
    pub spacing: [f64; 2],
    /// Length unit.
    pub unit: String,
    /// Placement in the world.
    pub geometry: Geometry,
    /// Lowest and highest height at which there is a body: where it is still inside there, it ends flat.
    pub extent: [f64; 2],
    /// Layers by strictly increasing height.
    pub layers: Vec<Layer>,
    /// What was done and how well.
    pub report: Report,
}

/// One layer of the body.
#[derive(Debug, Clone)]
pub struct Layer {
    /// Height, unit of the stack.
    pub z: f64,
    /// Signed in-plane distance to the contour in the stack's unit, row-major, negative inside, never zero, clamped to the margin.
    pub phi: Vec<f32>,
    /// Belongs to the output grid (volumes are written from these).
    pub output: bool,
    /// Index of the input contour at this height.
    pub contour: Option<usize>,
}

impl Reconstruction {
    /// Layers of the output grid.
    pub fn output_layers(&self) -> impl Iterator<Item = &Layer> {
        self.layers.iter().filter(|l| l.output)
    }

    /// Number of output layers, the height of the first and their distance (the larger pixel side where there is only one).
    pub fn output_grid(&self) -> (usize, f64, f64) {
        let heights: Vec<f64> = self.output_layers().map(|l| l.z).collect();
        let count = heights.len();
        let (first, step) = match heights[..] {
            [first, .., last] => (first, (last - first) / (count - 1) as f64),
            [first] => (first, self.spacing[0].max(self.spacing[1])),
            [] => (0.0, 1.0),
        };
        (count, first, step)
    }
}
