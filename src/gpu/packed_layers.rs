//! Layers on the device packed into the squares of sparse images, and their way back to the host.
//!
//! How many squares have values the device knows first. The host guesses it, so that their values come back with their number, and asks again for those
//! beyond.

use rayon::prelude::*;

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::band::crossings;
use super::buffer::Buffer;
use super::device::failure;
use super::layout::NONE;
use super::recorder::Recorder;
use crate::backend::interval_morph::{IntervalMorph, LayerImage};
use crate::error::Result;
use crate::grid::sparse_image::{AREA, SQUARE, SparseImage};

/// Length of a contour for each edge between pixels that it crosses, px, in the mean of all directions: pi / 4.
const LENGTH: f64 = std::f64::consts::FRAC_PI_4;

/// Layers of an interval that are on their way to the host.
pub struct Packed {
    image: LayerImage,
    /// Number of the layers.
    layers: usize,
    /// Number of the squares that have values.
    used: Wanted<u32>,
    /// The squares of all layers: place of the values, or [`NONE`] and the bits of the one value.
    squares: Wanted<[u32; 2]>,
    /// Values of the squares, by their places.
    values: Buffer<[f32]>,
    /// Number of squares whose values come at once, and these.
    guessed: usize,
    first: Wanted<f32>,
}

/// Squares of an image.
pub fn square_count(image: LayerImage) -> usize {
    image.dims.iter().map(|n| n.div_ceil(SQUARE)).product()
}

/// Squares of a layer of an interval that have values, about: those that the bands around its contours touch, as far as distances go. Of the
/// pelvis up to 1.9 times as many have some: to ask once more for the rest costs less than to bring many that have none.
pub fn expected(of: &IntervalMorph<'_>, crossed: usize) -> f64 {
    let caps: usize = of.solids.iter().map(|(cap, _)| crossings(&cap.field)).sum();
    let width = 2.0 * of.image.limit + SQUARE as f64 / LENGTH;
    (LENGTH * (crossed + caps) as f64 * width / AREA as f64).min(square_count(of.image) as f64)
}

impl Packed {
    /// Layers whose squares some work finds: of so many it brings the values.
    pub fn new(
        recorder: &mut Recorder<'_>,
        (image, layers): (LayerImage, usize),
        (used, squares): (&Buffer<[u32]>, &Buffer<[[u32; 2]]>),
        values: Buffer<[f32]>,
        guessed: usize,
    ) -> Self {
        let all = layers * square_count(image);
        let guessed = guessed.min(all);
        Packed {
            image,
            layers,
            used: recorder.read(used, 0, 1),
            squares: recorder.read(squares, 0, all),
            first: recorder.read(&values, 0, guessed * AREA),
            guessed,
            values,
        }
    }

    /// How many squares have values.
    fn used(&self, landed: &Landed<'_>) -> Result<usize> {
        Ok(landed.value(&self.used)? as usize)
    }
}

/// All layers that were packed, one after the other, each with the number of the answers that it came with.
pub fn unpacked(gpu: &Gpu, landed: &[Landed<'_>], packed: &[(usize, Packed)]) -> Result<Vec<SparseImage<f32>>> {
    let more = |(at, own): &(usize, Packed)| Ok(own.used(&landed[*at])?.saturating_sub(own.guessed));
    let more = packed.iter().map(more).collect::<Result<Vec<usize>>>()?;
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    let ask =
        |((_, own), more): (&(usize, Packed), &usize)| recorder.read(&own.values, own.guessed * AREA, more * AREA);
    let beyond: Vec<Wanted<f32>> = packed.iter().zip(&more).map(ask).collect();
    let later = if more.iter().any(|more| *more > 0) { Some(recorder.submit()?.wait()?) } else { None };
    let images = |((at, own), beyond): (&(usize, Packed), &Wanted<f32>)| {
        let landed = &landed[*at];
        // Where nothing is beyond there is nothing to take either.
        let later = later.as_ref().unwrap_or(landed);
        let (squares, count) = (landed.values(&own.squares)?, square_count(own.image));
        landed.taken(&own.first, |first| {
            later.taken(beyond, |beyond| {
                let layer = |k: usize| image_of(own.image.dims, &squares[k * count..][..count], [first, beyond]);
                (0..own.layers).into_par_iter().map(layer).collect::<Result<Vec<_>>>()
            })
        })??
    };
    let made = packed.par_iter().zip(&beyond).map(images).collect::<Result<Vec<_>>>()?;
    Ok(made.into_iter().flatten().collect())
}

/// The image of these squares, whose values are partly in the first, partly in the second list.
fn image_of(dims: [usize; 2], squares: &[[u32; 2]], [first, beyond]: [&[f32]; 2]) -> Result<SparseImage<f32>> {
    let mut next = squares.iter();
    SparseImage::read_squares(dims, |_, out| {
        let missing = || failure("the layers that came back are too short");
        match next.next().ok_or_else(missing)? {
            [NONE, bits] => Ok(Some(f32::from_bits(*bits))),
            [place, _] => {
                let at = *place as usize * AREA;
                let own = match at.checked_sub(first.len()) {
                    None => first.get(at..),
                    Some(at) => beyond.get(at..),
                };
                *out = *own.and_then(|rest| rest.first_chunk()).ok_or_else(missing)?;
                Ok(None)
            }
        }
    })
}
