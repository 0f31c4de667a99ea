//! Rows of pixels of a displacement: between nodes of a row vectors are read many at once.

use glam::DVec2;
use multiversion::multiversion;

use super::displacement::{BLOCK, Displacement};

impl Displacement {
    /// The vectors at pixels of row `j` from `first` on.
    pub fn read_row(&self, j: usize, first: usize, out: &mut [DVec2]) {
        read_row(self, j, first, out);
    }

    /// Row `j` of pixels, to be read.
    #[inline(always)]
    pub fn row(&self, j: usize) -> Row<'_> {
        let (row, fy) = self.place(1, j as f64);
        let (below, above) = self.vectors[row * self.grid[0]..][..2 * self.grid[0]].split_at(self.grid[0]);
        Row { v: self, below, above, fy }
    }
}

/// A row of pixels of a displacement.
pub struct Row<'v> {
    v: &'v Displacement,
    below: &'v [DVec2],
    above: &'v [DVec2],
    fy: f64,
}

/// Pixels of a row that are read at once, and nodes that these lie between at most.
pub const ROW_LANES: usize = 4 * BLOCK;
const ROW_NODES: usize = ROW_LANES / BLOCK + 2;

impl Row<'_> {
    /// The vectors at the pixels from `first` on, each as [`Displacement::read_row`] gives it; what lanes beyond the last pixel hold does not count.
    #[inline(always)]
    pub fn lanes(&self, first: usize) -> [[f64; ROW_LANES]; 2] {
        let (column, fx) = self.v.place(0, first as f64);
        let mut nodes = [[0.0; ROW_NODES]; 2];
        let [along, across] = &mut nodes;
        for (k, (x, y)) in along.iter_mut().zip(across).enumerate() {
            let node = (column + k).min(self.below.len() - 1);
            let at_row = self.below[node].lerp(self.above[node], self.fy);
            (*x, *y) = (at_row.x, at_row.y);
        }
        match pixels_before(fx) {
            0 | 1 => lanes_before::<1>(&nodes, fx),
            2 => lanes_before::<2>(&nodes, fx),
            3 => lanes_before::<3>(&nodes, fx),
            _ => lanes_before::<BLOCK>(&nodes, fx),
        }
    }
}

/// Pixels before the next node, the first at `fx`.
#[inline(always)]
fn pixels_before(fx: f64) -> usize {
    ((1.0 - fx) * BLOCK as f64).ceil() as usize
}

/// See [`Row::lanes`]: `BEFORE` pixels lie before the second node.
#[inline(always)]
fn lanes_before<const BEFORE: usize>(nodes: &[[f64; ROW_NODES]; 2], fx: f64) -> [[f64; ROW_LANES]; 2] {
    let mut out = [[0.0; ROW_LANES]; 2];
    for (nodes, out) in nodes.iter().zip(&mut out) {
        for (k, out) in out.iter_mut().enumerate() {
            let node = (k + BLOCK - BEFORE) / BLOCK;
            let s = fx + STEP * k as f64 - node as f64;
            *out = nodes[node] * (1.0 - s) + nodes[node + 1] * s;
        }
    }
    out
}

/// See [`Displacement::read_row`]. The nodes above and below are brought to the row once for all pixels between.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn read_row(v: &Displacement, j: usize, first: usize, mut out: &mut [DVec2]) {
    let (row, fy) = v.place(1, j as f64);
    let (below, above) = v.vectors[row * v.grid[0]..][..2 * v.grid[0]].split_at(v.grid[0]);
    let mut i = first;
    while !out.is_empty() {
        let (column, fx) = v.place(0, i as f64);
        let nodes = (&below[column..], &above[column..]);
        // Pixels before the next node; one at a time from the last node on.
        let count = pixels_before(fx).clamp(1, out.len());
        // Wherever the first pixel lies, all pairs of blocks lie alike.
        let pairs = (out.len() / PAIR).min((nodes.0.len() - 2) / 2);
        let taken = if pairs > 0 { pairs * PAIR } else { count };
        let (some, rest) = std::mem::take(&mut out).split_at_mut(taken);
        match count {
            _ if pairs == 0 => read_before(nodes, [fx, fy], some),
            1 => read_pairs::<1>(nodes, [fx, fy], some),
            2 => read_pairs::<2>(nodes, [fx, fy], some),
            3 => read_pairs::<3>(nodes, [fx, fy], some),
            _ => read_pairs::<BLOCK>(nodes, [fx, fy], some),
        }
        (i, out) = (i + taken, rest);
    }
}

/// Pixels of two blocks, which are read at once.
const PAIR: usize = 2 * BLOCK;
/// Side of a pixel as a share of a block's.
const STEP: f64 = 1.0 / BLOCK as f64;

/// The vectors at pixels of a row, the first at place `[fx, fy]` between nodes of two rows and all before the next ones.
#[inline(always)]
fn read_before((below, above): (&[DVec2], &[DVec2]), [fx, fy]: [f64; 2], out: &mut [DVec2]) {
    let [left, right] = [0, 1].map(|k| below[k].lerp(above[k], fy));
    out.iter_mut().enumerate().for_each(|(k, slot)| *slot = left.lerp(right, fx + STEP * k as f64));
}

/// Displacements at pairs of blocks, of whose pixels `BEFORE` lie before the next nodes.
#[inline(always)]
fn read_pairs<const BEFORE: usize>((below, above): (&[DVec2], &[DVec2]), [fx, fy]: [f64; 2], out: &mut [DVec2]) {
    for (pair, out) in out.chunks_exact_mut(PAIR).enumerate() {
        let (below, above) = (&below[2 * pair..][..4], &above[2 * pair..][..4]);
        let mut nodes = [DVec2::ZERO; 4];
        for (k, node) in nodes.iter_mut().enumerate() {
            *node = below[k].lerp(above[k], fy);
        }
        for (k, slot) in out.iter_mut().enumerate() {
            let node = (k + BLOCK - BEFORE) / BLOCK;
            *slot = nodes[node].lerp(nodes[node + 1], fx + STEP * k as f64 - node as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_of_a_row_read_what_each_pixel_reads() {
        for dims in [[2, 2], [5, 3], [25, 9], [64, 7], [130, 33]] {
            let value = |k: usize| DVec2::new((k as f64 * 0.7).sin() * 9.0, (k as f64 * 1.3).cos() * 5.0);
            let v = Displacement::zero(dims).map(|k, _, _| value(k));
            for j in 0..dims[1] {
                let mut row = vec![DVec2::ZERO; dims[0]];
                v.read_row(j, 0, &mut row);
                for first in 0..dims[0] {
                    let lanes = v.row(j).lanes(first);
                    for (k, v) in row[first..].iter().take(ROW_LANES).enumerate() {
                        assert_eq!([lanes[0][k], lanes[1][k]], v.to_array(), "{dims:?}: {first} + {k}, {j}");
                    }
                }
            }
        }
    }
}
