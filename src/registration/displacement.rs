//! A smooth displacement between two contours: one vector per node of a grid, read bilinearly.
//!
//! Nodes are [`BLOCK`] pixels apart, centred on the image, so that an image turned by 90 degrees or mirrored has the same nodes; with an
//! odd number of pixels between the outermost ones they lie half way between pixels.
//!
//! The displacement v of an interval lives in its mid frame: what lies at `x - v/2` in the lower slice lies at `x + v/2` in the upper one.
//! Vectors are in pixels of the image.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec2;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::grid::field::{Field, WHOLE};
use crate::grid::sparse_image::SparseImage;
use crate::storage::spill::{Array, Large};

/// Distance between two nodes, px.
pub const BLOCK: usize = 4;
/// Fixed-point passes that find the trajectory through a point.
pub const PASSES: usize = 3;
/// Gaussian means over nodes are cut here, sigmas.
const TRUNCATE: f64 = 3.0;

/// Nodes that are worth a thread.
pub const NODES_OF_A_THREAD: usize = 1 << 13;

/// Nodes that are worked on at once.
pub const LANES: usize = 32;
/// Positions or vectors of as many nodes: along x, along y.
pub type Lanes = [[f64; LANES]; 2];

/// A vector per node.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    /// Nodes `[columns, rows]`.
    pub grid: [usize; 2],
    /// Place of the first node, pixels: a multiple of a half, not above 0.
    pub origin: DVec2,
    /// Vectors at the nodes, row-major, pixels of the image.
    pub vectors: Vec<DVec2>,
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
    origin: DVec2,
    vectors: SparseImage<DVec2>,
}

impl Resting {
    /// The vector at `x`, as [`Displacement::at`] gives it.
    #[inline(always)]
    pub fn at(&self, x: DVec2) -> DVec2 {
        let [(column, fx), (row, fy)] = [0, 1].map(|a| place(self.grid[a], self.origin[a], x[a]));
        bilinear(self.vectors.corners(column, row, 1, 1), [fx, fy])
    }
}

impl From<&Displacement> for Resting {
    fn from(v: &Displacement) -> Self {
        Resting { grid: v.grid, origin: v.origin, vectors: SparseImage::of(v.grid, &v.vectors) }
    }
}

/// Ask for the displacements of neighbouring intervals.
#[derive(Debug, Clone)]
pub struct DisplacementJob<'a> {
    /// Signed distances of the slices, px; one more than intervals.
    pub fields: &'a [Arc<Field>],
    /// Heights of the intervals.
    pub gaps: &'a [f64],
    /// Displacement that each is drawn to where the fields say nothing.
    pub guess: &'a [Displacement],
    /// Displacement that the first of the rounds begins with.
    pub begin: &'a [Displacement],
    /// Rounds, of [`crate::reference::displacement::ROUNDS`].
    pub rounds: Range<usize>,
    /// Pixel sides.
    pub h: [f64; 2],
}

impl Displacement {
    /// No displacement on an image of these pixels.
    pub fn zero(dims: [usize; 2]) -> Self {
        let last = dims.map(|n| n.saturating_sub(1));
        let grid = last.map(|n| n.div_ceil(BLOCK) + 1).map(|nodes| nodes.max(2));
        let origin = [0, 1].map(|a| 0.5 * (last[a] as f64 - (BLOCK * (grid[a] - 1)) as f64));
        Displacement { grid, origin: origin.into(), vectors: vec![DVec2::ZERO; grid[0] * grid[1]] }
    }

    /// A displacement of the same nodes with other vectors.
    pub fn with(&self, vectors: Vec<DVec2>) -> Self {
        Displacement { grid: self.grid, origin: self.origin, vectors }
    }

    /// The displacement with a value for every node, of which `f` is given number, place (pixels) and own vector.
    pub fn map(&self, f: impl Fn(usize, DVec2, DVec2) -> DVec2 + Sync) -> Self {
        self.map_rows(|row, nodes, out| {
            let first = row * self.grid[0];
            for (column, (&v, to)) in nodes.iter().zip(out).enumerate() {
                *to = f(first + column, DVec2::new(self.along(0, column), self.along(1, row)), v);
            }
        })
    }

    /// The displacement with other vectors, which `f` writes row by row from the number of the row and its own: large ones by all threads.
    fn map_rows(&self, f: impl Fn(usize, &[DVec2], &mut [DVec2]) + Sync) -> Self {
        let mut vectors = vec![DVec2::ZERO; self.vectors.len()];
        // No displacement at all has no columns.
        let columns = self.grid[0].max(1);
        let row = |(row, (nodes, out)): (usize, (&[DVec2], &mut [DVec2]))| f(row, nodes, out);
        if vectors.len() < 2 * NODES_OF_A_THREAD {
            // Handing it over would cost more.
            self.vectors.chunks_exact(columns).zip(vectors.chunks_exact_mut(columns)).enumerate().for_each(row);
        } else {
            let rows = self.vectors.par_chunks_exact(columns).zip(vectors.par_chunks_exact_mut(columns));
            rows.enumerate().with_min_len(NODES_OF_A_THREAD.div_ceil(columns)).for_each(row);
        }
        self.with(vectors)
    }

    /// A displacement with a vector for every node of this and of others of the same nodes.
    pub fn zip<const N: usize>(&self, others: [&Self; N], f: impl Fn(DVec2, [DVec2; N]) -> DVec2 + Sync) -> Self {
        self.map_rows(|row, nodes, out| {
            let first = row * self.grid[0];
            for (k, (v, to)) in (first..).zip(nodes.iter().zip(out)) {
                *to = f(*v, others.map(|other| other.vectors[k]));
            }
        })
    }

    /// Place of node `k`, pixels.
    pub fn centre(&self, k: usize) -> DVec2 {
        DVec2::new(self.along(0, k % self.grid[0]), self.along(1, k / self.grid[0]))
    }

    /// Place along an axis of a column or row of nodes, pixels.
    #[inline(always)]
    fn along(&self, axis: usize, node: usize) -> f64 {
        self.origin[axis] + (node * BLOCK) as f64
    }

    /// The four nodes around `x` with their weights, by which `x` reads them and is spread over them: tents `1 - |x - node| / BLOCK`.
    pub fn around(&self, x: DVec2) -> [(usize, f64); 4] {
        let [(column, fx), (row, fy)] = [0, 1].map(|a| self.place(a, x[a]));
        let k = row * self.grid[0] + column;
        let (low, high) = (1.0 - fy, fy);
        [
            (k, low * (1.0 - fx)),
            (k + 1, low * fx),
            (k + self.grid[0], high * (1.0 - fx)),
            (k + self.grid[0] + 1, high * fx),
        ]
    }

    /// The nodes nearest to `x`: more than one where it lies half way.
    pub fn nearest(&self, x: DVec2) -> impl Iterator<Item = usize> + use<> {
        let [columns, rows] = [0, 1].map(|a| {
            let (before, place) = self.place(a, x[a]);
            before + usize::from(place > 0.5)..=before + usize::from(place >= 0.5)
        });
        let across = self.grid[0];
        rows.flat_map(move |row| columns.clone().map(move |column| row * across + column))
    }

    /// The vector at `x`; beyond the nodes that of the nearest.
    #[inline(always)]
    pub fn at(&self, x: DVec2) -> DVec2 {
        let ((column, fx), (row, fy)) = (self.place(0, x[0]), self.place(1, x[1]));
        let k = row * self.grid[0] + column;
        let (below, above) = (&self.vectors[k..k + 2], &self.vectors[k + self.grid[0]..][..2]);
        bilinear([below[0], below[1], above[0], above[1]], [fx, fy])
    }

    /// Bounds `[least, largest]` of the vectors at the pixels from `first` to `last`, both included.
    pub fn range(&self, first: [usize; 2], last: [usize; 2]) -> [DVec2; 2] {
        let [columns, rows] = [0, 1].map(|a| self.place(a, first[a] as f64).0..=self.place(a, last[a] as f64).0 + 1);
        let nodes = rows.flat_map(|row| columns.clone().map(move |column| row * self.grid[0] + column));
        let vectors = nodes.map(|k| self.vectors[k]);
        vectors.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[least, largest], v| [least.min(v), largest.max(v)])
    }

    /// Along an axis the node before a position, and the place between it and the next.
    #[inline(always)]
    pub fn place(&self, axis: usize, x: f64) -> (usize, f64) {
        place(self.grid[axis], self.origin[axis], x)
    }

    /// Displacements of the trajectories that pass through the nodes x at time `1/2 + tau`: `u = v(x - tau u)`.
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

    /// The displacement with values for some nodes at once, of which `f` is given the number of the first, places and own vectors. What
    /// lanes beyond the last node of a row hold does not count.
    pub fn map_lanes(&self, f: impl Fn(usize, &Lanes, &Lanes) -> Lanes + Sync) -> Self {
        self.map_rows(|row, nodes, out| {
            for (part, (some, out)) in nodes.chunks(LANES).zip(out.chunks_mut(LANES)).enumerate() {
                let first = part * LANES;
                let (x, own) = self.lanes(row, first, some);
                let [along, across] = f(row * self.grid[0] + first, &x, &own);
                out.iter_mut().zip(along.into_iter().zip(across)).for_each(|(to, v)| *to = DVec2::from(v));
            }
        })
    }

    /// Two displacements with values for some nodes at once, as [`Displacement::map_lanes`] makes one; `f` is given places and own vectors.
    pub fn map_lanes_twice(&self, f: impl Fn(&Lanes, &Lanes) -> [Lanes; 2] + Sync) -> [Self; 2] {
        let mut vectors = [(); 2].map(|()| vec![DVec2::ZERO; self.vectors.len()]);
        let columns = self.grid[0].max(1);
        let row = |row: usize, nodes: &[DVec2], [a, b]: [&mut [DVec2]; 2]| {
            let parts = nodes.chunks(LANES).zip(a.chunks_mut(LANES)).zip(b.chunks_mut(LANES));
            for (part, ((some, a), b)) in parts.enumerate() {
                let (x, own) = self.lanes(row, part * LANES, some);
                for (out, [along, across]) in [a, b].into_iter().zip(f(&x, &own)) {
                    out.iter_mut().zip(along.into_iter().zip(across)).for_each(|(to, v)| *to = DVec2::from(v));
                }
            }
        };
        let [a, b] = &mut vectors;
        if self.vectors.len() < 2 * NODES_OF_A_THREAD {
            let rows = self.vectors.chunks_exact(columns).zip(a.chunks_exact_mut(columns));
            let rows = rows.zip(b.chunks_exact_mut(columns)).enumerate();
            rows.for_each(|(j, ((nodes, a), b))| row(j, nodes, [a, b]));
        } else {
            let rows = self.vectors.par_chunks_exact(columns).zip(a.par_chunks_exact_mut(columns));
            let rows = rows.zip(b.par_chunks_exact_mut(columns)).enumerate();
            let rows = rows.with_min_len(NODES_OF_A_THREAD.div_ceil(columns));
            rows.for_each(|(j, ((nodes, a), b))| row(j, nodes, [a, b]));
        }
        vectors.map(|vectors| self.with(vectors))
    }

    /// Places and own vectors of `some` nodes of a row from column `first` on.
    #[inline]
    fn lanes(&self, row: usize, first: usize, some: &[DVec2]) -> (Lanes, Lanes) {
        let x = [std::array::from_fn(|k| self.along(0, first + k)), [self.along(1, row); LANES]];
        let own = [0, 1].map(|a| std::array::from_fn(|k| some.get(k).map_or(0.0, |v| v[a])));
        (x, own)
    }

    /// The vectors at some positions, each as [`Displacement::at`] gives it.
    pub fn at_lanes(&self, x: &Lanes) -> Lanes {
        at_lanes(self, x)
    }

    /// The displacement read at the pixels of the lower and of the upper slice.
    pub fn at_slices(&self) -> [Self; 2] {
        [-0.5, 0.5].map(|tau| self.through(tau))
    }

    /// Largest component of any vector, px.
    pub fn largest(&self) -> f64 {
        self.vectors.iter().flat_map(DVec2::to_array).fold(0.0, |m, v| m.max(v.abs()))
    }
}

/// See [`Displacement::at_lanes`].
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn at_lanes(v: &Displacement, x: &Lanes) -> Lanes {
    let (mut cells, mut places) = ([[0u32; LANES]; 2], [[0.0; LANES]; 2]);
    for a in 0..2 {
        let last = (v.grid[a] - 1) as f64;
        for k in 0..LANES {
            let at = ((x[a][k] - v.origin[a]) / BLOCK as f64).clamp(0.0, last);
            let before = at.floor().min(last - 1.0);
            // The last bits of such a sum are the whole number: other conversions are done one by one.
            (cells[a][k], places[a][k]) = ((before + WHOLE).to_bits() as u32, at - before);
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

/// Along an axis of so many nodes, the first at `origin`, the node before a position, and the place between it and the next.
#[inline(always)]
fn place(nodes: usize, origin: f64, x: f64) -> (usize, f64) {
    let at = ((x - origin) / BLOCK as f64).clamp(0.0, (nodes - 1) as f64);
    // Through u32: cheaper than to usize.
    let before = (at as u32 as usize).min(nodes - 2);
    (before, at - before as f64)
}

/// The vector at place `[fx, fy]` between four, row by row.
#[inline(always)]
fn bilinear([a, b, c, d]: [DVec2; 4], [fx, fy]: [f64; 2]) -> DVec2 {
    a.lerp(b, fx).lerp(c.lerp(d, fx), fy)
}

/// Gaussian means over nodes, the edge repeated. `sigma` in nodes.
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
    let raw: Vec<f64> = (-reach..=reach).map(|k| libm::exp(-0.5 * (k as f64 / sigma).powi(2))).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_read_what_each_position_reads() {
        for dims in [[2, 2], [25, 9], [130, 33], [279, 14]] {
            let value = |k: usize| DVec2::new((k as f64 * 0.7).sin() * 9.0, (k as f64 * 1.3).cos() * 5.0);
            let v = Displacement::zero(dims).map(|k, _, _| value(k));
            let grid = v.grid;
            // Within the image and beyond it on all sides.
            let far = |a: usize, k: usize| (k as f64 * 0.377 + a as f64).sin() * 0.7 * (grid[a] * BLOCK) as f64;
            let x: Lanes = [0, 1].map(|a| std::array::from_fn(|k| 0.5 * (grid[a] * BLOCK) as f64 + far(a, k)));
            let read = v.at_lanes(&x);
            for k in 0..LANES {
                assert_eq!([read[0][k], read[1][k]], v.at(DVec2::new(x[0][k], x[1][k])).to_array(), "{grid:?}, {k}");
            }
            // Every node once, whatever is beyond the last of a row.
            assert_eq!(v.map_lanes(|_, _, own| *own), v);
            let centres = v.map_lanes(|_, x, _| *x);
            (0..v.vectors.len()).for_each(|k| assert_eq!(centres.vectors[k], v.centre(k)));
            let numbers = v.map_lanes(|first, _, _| [std::array::from_fn(|k| (first + k) as f64), [0.0; LANES]]);
            (0..v.vectors.len()).for_each(|k| assert_eq!(numbers.vectors[k][0], k as f64));
        }
    }
}
