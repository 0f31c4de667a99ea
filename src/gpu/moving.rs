//! Data that the kernels of the moving field share: images and displacements as they lie on the device.

use glam::DVec2;
use rayon::prelude::*;

use super::Gpu;
use super::buffer::Buffer;
use super::device::Device;
use super::layout::{Image, TILE};
use super::recorder::Size;
use crate::error::Result;
use crate::registration::displacement::{Displacement, NODES_OF_A_THREAD};

/// Images of these pixels with displacements on such a grid of nodes, and how many items a dispatch has.
pub fn image(dims: [usize; 2], grid: [usize; 2], h: [f64; 2], count: usize) -> Image {
    Image {
        nx: dims[0] as u32,
        ny: dims[1] as u32,
        columns: grid[0] as u32,
        rows: grid[1] as u32,
        hx: h[0] as f32,
        hy: h[1] as f32,
        count: count as u32,
        padding: 0,
    }
}

/// Tiles of an image.
pub fn tile_count(dims: [usize; 2]) -> usize {
    dims.map(|n| n.div_ceil(TILE)).iter().product()
}

/// An invocation per pixel of `count` images, tile by tile.
pub fn per_pixel(dims: [usize; 2], count: usize) -> Size<'static> {
    Size::List(TILE * TILE * tile_count(dims) * count)
}

/// Largest value of an image on the device: products of two of them are finite in single precision.
pub const FARTHEST: f64 = 1e15;

/// A value of an image as it lies on the device. Where a slice is empty it is infinite, which compilers for GPUs may take for anything.
pub fn bounded(v: f64) -> f32 {
    v.clamp(-FARTHEST, FARTHEST) as f32
}

/// Displacements one after the other.
pub fn vectors<'a>(displacements: impl IntoIterator<Item = &'a Displacement>) -> Vec<[f32; 2]> {
    let all: Vec<&[DVec2]> = displacements.into_iter().map(|own| &own.vectors[..]).collect();
    let mut out = Vec::with_capacity(all.iter().map(|own| own.len()).sum());
    for own in all {
        out.par_extend(own.par_iter().with_min_len(NODES_OF_A_THREAD).map(|v| v.as_vec2().to_array()));
    }
    out
}

/// Displacements of the same nodes, one after the other, on a device.
///
/// # Errors
/// The errors of [`Device::buffer`].
pub fn send_vectors<'a>(
    device: &Device,
    label: &str,
    displacements: impl IntoIterator<Item = &'a Displacement>,
) -> Result<Buffer<[[f32; 2]]>> {
    let all: Vec<&Displacement> = displacements.into_iter().collect();
    let each = all.first().map_or(1, |own| own.vectors.len());
    device.upload_made(label, all.len() * each, |first, out| {
        for (k, to) in (first..).zip(out) {
            *to = all[k / each].vectors[k % each].as_vec2().to_array();
        }
    })
}

/// Displacements on the same nodes as `like` from their vectors one after the other.
pub fn displacements<'v>(like: &'v Displacement, vectors: &'v [[f32; 2]]) -> impl Iterator<Item = Displacement> + 'v {
    let of = |some: &[[f32; 2]]| like.with(some.iter().map(|v| DVec2::from(v.map(f64::from))).collect());
    vectors.chunks_exact(like.vectors.len()).map(of)
}

/// Images that the largest array of a stage holds at least: slices of a slope.
const IMAGES_AT_ONCE: usize = 5;

impl Gpu {
    /// Whether images of these pixels are small enough for this adapter's largest array.
    pub(super) fn holds_images(&self, dims: [usize; 2]) -> bool {
        self.share(0, 4 * IMAGES_AT_ONCE * dims[0] * dims[1]) <= 1.0
    }

    /// The share that a job takes of what `fixed` bytes leave of this device.
    pub(super) fn share_beside(&self, fixed: usize, bytes: usize, largest_array: usize) -> f64 {
        let left = (1.0 - self.share(fixed, 0)).max(0.0);
        (self.share(bytes, 0) / left).max(self.share(0, largest_array))
    }
}
