//! Layers on the device packed into the squares of sparse images, and their way back to the host.

use rayon::prelude::*;

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::buffer::Buffer;
use super::device::failure;
use super::layout::NONE;
use super::recorder::Recorder;
use crate::backend::interval_morph::LayerImage;
use crate::error::Result;
use crate::grid::sparse_image::{AREA, SQUARE, SparseImage};

/// Layers of an interval that are on their way to the host.
pub struct Packed {
    /// Their image.
    pub image: LayerImage,
    /// Number of the layers.
    pub layers: usize,
    /// Number of the squares that have values.
    pub used: Wanted<u32>,
    /// The squares of all layers: place of the values, or [`NONE`] and the bits of the one value.
    pub squares: Wanted<[u32; 2]>,
    /// Values of the squares, by their places.
    pub values: Buffer<[f32]>,
}

/// Squares of an image.
pub fn square_count(image: LayerImage) -> usize {
    image.dims.iter().map(|n| n.div_ceil(SQUARE)).product()
}

/// All layers that were packed, one after the other.
pub fn unpacked(gpu: &Gpu, landed: &Landed<'_>, packed: &[Packed]) -> Result<Vec<SparseImage<f32>>> {
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    let mut wanted = Vec::with_capacity(packed.len());
    for own in packed {
        let used = landed.value(&own.used)? as usize;
        wanted.push(recorder.read::<f32>(&own.values, 0, used * AREA));
    }
    let values = recorder.submit()?.wait()?;
    let images = |(own, wanted): (&Packed, &Wanted<f32>)| {
        let (squares, count) = (landed.values(&own.squares)?, square_count(own.image));
        values.taken(wanted, |values| {
            let layer = |k: usize| image_of(own.image.dims, &squares[k * count..][..count], values);
            (0..own.layers).into_par_iter().map(layer).collect::<Result<Vec<_>>>()
        })?
    };
    let made = packed.par_iter().zip(&wanted).map(images).collect::<Result<Vec<_>>>()?;
    Ok(made.into_iter().flatten().collect())
}

/// The image of these squares.
fn image_of(dims: [usize; 2], squares: &[[u32; 2]], values: &[f32]) -> Result<SparseImage<f32>> {
    let mut next = squares.iter();
    SparseImage::read_squares(dims, |_, out| {
        let missing = || failure("the layers that came back are too short");
        match next.next().ok_or_else(missing)? {
            [NONE, bits] => Ok(Some(f32::from_bits(*bits))),
            [place, _] => {
                let own =
                    values.get(*place as usize * AREA..).and_then(|rest| rest.first_chunk()).ok_or_else(missing)?;
                *out = *own;
                Ok(None)
            }
        }
    })
}
