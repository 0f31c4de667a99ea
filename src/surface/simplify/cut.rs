//! Triangles in blocks of neighbours.

use glam::DVec3;
use rayon::prelude::*;

/// Triangles between these positions, by their numbers, in blocks whose weights are at most `most`, cut in two at `share` of the triangles along the
/// longest side again and again.
pub(super) fn blocks(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    weights: &[u32],
    most: usize,
    share: f64,
) -> Vec<Vec<u32>> {
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut blocks = Vec::new();
    cut(positions, triangles, weights, most, share, &mut order, &mut blocks);
    blocks.par_iter_mut().for_each(|b: &mut Vec<u32>| b.sort_unstable());
    blocks
}

fn cut(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    weights: &[u32],
    most: usize,
    share: f64,
    order: &mut [u32],
    blocks: &mut Vec<Vec<u32>>,
) {
    let weight: usize = order.iter().map(|&t| weights[t as usize] as usize).sum();
    if weight <= most || order.len() < 2 {
        return blocks.push(order.to_vec());
    }
    // Three times the middle.
    let middle =
        |t: u32, axis: usize| -> f64 { triangles[t as usize].iter().map(|&v| positions[v as usize][axis]).sum() };
    let extent = |axis: usize| {
        let range = order.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &t| {
            let x = middle(t, axis);
            [low.min(x), high.max(x)]
        });
        range[1] - range[0]
    };
    let extents = [0, 1, 2].map(extent);
    let longest = (0..3).fold(0, |best, axis| if extents[axis] > extents[best] { axis } else { best });
    let at = ((order.len() as f64 * share) as usize).clamp(1, order.len() - 1);
    order.select_nth_unstable_by(at, |&s, &t| middle(s, longest).total_cmp(&middle(t, longest)).then(s.cmp(&t)));
    let (low, high) = order.split_at_mut(at);
    cut(positions, triangles, weights, most, share, low, blocks);
    cut(positions, triangles, weights, most, share, high, blocks);
}

/// Numbers of the keys that have each of `count` values, increasing.
pub(super) fn grouped(keys: impl Iterator<Item = u32> + Clone, count: usize) -> Vec<Vec<u32>> {
    let mut sizes = vec![0; count];
    keys.clone().for_each(|k| sizes[k as usize] += 1);
    let mut groups: Vec<Vec<u32>> = sizes.into_iter().map(Vec::with_capacity).collect();
    keys.zip(0..).for_each(|(k, n)| groups[k as usize].push(n));
    groups
}
