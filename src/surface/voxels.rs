//! Place of the voxels of a body's output layers, in the axis order of the input.

use glam::DVec3;

use super::header::Header;

/// The grid of a volume in the world (LPS).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VoxelGrid {
    /// Voxels along each axis, the first runs fastest.
    pub dims: [usize; 3],
    /// Position of the first voxel.
    pub origin: DVec3,
    /// Unit vectors along the axes.
    pub axes: [DVec3; 3],
    /// Voxel sides.
    pub sides: [f64; 3],
    /// Axes along which the columns, rows and heights of the layers run.
    pub order: [usize; 3],
}

impl VoxelGrid {
    pub fn of(body: &Header) -> Self {
        let g = &body.geometry;
        let [nx, ny] = body.dims;
        let [dx, dy] = body.spacing;
        let origin = g.to_world(body.grid.start * DVec3::Z);
        let mut grid = VoxelGrid { dims: [0; 3], origin, axes: [DVec3::ZERO; 3], sides: [0.0; 3], order: g.order };
        for (k, axis) in g.order.into_iter().enumerate() {
            grid.dims[axis] = [nx, ny, body.grid.count][k];
            grid.axes[axis] = g.axes[k];
            grid.sides[axis] = [dx, dy, body.grid.step][k];
        }
        grid
    }

    /// Step along an axis from voxel to voxel.
    pub fn step(&self, axis: usize) -> DVec3 {
        self.axes[axis] * self.sides[axis]
    }
}
