//! Layers that wait, and what is made of them once.

use super::near::nearer;
use crate::displacement::{BLOCK, Displacement};
use crate::moving_field::{Paths, Place};
use crate::packed::Packed;
use crate::surface::Layer;

/// A block of a layer, and where its trajectory meets the slices below and above, px of the padded image.
pub type Near = (usize, [[f64; 2]; 2]);

/// A layer with what fairing makes of it.
pub struct Kept {
    /// Height.
    pub z: f64,
    /// Number of its contour, if it is one.
    pub contour: Option<usize>,
    /// Whether it belongs to the output grid, and its distances, until it is handed on.
    pub layer: Option<(bool, Packed<f32>)>,
    /// As soon as the layer above is known.
    pub made: Option<Transformed>,
}

/// What fairing makes of a layer.
pub struct Transformed {
    /// What is averaged.
    pub v: Packed<f32>,
    /// `n` near the surface, less where it lies flat; 0 elsewhere.
    pub gradient: Packed<f32>,
    /// Where it lies in the moving frame, if there is one.
    pub place: Option<Place>,
    /// Blocks that are read where its surface is near.
    pub near: Vec<Near>,
}

impl Kept {
    /// Nothing has been made of it.
    pub fn new(layer: Layer, dims: [usize; 2]) -> Self {
        let Layer { z, phi, output, contour } = layer;
        Kept { z, contour, layer: Some((output, Packed::of(dims, &phi))), made: None }
    }

    /// The layer, which is handed on.
    pub fn take(&mut self) -> Option<Layer> {
        let (output, phi) = self.layer.take()?;
        Some(Layer { z: self.z, phi: phi.unpack(), output, contour: self.contour })
    }

    /// Where it lies in the moving frame.
    pub fn place(&self) -> Option<&Place> {
        self.made.as_ref()?.place.as_ref()
    }
}

/// Blocks of a layer that are read where its surface is nearer than `far`, and where their trajectories meet the slices around it.
pub fn blocks_near(v: &Packed<f32>, far: f32, paths: &Paths, pad: usize) -> Vec<Near> {
    let still = Displacement::zero(v.dims());
    let mut near = vec![false; still.vectors.len()];
    let [nx, ny] = v.dims();
    // A pixel reads the four blocks whose centres are around it.
    let around = |low: usize, high: usize, axis: usize| {
        let [first, last] = [low, high].map(|p| (p + BLOCK / 2) / BLOCK);
        first.saturating_sub(1)..last.min(still.grid[axis] - 1) + 1
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
    let slices = |block: usize| paths.to_slices(still.centre(block).map(|x| x + pad as f64));
    (0..near.len()).filter(|&block| near[block]).map(|block| (block, slices(block))).collect()
}
