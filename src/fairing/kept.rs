//! Layers that wait, nodes, and what is made of them once.

use std::sync::Arc;

use glam::DVec2;

use super::near::NearSquares;
use crate::grid::sparse_image::SparseImage;
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{Paths, Place};
use crate::surface::Layer;

/// A block of a layer, and where its trajectory meets the slices below and above, px of the padded image.
pub type Near = (usize, [DVec2; 2]);

/// A layer that waits to be handed on.
pub struct WaitingLayer {
    /// Height.
    pub z: f64,
    /// Its distances.
    pub phi: Arc<SparseImage<f32>>,
    output: bool,
    contour: Option<usize>,
}

impl WaitingLayer {
    /// A layer that has come.
    pub fn new(layer: Layer) -> Self {
        let Layer { z, phi, output, contour } = layer;
        WaitingLayer { z, phi: Arc::new(phi), output, contour }
    }

    /// The layer as it has come.
    pub fn layer(&self) -> Layer {
        self.with((*self.phi).clone())
    }

    /// The layer with other distances.
    pub fn with(&self, phi: SparseImage<f32>) -> Layer {
        Layer { z: self.z, phi, output: self.output, contour: self.contour }
    }
}

/// A node with what fairing makes of it.
pub struct Node {
    /// Its distances.
    pub phi: Arc<SparseImage<f32>>,
    /// Correction, as soon as the node above is known.
    pub made: Option<Transformed>,
    /// Difference of a contour, `K v - v - P`, until the interval above it is corrected.
    pub difference: Option<SparseImage<f32>>,
    /// Correction of a node between contours.
    pub correction: Option<SparseImage<f32>>,
}

/// Transform of the distances of a node.
pub struct Transformed {
    /// Values that are averaged.
    pub v: SparseImage<f32>,
    /// `n` near the surface, less where it lies flat; 0 elsewhere.
    pub gradient: SparseImage<f32>,
    /// Squares of v that may be as near as its difference is known.
    pub squares: NearSquares,
    /// Place in the moving frame, if there is one.
    pub place: Option<Place>,
    /// Blocks that are read where its surface is near.
    pub near: Vec<Near>,
}

impl Node {
    /// Nothing has been made of it.
    pub fn new(phi: Arc<SparseImage<f32>>) -> Self {
        Node { phi, made: None, difference: None, correction: None }
    }

    /// Place in the moving frame.
    pub fn place(&self) -> Option<&Place> {
        self.made.as_ref()?.place.as_ref()
    }
}

/// Blocks of a layer that are read where its surface is nearer than `far`, in `squares`, and where their trajectories meet the slices around it.
pub fn blocks_near(v: &SparseImage<f32>, squares: &NearSquares, far: f32, paths: &Paths, pad: [usize; 2]) -> Vec<Near> {
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
        for pixels in squares.of_row(v, j, far, &mut row) {
            for by in around(j, j, 1) {
                near[by * still.grid[0]..][around(pixels.start, pixels.end - 1, 0)].fill(true);
            }
        }
    }
    let slices = |block: usize| paths.to_slices(still.centre(block) + DVec2::from(pad.map(|p| p as f64)));
    (0..near.len()).filter(|&block| near[block]).map(|block| (block, slices(block))).collect()
}
