//! Numbers of the distance stage: how masks are smoothed and level sets conditioned. Every backend reads them here.

use crate::grid::field::covered;

/// Smallest |value| of an anti-aliased mask: no pixel changes its side.
pub const MASK_FLOOR: f64 = 0.02;
/// Width for the conditioned field, px.
pub const FIELD_FLOOR: f64 = 0.01;
/// Distance by which the kernel may move a contour from the exact distance, px: protects thin parts.
pub const KERNEL_CLIP: f64 = 0.25;
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

/// Weights of a Gaussian of width `sigma` samples, cut at 4 sigma; they sum to 1.
pub fn gaussian_weights(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma + 0.5) as usize;
    let mut weights: Vec<f64> =
        (0..=2 * reach).map(|k| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}
