//! What the pixels of a stretch of a node are corrected by, of all that has been read there.

use multiversion::multiversion;

use super::limit::{goes_on, limited};
use super::near::nearness;

/// Facts about a node.
pub struct Rise {
    /// Strength.
    pub alpha: f32,
    /// Share of the contour above.
    pub w: f32,
    /// B.
    pub bound: f32,
    /// Distances count up to this.
    pub farthest: f64,
    /// Whether there are contours beyond those below and above.
    pub beyond: [bool; 2],
    /// Length of a pixel's larger side, where slopes may not overshoot.
    pub limited: Option<f32>,
}

/// What has been read at some pixels.
pub struct Lines<'l> {
    /// The node's v, its distances, its n and its difference.
    pub own: [&'l [f32]; 4],
    /// Shares of the strength: those of parts that are kept apart, and those of thin walls.
    pub shares: [&'l [f32]; 2],
    /// Of the contours below and above along the trajectories their distances and differences.
    pub along: [[&'l [f32]; 2]; 2],
    /// Their distances straight along z.
    pub straight: [&'l [f32]; 2],
    /// Along the trajectories those of the contours beyond.
    pub beyond: [&'l [f32]; 2],
}

/// Writes the corrections of some pixels.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
pub fn correct(rise: &Rise, lines: &Lines<'_>, out: &mut [f32]) {
    let count = out.len();
    let &Rise { alpha, w, bound, farthest, beyond: [is_below, is_above], limited: side } = rise;
    let [v, here, slope, own_d] = lines.own;
    let [v, here, slope, own_d] = [&v[..count], &here[..count], &slope[..count], &own_d[..count]];
    let [kept, counts] = [&lines.shares[0][..count], &lines.shares[1][..count]];
    let [[low_along, low_d], [high_along, high_d]] = lines.along;
    let [low_along, low_d] = [&low_along[..count], &low_d[..count]];
    let [high_along, high_d] = [&high_along[..count], &high_d[..count]];
    let [low_straight, high_straight] = [&lines.straight[0][..count], &lines.straight[1][..count]];
    let [below, above] = [&lines.beyond[0][..count], &lines.beyond[1][..count]];
    for n in 0..count {
        let [low, high] = [low_along[n], high_along[n]];
        // Whether the surface goes on to the contours beyond. Where it closes there its slope at the contour stays, and how it closes has no say: a tip
        // would swell the layers on the other side. A stack's ends are no tips.
        let on_below = if is_below { goes_on([low, below[n]], farthest) } else { 1.0 };
        let on_above = if is_above { goes_on([high, above[n]], farthest) } else { 1.0 };
        // A surface that ends in an interval still goes on if it does so from its contour to the other side: it is the tip of a body.
        let from_low = if is_below && low.abs() < high.abs() { on_below } else { 0.0 };
        let from_high = if is_above && high.abs() < low.abs() { on_above } else { 0.0 };
        let share = goes_on([low, high], farthest).max(from_low).max(from_high);
        let alpha = alpha * kept[n] * share * counts[n];
        let ramps = (on_below + (1.0 - on_below) * w) * (on_above + (1.0 - on_above) * (1.0 - w));
        let rise = alpha * ramps * (own_d[n] - on_below * (1.0 - w) * low_d[n] - on_above * w * high_d[n]);
        out[n] = slope[n] * rise * nearness(v[n].abs() / bound) as f32;
    }
    if let Some(side) = side {
        for n in 0..count {
            let ranges = [[low_along[n], high_along[n]], [low_straight[n], high_straight[n]]];
            out[n] = limited(out[n], here[n], ranges, side);
        }
    }
}
