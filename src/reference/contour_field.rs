//! Level set phi_i of a slice: anti-aliasing, distance, conditioning.

use super::band::Band;
use super::distance::distance_of;
use super::exact::exact_distance;
use super::hj_step::Scratch;
use super::reinit::reinit;
use crate::backend::ContourOptions;
use crate::backend::conditioning::{
    CONDITION_ITERATIONS, CONDITION_WIDER, CONDITIONED, EQ6_ITERATIONS, FIELD_FLOOR, KERNEL_CLIP, MASK_FLOOR,
    gaussian_weights,
};
use crate::grid::field::Field;
use crate::settings::AntiAlias;

/// Signed distance field of a mask, px; `inf` where the mask is empty. The side of every pixel is the mask's.
pub fn field_of_mask(mask: &[bool], dims: [usize; 2], h: [f64; 2], options: ContourOptions) -> Field {
    if !mask.contains(&true) {
        return Field::filled(dims, f64::INFINITY);
    }
    let binary = Field { dims, data: mask.iter().map(|&m| if m { -0.5 } else { 0.5 }).collect() };
    let smooth = match options.anti_alias {
        AntiAlias::None => return condition(distance_of(&binary, h), h, options.half_width),
        AntiAlias::Kernel => without_second_moment(&binary, options.sigma),
        AntiAlias::Eq6 => {
            let band = Band::new(&mut exact_distance(mask, dims, h), options.half_width + CONDITION_WIDER);
            let mut u = binary;
            reinit(&mut u, &band, h, EQ6_ITERATIONS, &mut Scratch::default());
            u
        }
    };
    let mut phi = distance_of(&keep_side(smooth, |k| mask[k], MASK_FLOOR), h);
    if options.anti_alias == AntiAlias::Kernel {
        let exact = exact_distance(mask, dims, h);
        for (v, e) in phi.data.iter_mut().zip(&exact.data) {
            *v = v.clamp(e - KERNEL_CLIP, e + KERNEL_CLIP);
        }
    }
    condition(phi, h, options.half_width)
}

/// Signed distance to the sub-pixel zero set of `u` (negative inside, 0 counts as outside); `inf` where nothing is inside.
pub fn field_of_level(u: &Field, h: [f64; 2], options: ContourOptions) -> Field {
    if !u.has_inside() {
        return Field::filled(u.dims, f64::INFINITY);
    }
    condition(distance_of(u, h), h, options.half_width)
}

/// Brings a distance field to the fixed point of the sweeps' reinitialisation near its contour, without changing any side.
fn condition(phi: Field, h: [f64; 2], half_width: f64) -> Field {
    let mut relaxed = phi.clone();
    let band = Band::new(&mut relaxed, half_width + CONDITION_WIDER);
    reinit(&mut relaxed, &band, h, CONDITION_ITERATIONS, &mut Scratch::default());
    let mut out = phi.clone();
    for node in band.nodes() {
        if relaxed.data[node].abs() < half_width + CONDITIONED {
            out.data[node] = relaxed.data[node];
        }
    }
    keep_side(out, |k| phi.data[k] < 0.0, FIELD_FLOOR)
}

fn keep_side(mut u: Field, inside: impl Fn(usize) -> bool, floor: f64) -> Field {
    for (k, v) in u.data.iter_mut().enumerate() {
        *v = if inside(k) { v.min(-floor) } else { v.max(floor) };
    }
    u
}

/// `2 G - G * G` applied to `u`: smooths without a second moment, so that no contour shrinks to leading order.
fn without_second_moment(u: &Field, sigma: f64) -> Field {
    let once = gaussian(u, sigma);
    let twice = gaussian(&once, sigma);
    Field { dims: u.dims, data: once.data.iter().zip(&twice.data).map(|(a, b)| 2.0 * a - b).collect() }
}

/// Gaussian of width `sigma` samples, cut at 4 sigma, edges repeated.
fn gaussian(u: &Field, sigma: f64) -> Field {
    let weights = gaussian_weights(sigma);
    let reach = weights.len() / 2;
    let [nx, ny] = u.dims;
    let along_x = Field::from_fn(u.dims, |i, j| {
        let row = &u.data[j * nx..(j + 1) * nx];
        weights.iter().enumerate().map(|(k, w)| w * row[(i + k).saturating_sub(reach).min(nx - 1)]).sum()
    });
    let mut out = Field::filled(u.dims, 0.0);
    for j in 0..ny {
        for (k, w) in weights.iter().enumerate() {
            let from = (j + k).saturating_sub(reach).min(ny - 1);
            let (row, target) = (&along_x.data[from * nx..(from + 1) * nx], &mut out.data[j * nx..(j + 1) * nx]);
            for (t, v) in target.iter_mut().zip(row) {
                *t += w * v;
            }
        }
    }
    out
}
