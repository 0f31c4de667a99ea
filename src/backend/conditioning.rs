//! Numbers of the distance stage: how masks are smoothed and level sets conditioned. Every backend reads them here.

/// Smallest |value| of an anti-aliased mask: no pixel changes its side.
pub const MASK_FLOOR: f64 = 0.02;
/// Width for the conditioned field, px.
pub const FIELD_FLOOR: f64 = 0.01;
/// Distance by which the kernel may move a contour from the exact distance, px: protects thin parts.
pub const KERNEL_CLIP: f64 = 0.25;
/// Iterations of Eq. 6 on a binary field for `eq6`.
pub const EQ6_ITERATIONS: usize = 10;
/// Iterations of Eq. 6 that bring phi to the fixed point of the sweeps' own reinitialisation. Without them the speed jumps at the
/// contours (a star: 0.038 px per unit of z instead of 0.005).
pub const CONDITION_ITERATIONS: usize = 20;
/// Width beyond the tubes of the sweeps of the band in which a field is conditioned, px.
pub const CONDITION_WIDER: f64 = 4.0;
/// Distance beyond the tubes to which conditioned values count, px.
pub const CONDITIONED: f64 = 3.0;

/// Weights of a Gaussian of width `sigma` samples, cut at 4 sigma; they sum to 1.
pub fn gaussian_weights(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma + 0.5) as usize;
    let mut weights: Vec<f64> =
        (0..=2 * reach).map(|k| (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}
