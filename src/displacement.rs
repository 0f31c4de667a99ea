//! A smooth displacement between two contours: one vector per block of pixels, read bilinearly.
//!
//! The displacement v of an interval lives in its mid frame: what lies at `x - v/2` in the lower slice lies at `x + v/2` in the upper one.
//! Vectors are in pixels of the image.

use std::ops::Range;
use std::sync::Arc;

use multiversion::multiversion;

use crate::field::Field;
use crate::packed::Packed;
use crate::shelf::{Array, Large};

/// Side of a block, px.
pub const BLOCK: usize = 4;
/// Places of pixels between the centres of two blocks.
const PLACES: [f64; BLOCK] = [0.125, 0.375, 0.625, 0.875];
/// Fixed-point passes that find the trajectory through a point.
pub const PASSES: usize = 3;
/// Gaussian means over blocks are cut here, sigmas.
const TRUNCATE: f64 = 3.0;

/// Blocks that are worked on at once.
pub const LANES: usize = 32;
/// Positions or vectors of as many blocks: along x, along y.
pub type Lanes = [[f64; LANES]; 2];

/// A vector per block.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    /// Blocks `[columns, rows]`.
    pub grid: [usize; 2],
    /// Vectors at the blocks' centres, row-major, pixels of the image.
    pub vectors: Vec<[f64; 2]>,
}

impl Large for Displacement {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        vec![&mut self.vectors]
    }
}

impl Large for [Displacement; 2] {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        self.iter_mut().map(|d| &mut d.vectors as Array<'_>).collect()
    }
}

/// A displacement that is only read, and takes little memory where nothing moves.
#[derive(Debug, Clone)]
pub struct Resting {
    grid: [usize; 2],
    vectors: Packed<[f64; 2]>,
}

impl Resting {
    /// The vector at `x`, as [`Displacement::at`] gives it.
    #[inline(always)]
    pub fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let ((column, fx), (row, fy)) = (place(self.grid[0], x[0]), place(self.grid[1], x[1]));
        bilinear(self.vectors.corners(column, row, 1, 1), [fx, fy])
    }
}

impl From<&Displacement> for Resting {
    fn from(v: &Displacement) -> Self {
        Resting { grid: v.grid, vectors: Packed::of(v.grid, &v.vectors) }
    }
}

/// Ask for the displacements of neighbouring intervals.
#[derive(Debug, Clone)]
pub struct DisplacementJob<'a> {
    /// Signed distances of the slices, px; one more than intervals.
    pub fields: &'a [Arc<Field>],
    /// Heights of the intervals.
    pub gaps: &'a [f64],
    /// What each is drawn to where the fields say nothing.
    pub guess: &'a [Displacement],
    /// What the first of the rounds begins with.
    pub begin: &'a [Displacement],
    /// Rounds, of [`crate::reference::displacement::ROUNDS`].
    pub rounds: Range<usize>,
    /// Pixel sides.
    pub h: [f64; 2],
}

impl Displacement {
    /// No displacement on an image of these pixels.
    pub fn zero(dims: [usize; 2]) -> Self {
        let grid = dims.map(|n| n.div_ceil(BLOCK).max(2));
        Displacement { grid, vectors: vec![[0.0; 2]; grid[0] * grid[1]] }
    }

    /// The displacement with a value for every block, of which `f` is given number, centre (pixels) and own vector.
    pub fn map(&self, f: impl Fn(usize, [f64; 2], [f64; 2]) -> [f64; 2]) -> Self {
        let mut vectors = Vec::with_capacity(self.vectors.len());
        for (row, blocks) in self.vectors.chunks_exact(self.grid[0]).enumerate() {
            let first = row * self.grid[0];
            let of = |(column, &v)| f(first + column, [centre(column), centre(row)], v);
            vectors.extend(blocks.iter().enumerate().map(of));
        }
        Displacement { grid: self.grid, vectors }
    }

    /// Centre of a block, pixels.
    pub fn centre(&self, k: usize) -> [f64; 2] {
        [k % self.grid[0], k / self.grid[0]].map(centre)
    }

    /// The vector at `x`; beyond the blocks' centres that of the nearest.
    #[inline(always)]
    pub fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let ((column, fx), (row, fy)) = (self.place(0, x[0]), self.place(1, x[1]));
        let k = row * self.grid[0] + column;
        let (below, above) = (&self.vectors[k..k + 2], &self.vectors[k + self.grid[0]..][..2]);
        bilinear([below[0], below[1], above[0], above[1]], [fx, fy])
    }

    /// The vectors at pixels of row `j` from `first` on.
    pub fn read_row(&self, j: usize, first: usize, out: &mut [[f64; 2]]) {
        read_row(self, j, first, out);
    }

    /// Bounds `[least, largest]` of the vectors at the pixels from `first` to `last`, both included.
    pub fn range(&self, first: [usize; 2], last: [usize; 2]) -> [[f64; 2]; 2] {
        let [columns, rows] = [0, 1].map(|a| self.place(a, first[a] as f64).0..=self.place(a, last[a] as f64).0 + 1);
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for k in rows.flat_map(|row| columns.clone().map(move |column| row * self.grid[0] + column)) {
            for (a, v) in self.vectors[k].into_iter().enumerate() {
                bounds[0][a] = bounds[0][a].min(v);
                bounds[1][a] = bounds[1][a].max(v);
            }
        }
        bounds
    }

    /// Along an axis the block before a position, and the place between it and the next.
    #[inline(always)]
    fn place(&self, axis: usize, x: f64) -> (usize, f64) {
        place(self.grid[axis], x)
    }

    /// Displacements of the trajectories that pass through the blocks' centres x at time `1/2 + tau`: `u = v(x - tau u)`.
    pub fn through(&self, tau: f64) -> Self {
        if tau == 0.0 {
            return self.clone();
        }
        self.map_lanes(|_, x, v| {
            (0..PASSES).fold(*v, |u, _| {
                let back = |a: usize| std::array::from_fn(|k| x[a][k] - tau * u[a][k]);
                self.at_lanes(&[back(0), back(1)])
            })
        })
    }

    /// The displacement with values for some blocks at once, of which `f` is given the number of the first, centres and own vectors. What
    /// lanes beyond the last block of a row hold does not count.
    pub fn map_lanes(&self, f: impl Fn(usize, &Lanes, &Lanes) -> Lanes) -> Self {
        let mut vectors = Vec::with_capacity(self.vectors.len());
        for (row, blocks) in self.vectors.chunks_exact(self.grid[0]).enumerate() {
            for (part, some) in blocks.chunks(LANES).enumerate() {
                let first = part * LANES;
                let x = [std::array::from_fn(|k| centre(first + k)), [centre(row); LANES]];
                let own = [0, 1].map(|a| std::array::from_fn(|k| some.get(k).map_or(0.0, |v| v[a])));
                let [along, across] = f(row * self.grid[0] + first, &x, &own);
                vectors.extend(along.into_iter().zip(across).map(|(x, y)| [x, y]).take(some.len()));
            }
        }
        Displacement { grid: self.grid, vectors }
    }

    /// The vectors at some positions, each as [`Displacement::at`] gives it.
    pub fn at_lanes(&self, x: &Lanes) -> Lanes {
        at_lanes(self, x)
    }

    /// The same read at the pixels of the lower and of the upper slice.
    pub fn at_slices(&self) -> [Self; 2] {
        [-0.5, 0.5].map(|tau| self.through(tau))
    }

    /// Largest component of any vector, px.
    pub fn largest(&self) -> f64 {
        self.vectors.iter().flatten().fold(0.0, |m, v| m.max(v.abs()))
    }
}

/// See [`Displacement::at_lanes`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn at_lanes(v: &Displacement, x: &Lanes) -> Lanes {
    let (mut cells, mut places) = ([[0u32; LANES]; 2], [[0.0; LANES]; 2]);
    for a in 0..2 {
        for k in 0..LANES {
            let (before, place) = place(v.grid[a], x[a][k]);
            (cells[a][k], places[a][k]) = (before as u32, place);
        }
    }
    let mut corners = [[[0.0; LANES]; 2]; 4];
    for k in 0..LANES {
        let first = cells[1][k] as usize * v.grid[0] + cells[0][k] as usize;
        let (below, above) = (&v.vectors[first..][..2], &v.vectors[first + v.grid[0]..][..2]);
        for (corner, vector) in corners.iter_mut().zip(below.iter().chain(above)) {
            (corner[0][k], corner[1][k]) = (vector[0], vector[1]);
        }
    }
    let mut out = [[0.0; LANES]; 2];
    for (a, out) in out.iter_mut().enumerate() {
        for k in 0..LANES {
            let (fx, fy) = (places[0][k], places[1][k]);
            let low = (1.0 - fx) * corners[0][a][k] + fx * corners[1][a][k];
            let high = (1.0 - fx) * corners[2][a][k] + fx * corners[3][a][k];
            out[k] = (1.0 - fy) * low + fy * high;
        }
    }
    out
}

/// See [`Displacement::read_row`]. The blocks above and below are brought to the row once for all pixels between.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn read_row(v: &Displacement, j: usize, first: usize, mut out: &mut [[f64; 2]]) {
    let (row, fy) = v.place(1, j as f64);
    let (below, above) = v.vectors[row * v.grid[0]..][..2 * v.grid[0]].split_at(v.grid[0]);
    let in_row = |k: usize| mix(below[k], above[k], fy);
    let mut before = v.place(0, first as f64).0;
    let [mut left, mut right] = [in_row(before), in_row(before + 1)];
    let mut i = first;
    while !out.is_empty() {
        // Pixels until the next block's centre.
        let count = (BLOCK - (i + BLOCK / 2) % BLOCK).min(out.len());
        let (some, rest) = std::mem::take(&mut out).split_at_mut(count);
        let (column, fx) = v.place(0, i as f64);
        if column != before {
            (left, right, before) = (right, in_row(column + 1), column);
        }
        if fx == PLACES[0] && count == BLOCK {
            some.iter_mut().zip(PLACES).for_each(|(slot, f)| *slot = mix(left, right, f));
        } else {
            let place = |k: usize| v.place(0, (i + k) as f64).1;
            some.iter_mut().enumerate().for_each(|(k, slot)| *slot = mix(left, right, place(k)));
        }
        (i, out) = (i + count, rest);
    }
}

/// Along an axis of so many blocks the block before a position, and the place between it and the next.
#[inline(always)]
fn place(blocks: usize, x: f64) -> (usize, f64) {
    let at = (x - 0.5 * (BLOCK - 1) as f64) / BLOCK as f64;
    let at = at.clamp(0.0, (blocks - 1) as f64);
    // Through u32: cheaper than to usize.
    let before = (at as u32 as usize).min(blocks - 2);
    (before, at - before as f64)
}

/// The vector at place `[fx, fy]` between four, row by row.
#[inline(always)]
fn bilinear([a, b, c, d]: [[f64; 2]; 4], [fx, fy]: [f64; 2]) -> [f64; 2] {
    let in_row = |v: [f64; 2], w: [f64; 2], k: usize| (1.0 - fx) * v[k] + fx * w[k];
    let both = |k: usize| (1.0 - fy) * in_row(a, b, k) + fy * in_row(c, d, k);
    [both(0), both(1)]
}

/// Where along an axis the centre of a block lies, pixels.
#[inline(always)]
fn centre(block: usize) -> f64 {
    (block * BLOCK) as f64 + 0.5 * (BLOCK - 1) as f64
}

/// The vector at place `f` between two.
#[inline(always)]
fn mix(a: [f64; 2], b: [f64; 2], f: f64) -> [f64; 2] {
    [(1.0 - f) * a[0] + f * b[0], (1.0 - f) * a[1] + f * b[1]]
}

/// Gaussian means over blocks, the edge repeated. `sigma` in blocks.
pub fn smooth<const C: usize>(values: &mut [[f64; C]], [nx, ny]: [usize; 2], sigma: [f64; 2]) {
    let values = values.as_flattened_mut();
    let (row, mut from) = (nx * C, values.to_vec());
    let across = weights(sigma[0]);
    let reach = across.len() / 2;
    let mut line = Vec::with_capacity(row + 2 * reach * C);
    for (sums, given) in values.chunks_exact_mut(row).zip(from.chunks_exact(row)) {
        line.clear();
        (0..reach).for_each(|_| line.extend_from_slice(&given[..C]));
        line.extend_from_slice(given);
        (0..reach).for_each(|_| line.extend_from_slice(&given[row - C..]));
        sums.fill(0.0);
        for (n, w) in across.iter().enumerate() {
            add_scaled(sums, &line[n * C..][..row], *w);
        }
    }
    from.copy_from_slice(values);
    let along = weights(sigma[1]);
    let reach = along.len() / 2;
    for (j, sums) in values.chunks_exact_mut(row).enumerate() {
        sums.fill(0.0);
        for (n, w) in along.iter().enumerate() {
            let reading = (j + n).saturating_sub(reach).min(ny - 1);
            add_scaled(sums, &from[reading * row..][..row], *w);
        }
    }
}

/// Adds `w` times `values` to `sums`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn add_scaled(sums: &mut [f64], values: &[f64], w: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += w * v);
}

/// Weights of a Gaussian mean, as many to either side; their sum is 1.
pub fn weights(sigma: f64) -> Vec<f64> {
    let reach = (TRUNCATE * sigma + 0.5) as i64;
    let raw: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_read_what_each_position_reads() {
        for grid in [[2, 2], [7, 3], [33, 9], [70, 4]] {
            let value = |k: usize| [(k as f64 * 0.7).sin() * 9.0, (k as f64 * 1.3).cos() * 5.0];
            let v = Displacement { grid, vectors: (0..grid[0] * grid[1]).map(value).collect() };
            // Within the image and beyond it on all sides.
            let far = |a: usize, k: usize| (k as f64 * 0.377 + a as f64).sin() * 0.7 * (grid[a] * BLOCK) as f64;
            let x: Lanes = [0, 1].map(|a| std::array::from_fn(|k| 0.5 * (grid[a] * BLOCK) as f64 + far(a, k)));
            let read = v.at_lanes(&x);
            for k in 0..LANES {
                assert_eq!([read[0][k], read[1][k]], v.at([x[0][k], x[1][k]]), "{grid:?}, {k}");
            }
            // Every block once, whatever is beyond the last of a row.
            assert_eq!(v.map_lanes(|_, _, own| *own), v);
            let centres = v.map_lanes(|_, x, _| *x);
            (0..v.vectors.len()).for_each(|k| assert_eq!(centres.vectors[k], v.centre(k)));
            let numbers = v.map_lanes(|first, _, _| [std::array::from_fn(|k| (first + k) as f64), [0.0; LANES]]);
            (0..v.vectors.len()).for_each(|k| assert_eq!(numbers.vectors[k][0], k as f64));
        }
    }
}
