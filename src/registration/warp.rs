//! Warping: from the mid frame of an interval to the layers between its slices.

use glam::DVec2;
use multiversion::multiversion;

use crate::grid::field::{Field, position, sample, sample_smooth};
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::grid::spline::smoothstep;
use crate::registration::cells::{CELL, Cells, cells_of_square, probes};
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{MotionField, Paths};
use crate::registration::particle_weight::Trust;

/// Brings layers of interval `i` from its mid frame to where they belong.
pub struct Warp<'m> {
    moving: &'m MotionField,
    i: usize,
    /// Displacements from the slices to the mid frame.
    off: [Displacement; 2],
    /// Difference that the way to the mid frame and back makes to either slice, px.
    lost: [SparseImage<f64>; 2],
    limit: f64,
}

/// Place of a layer relative to the mid frame.
pub struct Way {
    t: f64,
    paths: Paths,
    to_middle: Displacement,
}

impl Way {
    /// Cells of the layer in which the morph does not have all of the say.
    pub fn doubts(&self, dims: [usize; 2], trust: &Trust) -> Cells {
        Cells::new(dims, |first, last| {
            let [low, high] = self.to_middle.range(first, last);
            let [from, to] = [first, last].map(|p| DVec2::from(p.map(|p| p as f64)));
            trust.doubts(from + low, to + high)
        })
    }
}

impl<'m> Warp<'m> {
    /// The warp of an interval whose slices are `low` and `high`, as they are (nothing where they are empty) and as what lies between them begins in
    /// the mid frame; distances count up to `limit` px.
    pub fn new(moving: &'m MotionField, i: usize, slices: [(Option<&Field>, &[f32]); 2], limit: f64) -> Self {
        let off = moving.off_slices(i, 0.5, &moving.paths(i, 0.5));
        let lost = [0, 1].map(|end| {
            let (own, seen) = slices[end];
            let way = way_to_middle(&moving.paths(i, end as f64), &off);
            let dims = moving.fields[i + end].dims;
            let [lost] = SparseImage::of_rows(dims, |first, [rows]: [&mut [f64]; 1]| {
                let Some(own) = own else { return };
                let nx = own.dims[0];
                for (n, lost) in (first * nx..).zip(rows) {
                    let (x, v) = (position(n, nx), own.data[n]);
                    if v.abs() < limit {
                        *lost = v - sample_smooth(seen, dims, x + way.at(x));
                    }
                }
            });
            lost
        });
        Warp { moving, i, off, lost, limit }
    }

    /// The way of the layer at time `t`.
    pub fn way(&self, t: f64) -> Way {
        let paths = self.moving.paths(self.i, t);
        let to_middle = way_to_middle(&paths, &self.off);
        Way { t, paths, to_middle }
    }

    /// A layer from its values in the mid frame, `seen`, row-major as the layer is, and both clamped; in the cells of `doubts` the layer `other` counts where trust is missing.
    /// Of other cells it is read at the [`probes`], as both layers tell whether a cell is far from any contour.
    pub fn layer(
        &self,
        seen: &[f32],
        way: &Way,
        trust: &Trust,
        doubts: &Cells,
        other: &SparseImage<f32>,
    ) -> SparseImage<f32> {
        let Way { t, paths, to_middle } = way;
        let dims = self.lost[0].dims();
        let [nx, ny] = dims;
        let limit = self.limit;
        let w = smoothstep(*t);
        let read = Read { seen, dims, lost: &self.lost, weights: [1.0 - w, w], limit };
        let [out] = SparseImage::of_squares(dims, |square, [out]| {
            for [left, top] in cells_of_square(square, dims) {
                let (right, bottom) = ((left + CELL).min(nx) - 1, (top + CELL).min(ny) - 1);
                let probes = probes([left, top], [right, bottom]);
                let doubtful = doubts.at(left, top);
                let at = |x: DVec2| sample(seen, dims, x + to_middle.at(x));
                let probed = probes.map(|p| at(p.map(|p| p as f64).into()));
                let others = probes.map(|[x, y]| f64::from(other.at(x, y)));
                let all = || probed.iter().chain(&others);
                let far = all().all(|v| *v >= limit) || all().all(|v| *v <= -limit);
                let [mut ways, mut come, mut go] = [[DVec2::ZERO; CELL]; 3];
                for y in top..=bottom {
                    let row = &mut out[y % SQUARE * SQUARE + left % SQUARE..][..=right - left];
                    if far {
                        row.fill(probed[0] as f32);
                        continue;
                    }
                    to_middle.read_row(y, left, &mut ways);
                    paths.come.read_row(y, left, &mut come);
                    paths.go.read_row(y, left, &mut go);
                    let others = doubtful.then(|| (trust, &other.row_of_square(left / SQUARE, y)[left % SQUARE..]));
                    values(&read, [left, y], [&ways, &come, &go], others, row);
                }
            }
            [None]
        });
        out
    }
}

/// Sources of a layer's values: those in the mid frame, and what the way there takes from either slice with its weight at this time.
struct Read<'a> {
    seen: &'a [f32],
    dims: [usize; 2],
    lost: &'a [SparseImage<f64>; 2],
    weights: [f64; 2],
    limit: f64,
}

/// Values at pixels of a row from `first` on, by their ways to the mid frame, from the lower slice and to the upper one; where trust may be
/// missing with the other method's values.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn values(
    read: &Read<'_>,
    first: [usize; 2],
    [ways, come, go]: [&[DVec2; CELL]; 3],
    others: Option<(&Trust, &[f32])>,
    row: &mut [f32],
) {
    for (k, out) in row.iter_mut().enumerate() {
        let x = DVec2::new((first[0] + k) as f64, first[1] as f64);
        let middle = x + ways[k];
        let low = read.lost[0].sample(x - come[k]);
        let high = read.lost[1].sample(x + go[k]);
        let v = sample_smooth(read.seen, read.dims, middle) + read.weights[0] * low + read.weights[1] * high;
        let v = others.map_or(v, |(trust, others)| {
            let trust = trust.at(middle);
            trust * v + (1.0 - trust) * f64::from(others[k])
        });
        *out = v.clamp(-read.limit, read.limit) as f32;
    }
}

/// Displacement from a layer's pixels to where their trajectories are in the mid frame: the mean of the ways over either slice.
fn way_to_middle(paths: &Paths, off: &[Displacement; 2]) -> Displacement {
    let mut way = paths.come.clone();
    let over = |slice: DVec2, off: &Displacement| slice + off.at(slice);
    for ((k, way), go) in way.vectors.iter_mut().enumerate().zip(&paths.go.vectors) {
        let x = paths.come.centre(k);
        *way = 0.5 * (over(x - *way, &off[0]) + over(x + go, &off[1])) - x;
    }
    way
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    const DIMS: [usize; 2] = [80, 60];

    #[test]
    fn a_value_is_that_of_the_mid_frame_and_what_the_way_there_lost_at_either_slice() {
        let at = |n: usize| position(n, DIMS[0]);
        let linear = |of: DVec2| (0..DIMS[0] * DIMS[1]).map(|n| of.dot(at(n))).collect::<Vec<f64>>();
        let [seen, low, high] = [[0.1, -0.05], [0.01, 0.02], [-0.03, 0.01]].map(DVec2::from);
        let shown: Vec<f32> = linear(seen).into_iter().map(|v| v as f32).collect();
        let lost = [low, high].map(|of| SparseImage::of(DIMS, &linear(of)));
        let read = Read { seen: &shown, dims: DIMS, lost: &lost, weights: [0.7, 0.4], limit: 3.0 };
        let [way, come, go] = [[1.0, 0.5], [0.5, -0.25], [1.5, 2.0]].map(DVec2::from);
        let first = [30, 20];
        let mut row = [0.0; CELL];
        values(&read, first, [&[way; CELL], &[come; CELL], &[go; CELL]], None, &mut row);
        let wanted: [f64; CELL] = std::array::from_fn(|k| {
            let x = DVec2::new((first[0] + k) as f64, first[1] as f64);
            (seen.dot(x + way) + 0.7 * low.dot(x - come) + 0.4 * high.dot(x + go)).clamp(-3.0, 3.0)
        });
        assert!(row.iter().zip(wanted).all(|(v, w)| (f64::from(*v) - w).abs() < 1e-5), "{row:?}, not {wanted:?}");
        assert!(wanted[0] < 2.5 && wanted[CELL - 1] > 2.5, "some of them differ");

        // Half of the say is the others'.
        let field = Arc::new(Field::filled(DIMS, 0.0));
        let fields = (0..2).map(|_| field.clone()).collect();
        let moving = MotionField::new(vec![0.0, 1.0], 1.0, fields, vec![Displacement::zero(DIMS)]);
        let half = Trust::new(&moving, 0, [1.0, 1.0], 0.0, (0..DIMS[0] * DIMS[1]).map(|n| (at(n), 0.875)));
        let others = [-1.0f32; CELL];
        let mut mixed = [0.0; CELL];
        values(&read, first, [&[way; CELL], &[come; CELL], &[go; CELL]], Some((&half, &others)), &mut mixed);
        let apart = mixed.iter().zip(wanted).map(|(v, w)| (f64::from(*v) - (0.5 * w - 0.5)).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-3, "{mixed:?}");
    }
}
