//! Values that a stage has made, as another one wants them: times a number, to the last bit what the host would send.
//!
//! The host multiplies in double precision. Single precision comes within a place of that, so that two bits a value tell the rest.

use rayon::prelude::*;

use super::Gpu;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::Factor;
use super::moving::bounded;
use crate::error::Result;
use crate::grid::field::{Field, VALUES_OF_A_THREAD};

shader! {
    rescale = "common/job.wgsl" + twin "src/gpu/resident.rs";

    /// Products, some last places off.
    Rescale for rescale, "rescale" {
        factor: Uniform Factor,
        values: Read [f32],
        places: Read [u32],
        product: Write [f32],
    }
}

/// Values whose places are told in a word.
const OF_WORD: usize = 16;
/// Drivers may take smaller products for 0.
const LEAST: f32 = 1e-30;

/// The values of `field` times the second of `scales`, made before the next work of those times the first, which are in `values` from number `first` on.
/// Nothing where two bits do not tell them apart.
///
/// # Errors
/// The errors of [`Device::buffer`](super::device::Device::buffer), and those for more workgroups than the device allows.
pub fn rescaled(
    gpu: &Gpu,
    field: &Field,
    [from, to]: [f64; 2],
    (values, first): (&Buffer<[f32]>, usize),
) -> Result<Option<Buffer<[f32]>>> {
    let (device, count) = (&gpu.device, field.data.len());
    let nearest = (to / from) as f32;
    let Some(places) = places(field, [from, to], nearest) else { return Ok(None) };
    let factor = Factor { nearest, first: first as u32, count: count as u32, padding: 0 };
    let (factor, places) = (&device.uniform("factor", factor), &device.upload("places", &places)?);
    let product = device.storage("field", count)?;
    device.run_before(&Rescale { factor, values, places, product: &product }.bind(gpu), count)?;
    Ok(Some(product))
}

/// By how many last places what is wanted is off the products of single precision, plus 1.
fn places(field: &Field, [from, to]: [f64; 2], nearest: f32) -> Option<Vec<u32>> {
    let place = |v: &f64| {
        let (product, wanted) = ((from * v) as f32 * nearest, bounded(to * v));
        let more = wanted.to_bits().wrapping_sub(product.to_bits()).wrapping_add(1);
        (more < 4 && (v.abs() == 0.0 || wanted.abs() > LEAST)).then_some(more)
    };
    let word =
        |some: &[f64]| some.iter().enumerate().try_fold(0, |word, (k, v)| place(v).map(|more| word | more << (2 * k)));
    field.data.par_chunks(OF_WORD).with_min_len(VALUES_OF_A_THREAD / OF_WORD).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_bits_tell_every_product() {
        let value = |i: usize, j: usize| {
            let made = ((i as f32 - 31.3) * 1.7e-3).sin() * 2f32.powi(j as i32 % 40 - 20);
            f64::from(made) / 0.7
        };
        let field = Field::from_fn([64, 64], value);
        for to in [0.7, 9.999_999_3, 1.0 / 3.0, 1_234.567_890_12] {
            let nearest = (to / 0.7) as f32;
            let places = places(&field, [0.7, to], nearest).expect("two bits are enough");
            for (n, v) in field.data.iter().enumerate() {
                let more = places[n / OF_WORD] >> (2 * (n % OF_WORD)) & 3;
                let product = (0.7 * v) as f32 * nearest;
                assert_eq!(f32::from_bits(product.to_bits() + more - 1), bounded(to * v), "{v} times {to}");
            }
        }
        let tiny = Field::filled([2; 2], 1e-33);
        assert!(places(&tiny, [1.0, 1.1], 1.1).is_none(), "what drivers may take for 0 is sent");
    }
}
