//! The mean along z: a Gaussian about the layer, as wide as the gaps there ask.

use crate::spline::smoothstep;

/// Sigma of the mean along z, gaps.
const SIGMA: f64 = 0.3;
/// Means are cut here, sigmas.
const TRUNCATE: f64 = 2.75;

/// Weights of the layers at increasing `heights` that are `known` in the mean at layer `k`. Each layer stands for half of the way to its
/// neighbours; beyond the body's ends the layers go on as their reflections in the last one, `2 v_end - v`, so that a slope there stays.
pub fn weights(heights: &[f64], contours: &[f64], k: usize, known: impl Fn(usize) -> bool) -> Vec<(usize, f32)> {
    let z = heights[k];
    let sigma = sigma(contours, z);
    let last = heights.len() - 1;
    let height = |l: usize| {
        let (below, above) = (heights[l] - heights[l.saturating_sub(1)], heights[(l + 1).min(last)] - heights[l]);
        if below == 0.0 || above == 0.0 { below.max(above) } else { 0.5 * (below + above) }
    };
    let weight = |l: usize, z_l: f64| {
        let away = (z_l - z).abs();
        if away <= TRUNCATE * sigma { height(l) * (-0.5 * (away / sigma).powi(2)).exp() } else { 0.0 }
    };
    let mut weights: Vec<f64> = (0..=last).map(|l| weight(l, heights[l])).collect();
    for end in [0, last] {
        for l in (0..=last).filter(|&l| l != end) {
            let reflected = weight(l, 2.0 * heights[end] - heights[l]);
            weights[end] += 2.0 * reflected;
            weights[l] -= reflected;
        }
    }
    let terms: Vec<(usize, f64)> = weights.into_iter().enumerate().filter(|(l, w)| *w != 0.0 && known(*l)).collect();
    let whole: f64 = terms.iter().map(|t| t.1).sum();
    terms.into_iter().map(|(l, w)| (l, (w / whole) as f32)).collect()
}

/// SIGMA times the gap: at a contour the mean of those next to it, between them a smooth step, so that what follows is C1.
fn sigma(contours: &[f64], z: f64) -> f64 {
    let last = contours.len() - 1;
    let i = contours.partition_point(|c| *c <= z).clamp(1, last) - 1;
    let t = ((z - contours[i]) / (contours[i + 1] - contours[i])).clamp(0.0, 1.0);
    let w = smoothstep(t);
    SIGMA * ((1.0 - w) * gap_at(contours, i) + w * gap_at(contours, i + 1))
}

/// The mean of the gaps next to a contour.
fn gap_at(contours: &[f64], i: usize) -> f64 {
    let last = contours.len() - 1;
    let below = if i > 0 { contours[i] - contours[i - 1] } else { contours[1] - contours[0] };
    let above = if i < last { contours[i + 1] - contours[i] } else { contours[last] - contours[last - 1] };
    0.5 * (below + above)
}

/// Lowest and highest height from which layers of interval `i` take their means, contours included.
pub fn reach(contours: &[f64], i: usize) -> [f64; 2] {
    let widest = TRUNCATE * SIGMA * gap_at(contours, i).max(gap_at(contours, i + 1));
    [contours[i] - widest, contours[i + 1] + widest]
}
