//! The output layers as a volume in the axis order of the input, for the formats that hold one.

use std::io::{self, Write};

use super::mesh::to_world;
use super::{Layer, Reconstruction};

/// What a volume holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// f32 signed in-plane distance in the stack's unit, negative inside, clamped to the margin.
    Distance,
    /// u8, 1 inside and 0 outside.
    Mask,
}

/// Where the voxels of the output lie in the world (LPS); axes as in the input.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VoxelGrid {
    /// Voxels along each axis, the first runs fastest.
    pub dims: [usize; 3],
    /// Position of the first voxel.
    pub origin: [f64; 3],
    /// Unit vectors along the axes.
    pub axes: [[f64; 3]; 3],
    /// Voxel sides.
    pub sides: [f64; 3],
}

impl VoxelGrid {
    pub fn of(body: &Reconstruction) -> Self {
        let (count, first, step) = body.output_grid();
        let g = &body.geometry;
        let [nx, ny] = body.dims;
        let [dx, dy] = body.spacing;
        let mut grid =
            VoxelGrid { dims: [0; 3], origin: to_world(g, [0.0, 0.0, first]), axes: [[0.0; 3]; 3], sides: [0.0; 3] };
        for (k, axis) in g.order.into_iter().enumerate() {
            grid.dims[axis] = [nx, ny, count][k];
            grid.axes[axis] = g.axes[k];
            grid.sides[axis] = [dx, dy, step][k];
        }
        grid
    }
}

/// Voxels of the output layers as little-endian bytes, the input's first axis fastest.
pub(super) fn write_voxels(out: &mut impl Write, body: &Reconstruction, content: Content) -> io::Result<()> {
    let layers: Vec<&Layer> = body.output_layers().collect();
    let grid = VoxelGrid::of(body);
    // How far apart neighbours along the volume's axes are within a layer; along the stacking direction they are a layer apart.
    let mut strides = [0; 3];
    let [x, y, across] = body.geometry.order;
    (strides[x], strides[y]) = (1, body.dims[0]);
    let mut bytes = Vec::new();
    for c in 0..grid.dims[2] {
        for b in 0..grid.dims[1] {
            let start = b * strides[1] + c * strides[2];
            let mut put = |v: f32| match content {
                Content::Distance => bytes.extend(v.to_le_bytes()),
                Content::Mask => bytes.push(u8::from(v < 0.0)),
            };
            match across {
                0 => layers.iter().for_each(|layer| put(layer.phi[start])),
                _ => {
                    let layer = layers[[b, c][across - 1]];
                    layer.phi[start..].iter().step_by(strides[0]).take(grid.dims[0]).for_each(|v| put(*v));
                }
            }
            out.write_all(&bytes)?;
            bytes.clear();
        }
    }
    Ok(())
}
