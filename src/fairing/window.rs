//! The mean along z: a quadratic B-spline about the layer, as wide as the gaps there ask, from as many layers as it needs.
//!
//! Its knots are two sigma apart. With whole numbers of steps between knots the weights of even steps have the sum, mean and variance of the
//! spline itself wherever the layer lies between them, and they come and go with a slope of 0, so that the mean is C1 along z: five steps a
//! gap do what many do. Which layers take part does not depend on the layer whose mean it is: else layers side by side would know of
//! different kinks at the contours.

use crate::spline::smoothstep;

/// Sigma of the mean along z, gaps.
const SIGMA: f64 = 0.3;
/// Where the spline ends, sigmas.
const TRUNCATE: f64 = 3.0;

/// Steps of a gap in which there are twice as many layers or more.
const STEPS: f64 = 5.0;
/// Second moments, sigma squared, below which the first is no longer made 0.
const LEVER: f64 = 0.1;
/// Layers this near a place count as nearest too, steps: from above and from below the same ones do.
const EVEN: f64 = 1e-6;

/// Whether layer `l` of those at increasing `heights`, of which `dz` lie between most, takes part in means: where they are fine the contours
/// and the layers nearest to places that divide the gap evenly, else and beyond the contours all.
pub fn takes_part(heights: &[f64], contours: &[f64], dz: f64, l: usize) -> bool {
    let (z, last) = (heights[l], contours.len() - 1);
    let above = contours.partition_point(|c| *c < z);
    if above == 0 || above > last || contours[above] == z {
        return true;
    }
    let (low, high) = (contours[above - 1], contours[above]);
    if ((high - low) / dz).round() < 2.0 * STEPS {
        return true;
    }
    let steps = |l: usize| (0.5 * (heights[l] + z) - low) / (high - low) * STEPS;
    let first = (steps(l.saturating_sub(1)) - EVEN).ceil().max(1.0);
    first <= (steps((l + 1).min(heights.len() - 1)) + EVEN).min(STEPS - 1.0)
}

/// Weights of the layers at increasing heights, `all`, that are `known` in the mean at layer `k`; `taking_part` are the numbers of those that take
/// part. Each stands for half of the way to its neighbours among them; beyond the body's ends they go on as their reflections in the last one,
/// `2 v_end - v`, so that a slope there stays.
pub fn weights(
    all: &[f64],
    taking_part: &[usize],
    contours: &[f64],
    k: usize,
    known: impl Fn(usize) -> bool,
) -> Vec<(usize, f32)> {
    let z = all[k];
    let sigma = sigma(contours, z);
    let heights: Vec<f64> = taking_part.iter().map(|&l| all[l]).collect();
    let last = heights.len() - 1;
    let height = |n: usize| {
        let (below, above) = (heights[n] - heights[n.saturating_sub(1)], heights[(n + 1).min(last)] - heights[n]);
        if below == 0.0 || above == 0.0 { below.max(above) } else { 0.5 * (below + above) }
    };
    let weight = |n: usize, z_n: f64| height(n) * spline((z_n - z).abs() / (2.0 * sigma));
    let mut weights: Vec<f64> = (0..=last).map(|n| weight(n, heights[n])).collect();
    for end in [0, last] {
        for n in (0..=last).filter(|&n| n != end) {
            let reflected = weight(n, 2.0 * heights[end] - heights[n]);
            weights[end] += 2.0 * reflected;
            weights[n] -= reflected;
        }
    }
    let terms: Vec<(usize, f64)> =
        taking_part.iter().copied().zip(weights).filter(|(l, w)| *w != 0.0 && known(*l)).collect();
    // Where steps are uneven the mean of a line must be the line, too. Towards a reflection the second moment vanishes, and the first with it.
    let moment = |power: i32| terms.iter().map(|(l, w)| w * (all[*l] - z).powi(power)).sum::<f64>();
    let [whole, first, second] = [0, 1, 2].map(moment);
    let turn = first * second / (second.powi(2) + (LEVER * whole * sigma * sigma).powi(2));
    let turned: Vec<(usize, f64)> = terms.iter().map(|&(l, w)| (l, w * (1.0 - turn * (all[l] - z)))).collect();
    let whole: f64 = turned.iter().map(|t| t.1).sum();
    turned.into_iter().map(|(l, w)| (l, (w / whole) as f32)).collect()
}

/// The quadratic B-spline at a distance from its centre, both in distances of its knots.
fn spline(away: f64) -> f64 {
    if away < 0.5 { 0.75 - away * away } else { 0.5 * (1.5 - away).max(0.0).powi(2) }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Contours whose gaps are unequal, and layers `dz` apart, contours among them.
    fn layers(dz: f64) -> (Vec<f64>, Vec<f64>) {
        let contours = vec![0.0, 10.0, 21.0, 30.0, 42.0, 51.0];
        let mut heights: Vec<f64> = (0..=(51.0 / dz) as usize).map(|k| k as f64 * dz).chain(contours.clone()).collect();
        heights.sort_by(f64::total_cmp);
        heights.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        (contours, heights)
    }

    fn taking_part(heights: &[f64], contours: &[f64], dz: f64) -> Vec<usize> {
        (0..heights.len()).filter(|&l| takes_part(heights, contours, dz, l)).collect()
    }

    /// The mean of `f` at layer `k`.
    fn mean(heights: &[f64], taking_part: &[usize], contours: &[f64], k: usize, f: impl Fn(f64) -> f64) -> f64 {
        let terms = weights(heights, taking_part, contours, k, |_| true);
        terms.into_iter().map(|(l, w)| f64::from(w) * f(heights[l])).sum()
    }

    #[test]
    fn of_many_layers_five_a_gap_take_part_and_of_few_all() {
        for dz in [1.0, 0.7, 0.5, 0.21, 0.05] {
            let (contours, heights) = layers(dz);
            let some = taking_part(&heights, &contours, dz);
            for pair in contours.windows(2) {
                let within = |l: &&usize| (pair[0]..pair[1]).contains(&heights[**l]);
                let all = heights.iter().filter(|z| (pair[0]..pair[1]).contains(*z)).count();
                let count = some.iter().filter(within).count();
                // Where a place lies half way between two layers both take part.
                let few = ((pair[1] - pair[0]) / dz).round() < 10.0;
                assert!(
                    if few { count == all } else { (5..=8).contains(&count) },
                    "dz {dz}, {pair:?}: {count} of {all}"
                );
            }
            assert!(contours.iter().all(|c| some.iter().any(|&l| heights[l] == *c)));
        }
    }

    #[test]
    fn from_above_the_same_layers_take_part() {
        for dz in [1.0, 0.5, 0.3] {
            let (contours, heights) = layers(dz);
            let turned = |z: &[f64]| z.iter().rev().map(|z| 51.0 - z).collect::<Vec<_>>();
            let from_above = taking_part(&turned(&heights), &turned(&contours), dz);
            let mirrored: Vec<usize> = from_above.iter().rev().map(|l| heights.len() - 1 - l).collect();
            assert_eq!(taking_part(&heights, &contours, dz), mirrored, "dz {dz}");
        }
    }

    #[test]
    fn the_mean_is_that_of_all_layers() {
        let wave = |z: f64| (z / 6.0).sin() + 0.02 * z;
        for dz in [1.0, 0.5, 0.1] {
            let (contours, heights) = layers(dz);
            let (some, all) = (taking_part(&heights, &contours, dz), (0..heights.len()).collect::<Vec<_>>());
            for k in 0..heights.len() {
                let [few, many] = [&some, &all].map(|part| mean(&heights, part, &contours, k, wave));
                let line = mean(&heights, &some, &contours, k, |z| z);
                assert!((few - many).abs() < 0.01, "dz {dz}, {}: {few} for {many}", heights[k]);
                assert!((line - heights[k]).abs() < 0.02, "dz {dz}, {}: {line}", heights[k]);
            }
        }
    }

    #[test]
    fn weights_do_not_depend_on_what_lies_beyond() {
        let (contours, heights) = layers(0.5);
        let k = heights.iter().position(|z| *z == 24.0).expect("a layer");
        let of = |from: usize, to: usize| {
            let part = taking_part(&heights[from..to], &contours, 0.5);
            let terms = weights(&heights[from..to], &part, &contours, k - from, |_| true);
            terms.into_iter().map(|(l, w)| (l + from, w)).collect::<Vec<_>>()
        };
        let [low, high] = reach(&contours, 2);
        // One that takes part beyond either end, and its neighbours.
        let at = |z: f64| heights.partition_point(|h| *h < z);
        assert_eq!(of(0, heights.len()), of(at(low) - 7, at(high) + 7));
    }
}
