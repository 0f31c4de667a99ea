//! Layers read along trajectories.

use multiversion::multiversion;
use rayon::prelude::*;

use super::fairing::ReferenceFairing;
use super::fairing_nodes::{Near, Node};
use crate::grid::tiled::Packed;
use crate::registration::displacement::{BLOCK, Displacement, Resting};

/// Pixels that are read at once.
const AT_ONCE: usize = 4 * BLOCK;

impl ReferenceFairing<'_> {
    /// Offsets of the trajectories from node `k` to node `l` in the blocks near its surface, px of the image; `None` where they stand still.
    pub(super) fn offsets(&self, k: usize, l: usize) -> Option<Displacement> {
        let (_, pad) = self.frame.moving.filter(|_| k != l)?;
        let (from, to) = (self.node(k)?.made.as_ref()?, self.node(l)?.place()?);
        let (near, from) = (&from.near, from.place.as_ref()?);
        // The lowest node of every interval between both is among those that are kept.
        let intervals = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let of = |i| self.kept.iter().filter_map(Node::place).find(|place| place.interval == i);
        let between: Vec<&[Resting; 2]> = intervals.filter_map(of).map(|place| &*place.at_slices).collect();
        let mut offsets = Displacement::zero(self.frame.dims);
        let offset = |&(block, slices): &Near| {
            let (x, y) = (offsets.centre(block), from.carry(slices, to, &between));
            [0, 1].map(|a| y[a] - pad[a] as f64 - x[a])
        };
        let found: Vec<[f64; 2]> = near.par_iter().map(offset).collect();
        near.iter().zip(found).for_each(|((block, _), offset)| offsets.vectors[*block] = offset);
        Some(offsets)
    }
}

/// Adds `w` times the values of a layer at the pixels of row `j` from `first` on, or where their trajectories are.
pub fn add(v: &Packed<f32>, w: f32, offsets: Option<&Displacement>, j: usize, first: usize, out: &mut [f32]) {
    for (first, out) in (first..).step_by(AT_ONCE).zip(out.chunks_mut(AT_ONCE)) {
        let mut some = [0.0; AT_ONCE];
        match offsets {
            None => v.read(first, j, &mut some[..out.len()]),
            Some(offsets) => {
                let mut moved = [[0.0; 2]; AT_ONCE];
                offsets.read_row(j, first, &mut moved[..out.len()]);
                sample(v, [first, j], &moved, out.len(), &mut some);
            }
        }
        out.iter_mut().zip(some).for_each(|(sum, v)| *sum += w * v);
    }
}

/// Bilinear values of a layer at pixels of a row that have `moved`, of which the first is `origin`, the edge repeated.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn sample(v: &Packed<f32>, origin: [usize; 2], moved: &[[f64; 2]; AT_ONCE], count: usize, out: &mut [f32; AT_ONCE]) {
    let [nx, ny] = v.dims();
    let last = [nx, ny].map(|n| (n - 1) as f64);
    let before_last = [nx, ny].map(|n| n.saturating_sub(2) as u32);
    let (mut cells, mut places) = ([[0u32; AT_ONCE]; 2], [[0.0f32; AT_ONCE]; 2]);
    for axis in 0..2 {
        for k in 0..AT_ONCE {
            let along = if axis == 0 { k as f64 } else { 0.0 };
            let at = (origin[axis] as f64 + along + moved[k][axis]).clamp(0.0, last[axis]);
            let cell = (at as u32).min(before_last[axis]);
            cells[axis][k] = cell;
            places[axis][k] = (at - f64::from(cell)) as f32;
        }
    }
    let mut corners = [[0.0f32; AT_ONCE]; 4];
    for k in 0..count {
        let [i, j] = [cells[0][k] as usize, cells[1][k] as usize];
        let of = v.corners(i, j, usize::from(nx > 1), usize::from(ny > 1));
        (0..4).for_each(|c| corners[c][k] = of[c]);
    }
    for k in 0..AT_ONCE {
        let (fx, fy) = (places[0][k], places[1][k]);
        let low = (1.0 - fx) * corners[0][k] + fx * corners[1][k];
        let high = (1.0 - fx) * corners[2][k] + fx * corners[3][k];
        out[k] = (1.0 - fy) * low + fy * high;
    }
}
