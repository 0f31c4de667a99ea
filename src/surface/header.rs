//! Header of a body: what is known before its first layer.

use super::voxels::VoxelGrid;
use crate::stack::{Geometry, HeightGrid};

/// Header of a body: what is known before its first layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Pixels per layer, `[nx, ny]`.
    pub dims: [usize; 2],
    /// Pixel spacing `[dx, dy]`.
    pub spacing: [f64; 2],
    /// Length unit.
    pub unit: String,
    /// Placement in the world.
    pub geometry: Geometry,
    /// Lowest and highest height at which there is a body: where it is still inside there, it ends flat.
    pub extent: [f64; 2],
    /// Heights of the output layers; a step of the larger pixel side where there is only one.
    pub grid: HeightGrid,
}

impl Header {
    /// Voxels of a volume of the output layers along the axes of its input, the first runs fastest.
    pub fn voxels(&self) -> [usize; 3] {
        VoxelGrid::of(self).dims
    }

    /// The grid of output layers at `heights`, which increase.
    pub fn grid(heights: &[f64], spacing: [f64; 2]) -> HeightGrid {
        let (start, step) = match heights[..] {
            [first, .., last] => (first, (last - first) / (heights.len() - 1) as f64),
            [first] => (first, spacing[0].max(spacing[1])),
            [] => (0.0, 1.0),
        };
        HeightGrid { start, step, count: heights.len() }
    }
}
