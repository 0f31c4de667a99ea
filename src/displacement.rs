//! A smooth displacement between two contours: one vector per block of pixels, read bilinearly.
//!
//! The displacement v of an interval lives in its mid frame: what lies at `x - v/2` in the lower slice lies at `x + v/2` in the upper one.
//! Vectors are in pixels of the image.

use std::ops::Range;
use std::sync::Arc;

use crate::field::Field;
use crate::packed::Packed;
use crate::shelf::{Array, Large};

/// Side of a block, px.
pub const BLOCK: usize = 4;
/// Fixed-point passes that find the trajectory through a point.
pub const PASSES: usize = 3;
/// Gaussian means over blocks are cut here, sigmas.
const TRUNCATE: f64 = 3.0;

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

    /// The displacement with a value for every block centre, which `f` is given in pixels, with the block's own vector.
    pub fn map(&self, f: impl Fn([f64; 2], [f64; 2]) -> [f64; 2]) -> Self {
        let mut vectors = Vec::with_capacity(self.vectors.len());
        for (row, blocks) in self.vectors.chunks_exact(self.grid[0]).enumerate() {
            vectors.extend(blocks.iter().enumerate().map(|(column, &v)| f([centre(column), centre(row)], v)));
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

    /// The vectors at pixels of row `j` from `first` on. The blocks above and below are brought to the row once for all pixels between.
    pub fn read_row(&self, j: usize, first: usize, out: &mut [[f64; 2]]) {
        let (row, fy) = self.place(1, j as f64);
        let (below, above) = self.vectors[row * self.grid[0]..][..2 * self.grid[0]].split_at(self.grid[0]);
        let in_row = |k: usize| mix(below[k], above[k], fy);
        let mut held = usize::MAX;
        let (mut left, mut right) = ([0.0; 2], [0.0; 2]);
        for (i, slot) in (first..).zip(out) {
            let (column, fx) = self.place(0, i as f64);
            if column != held {
                left = if held != usize::MAX && column == held + 1 { right } else { in_row(column) };
                (right, held) = (in_row(column + 1), column);
            }
            *slot = mix(left, right, fx);
        }
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
        let passes = if tau == 0.0 { 0 } else { PASSES };
        self.map(|x, v| (0..passes).fold(v, |u, _| self.at([x[0] - tau * u[0], x[1] - tau * u[1]])))
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
pub fn smooth<const C: usize>(values: &mut Vec<[f64; C]>, [nx, ny]: [usize; 2], sigma: [f64; 2]) {
    for (axis, count, stride) in [(0, nx, 1), (1, ny, nx)] {
        let weights = weights(sigma[axis]);
        let reach = weights.len() / 2;
        let from = std::mem::take(values);
        *values = (0..nx * ny)
            .map(|k| {
                let at = if axis == 0 { k % nx } else { k / nx };
                let origin = k - at * stride;
                let mut sum = [0.0; C];
                for (n, w) in weights.iter().enumerate() {
                    let reading = (at + n).saturating_sub(reach).min(count - 1);
                    sum.iter_mut().zip(&from[origin + reading * stride]).for_each(|(s, v)| *s += w * v);
                }
                sum
            })
            .collect();
    }
}

/// Weights of a Gaussian mean, as many to either side; their sum is 1.
pub fn weights(sigma: f64) -> Vec<f64> {
    let reach = (TRUNCATE * sigma + 0.5) as i64;
    let raw: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|w| w / sum).collect()
}
