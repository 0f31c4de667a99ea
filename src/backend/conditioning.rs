//! Numbers of the distance stage: how masks are smoothed and level sets conditioned. Every backend reads them here.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use crate::grid::field::covered;

/// Smallest |value| of an anti-aliased mask, of which 1 is the step: no pixel changes its side.
pub const MASK_FLOOR: f64 = 0.02;
/// Width for the conditioned field, px.
pub const FIELD_FLOOR: f64 = 0.01;
/// Distance by which the kernel may move a contour from the exact distance, px: protects thin parts.
pub const KERNEL_CLIP: f64 = 0.25;
/// Kernels so many times as wide smooth as well, in turn, where the pixels do not contradict them: what is smooth is known better from more of its
/// pixels. Contours of smooth bodies are off by 0.124 px rms for 0.161 at a radius of 10 px, by 0.111 for 0.159 at 20 px and by 0.091 for 0.154 at 40 px.
pub const WIDER: [f64; 2] = [2.0, 4.0];
/// Distance by which these may move a contour from the exact distance, px.
pub const WIDER_CLIP: f64 = 0.5;
/// Depth to which pixels lie on the wrong side of the contour of a kernel so many times as wide, times that, where about half of it counts: samples, the
/// root of the mean square in a window of [`AREA_SIGMA`]. What bends more than a kernel does is lost by it, and then pixels are on the wrong side.
pub const CONTRADICTED: f64 = 0.2;
/// Pixels count that much less for it by how far they lie from the kernel's own contour, samples: at this distance not at all.
pub const BESIDE: f64 = 0.9;
/// What counts as contradiction beside the window's sum: away from any contour there is no wider kernel, and a contour has one share all around.
pub const NOTHING_BESIDE: f64 = 1e-6;
/// Width of the window in which a contour gets the area of its mask back, samples: wide enough not to follow the mask's steps. With 2 a disc's
/// contour is off by 0.150 px rms at a radius of 10 px, with 3 by 0.144 and with 5 by 0.142; without the window by 0.147.
pub const AREA_SIGMA: f64 = 3.0;
/// Least length of contour per pixel in the window, px, by which area is divided; at a straight contour it is 0.13.
pub const LEAST_LENGTH: f64 = 0.01;
/// Distance by which a contour moves at most to get its area back, px.
pub const MOST_SHIFT: f64 = 0.5;
/// Square of a gradient that tells of no direction: there is none near a contour, and what divides by it stays finite.
pub const FLAT: f64 = 1e-4;
/// Iterations of Eq. 6 on a binary field for `eq6`.
pub const EQ6_ITERATIONS: usize = 10;
/// Iterations of Eq. 6 that bring phi to the fixed point of the sweeps' own reinitialisation. Without them the speed jumps at the
/// contours (a star: 0.038 px per unit of z instead of 0.005).
pub const CONDITION_ITERATIONS: usize = 20;
/// Width beyond the tubes of the sweeps of the band in which a field is conditioned, px.
pub const CONDITION_WIDER: f64 = 4.0;
/// Distance beyond the tubes to which conditioned values count, px.
pub const CONDITIONED: f64 = 3.0;

/// Width of a pixel of sides `h` across a contour whose level set changes by `along` per length along each axis: `|(h_x g_x, h_y g_y)| / |g|`.
pub fn pixel_width(along: [f64; 2], h: [f64; 2]) -> f64 {
    let [gx, gy] = along.map(|g| g * g);
    let least = h[0].min(h[1]);
    ((gx * h[0] * h[0] + gy * h[1] * h[1] + FLAT * least * least) / (gx + gy + FLAT)).sqrt()
}

/// Length of contour in a pixel at that distance from it, in pixels' areas per length: by how much of it is covered less half of its width farther.
pub fn contour_length(phi: f64, width: f64) -> f64 {
    2.0 * (covered(phi / width - 0.25) - covered(phi / width + 0.25)) / width
}

/// Slope of `2 G - G * G` of a step of 1 where it crosses, per sample, with a Gaussian of width `sigma` samples.
pub fn kernel_slope(sigma: f64) -> f64 {
    (2.0 - FRAC_1_SQRT_2) / (sigma * (2.0 * PI).sqrt())
}

/// Share to which a kernel `times` as wide counts, by the squares of the depths to which pixels lie on the wrong side of its contour, square samples, in
/// the window: `depths` of them times their weights, and their `weights`. None where twice as much contradicts it as where about half does: what is thin
/// stays as the first kernel has it, to the bit.
pub fn wider_share(depths: f64, weights: f64, times: f64) -> f64 {
    let half = CONTRADICTED / times;
    let mean = (depths + NOTHING_BESIDE) / (weights + NOTHING_BESIDE);
    (1.0 - (0.5 * mean / (half * half)).min(1.0).powi(2)).powi(2)
}

/// Weights of a Gaussian of width `sigma` samples, cut at 4 sigma: of each of the two samples at a distance of 0, half of the middle's, 1, 2 and so on.
/// They sum to a half.
pub fn gaussian_weights(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma + 0.5) as usize;
    let mut weights: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    weights[0] *= 0.5;
    let sum: f64 = 2.0 * weights.iter().rev().sum::<f64>();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}
