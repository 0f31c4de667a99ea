//! Both sweeps of a group at one time, blended and mended: every backend composes its slices by it.

use crate::backend::jobs::{SweepPair, disagreement};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;

/// Two sweeps of a group at the same time, `weights[0] up + weights[1] down`, neither deeper than the other by more than [`disagreement`].
pub fn blend(up: &SparseImage<f32>, down: &SparseImage<f32>, weights: [f64; 2]) -> Field {
    let allowed = weights.map(disagreement);
    let mixed = |(&a, &b): (&f32, &f32)| {
        let (a, b) = (f64::from(a), f64::from(b));
        let limits = allowed.map(|more| a.abs().min(b.abs()) + more);
        weights[0] * a.clamp(-limits[0], limits[0]) + weights[1] * b.clamp(-limits[1], limits[1])
    };
    let [nx, ny] = up.dims();
    let mut phi = Field { dims: [nx, ny], data: Vec::with_capacity(nx * ny) };
    let mut rows = [vec![0.0; nx], vec![0.0; nx]];
    for j in 0..ny {
        rows.iter_mut().zip([up, down]).for_each(|(row, sweep)| sweep.read(0, j, row));
        phi.data.extend(rows[0].iter().zip(&rows[1]).map(mixed));
    }
    phi
}

/// Whether a blend whose holes are cut out has lost an overlap: see [`mend`]. `outside` tells of a pixel of the tile.
pub fn is_broken(pair: &SweepPair<'_>, outside: impl Fn(usize) -> bool) -> bool {
    pair.anchors.iter().any(|anchor| outside(*anchor))
}

/// Puts back what the blend of slice `k` has lost: holes are cut out again, overlaps of the two contours are joined.
pub fn mend(pair: &SweepPair<'_>, k: usize, phi: &mut Field) {
    let t = pair.up.times[k];
    for (cap, direction) in pair.holes.iter() {
        cap.tile.cut_out(&cap.field, cap.offset(direction.away(t)), phi);
    }
    for &anchor in &pair.anchors {
        if phi.data[anchor] >= 0.0 {
            hold(phi, pair, anchor);
        }
    }
}

/// Puts the overlap of the two contours around `anchor` back where the blend has lost it, so that what overlaps is connected.
fn hold(phi: &mut Field, pair: &SweepPair<'_>, anchor: usize) {
    let overlap = |n: usize| pair.up.source.data[n].max(pair.up.goal.data[n]);
    let [nx, ny] = phi.dims;
    let mut seen = vec![false; phi.data.len()];
    let mut open = vec![anchor];
    while let Some(node) = open.pop() {
        if std::mem::replace(&mut seen[node], true) || overlap(node) >= 0.0 {
            continue;
        }
        phi.data[node] = phi.data[node].min(overlap(node));
        let (i, j) = (node % nx, node / nx);
        open.extend((i > 0).then(|| node - 1));
        open.extend((i + 1 < nx).then_some(node + 1));
        open.extend((j > 0).then(|| node - nx));
        open.extend((j + 1 < ny).then_some(node + nx));
    }
}
