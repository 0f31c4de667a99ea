//! Nodes of a fairing, and what is made of them once.

use std::sync::Arc;

use super::fairing_near::nearer;
use crate::grid::tiled::Packed;
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{Paths, Place};

/// A block of a layer, and where its trajectory meets the slices below and above, px of the padded image.
pub type Near = (usize, [[f64; 2]; 2]);

/// A node with what fairing makes of it.
pub struct Node {
    /// Its distances.
    pub phi: Arc<Packed<f32>>,
    /// Correction, as soon as the node above is known.
    pub made: Option<Transformed>,
    /// Difference of a contour, `K v - v`, until the interval above it is corrected.
    pub difference: Option<Packed<f32>>,
    /// Correction of a node between contours.
    pub correction: Option<Packed<f32>>,
}

/// Transform of the distances of a node.
pub struct Transformed {
    /// Values that are averaged.
    pub v: Packed<f32>,
    /// `n` near the surface, less where it lies flat; 0 elsewhere.
    pub gradient: Packed<f32>,
    /// Whether it is a contour.
    pub at_contour: bool,
    /// Place in the moving frame, if there is one.
    pub place: Option<Place>,
    /// Blocks that are read where its surface is near.
    pub near: Vec<Near>,
}

impl Node {
    /// Nothing has been made of it.
    pub fn new(phi: Arc<Packed<f32>>) -> Self {
        Node { phi, made: None, difference: None, correction: None }
    }

    /// Place in the moving frame.
    pub fn place(&self) -> Option<&Place> {
        self.made.as_ref()?.place.as_ref()
    }
}

/// Blocks of a layer that are read where its surface is nearer than `far`, and where their trajectories meet the slices around it.
pub fn blocks_near(v: &Packed<f32>, far: f32, paths: &Paths, pad: [usize; 2]) -> Vec<Near> {
    let still = Displacement::zero(v.dims());
    let mut near = vec![false; still.vectors.len()];
    let [nx, ny] = v.dims();
    // A pixel reads the four nodes around it.
    let around = |low: usize, high: usize, axis: usize| {
        let [first, last] = [low, high].map(|p| still.place(axis, p as f64).0);
        first..last + 2
    };
    let mut row = vec![0.0; nx];
    for j in 0..ny {
        v.read(0, j, &mut row);
        for pixels in nearer(&row, far) {
            for by in around(j, j, 1) {
                near[by * still.grid[0]..][around(pixels.start, pixels.end - 1, 0)].fill(true);
            }
        }
    }
    let slices = |block: usize| {
        let x = still.centre(block);
        paths.to_slices([0, 1].map(|a| x[a] + pad[a] as f64))
    };
    (0..near.len()).filter(|&block| near[block]).map(|block| (block, slices(block))).collect()
}
