//! Pieces of a body or of what is around it, over layers: rows of a layer are cut into runs of pixels of one side, and what touches is joined.
//!
//! Pixels inside are joined through edges, within a layer and from layer to layer; pixels outside through edges and through the diagonals of
//! faces, as the mesh joins them ([`crate::surface::marching`]): a piece of either here is a piece of either there.

use std::ops::Range;

use crate::grid::sparse_image::{SQUARE, SparseImage};

/// The two sides of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// phi < 0.
    Inside,
    /// All else.
    Outside,
}

/// The runs of one side of a layer, row by row, and the connected parts that they make.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    /// Number of the first run of each row, and behind the last row's end.
    rows: Vec<u32>,
    /// First column of each run and the column after its last.
    runs: Vec<[u32; 2]>,
    /// Part of each run, from 0 in row order of the parts' first pixels.
    parts: Vec<u32>,
    /// Number of parts.
    pub count: usize,
    side: Option<Side>,
}

impl Runs {
    /// The runs inside and the runs outside in a layer.
    pub fn both(phi: &SparseImage<f32>) -> [Self; 2] {
        let mut out =
            [Side::Inside, Side::Outside].map(|side| Runs { rows: vec![0], side: Some(side), ..Runs::default() });
        let [nx, ny] = phi.dims();
        for j in 0..ny {
            // The run that is open: its side and its first column.
            let (mut inside, mut start) = (phi.at(0, j) < 0.0, 0);
            // Begins a run of the other side at a column.
            let mut turn = |inside: &mut bool, i: usize| {
                out[usize::from(!*inside)].runs.push([start as u32, i as u32]);
                (*inside, start) = (!*inside, i);
            };
            for (column, first) in (0..nx).step_by(SQUARE).enumerate() {
                if let Some(v) = phi.whole([column, j / SQUARE]) {
                    if (v < 0.0) != inside {
                        turn(&mut inside, first);
                    }
                    continue;
                }
                let row = &phi.square([column, j / SQUARE])[j % SQUARE * SQUARE..][..SQUARE.min(nx - first)];
                // A bit a pixel, and one where a pixel is on another side than the one before.
                let sides = row.iter().enumerate().fold(0u32, |sides, (k, v)| sides | u32::from(*v < 0.0) << k);
                let mut turns =
                    (sides ^ (sides << 1 | u32::from(inside))) & (u32::MAX >> (u32::BITS as usize - row.len()));
                while turns != 0 {
                    turn(&mut inside, first + turns.trailing_zeros() as usize);
                    turns &= turns - 1;
                }
            }
            turn(&mut inside, nx);
            out.iter_mut().for_each(|runs| runs.rows.push(runs.runs.len() as u32));
        }
        out.map(Runs::joined)
    }

    /// The runs of one side.
    pub fn new(phi: &SparseImage<f32>, side: Side) -> Self {
        let [inside, outside] = Runs::both(phi);
        if side == Side::Inside { inside } else { outside }
    }

    /// Finds the parts.
    fn joined(mut self) -> Self {
        let out = &mut self;
        let wider = out.side == Some(Side::Outside);
        let mut joined = DisjointSets::new(out.runs.len());
        for j in 1..out.rows.len() - 1 {
            touching(out, j - 1, out, j, wider, |a, b| joined.join(a, b));
        }
        // A run's root is the lowest run of its part: parts are numbered in row order.
        let mut number = vec![0; out.runs.len()];
        for k in 0..out.runs.len() {
            let root = joined.root(k);
            if root == k {
                number[k] = out.count as u32;
                out.count += 1;
            }
            out.parts.push(number[root]);
        }
        self
    }

    /// All runs: their row, their columns, their part.
    pub fn all(&self) -> impl Iterator<Item = (usize, Range<usize>, usize)> + '_ {
        let rows = self.rows.windows(2).enumerate();
        let runs = rows.flat_map(|(j, ends)| (ends[0] as usize..ends[1] as usize).map(move |k| (j, k)));
        runs.map(|(j, k)| (j, self.runs[k][0] as usize..self.runs[k][1] as usize, self.parts[k] as usize))
    }

    /// Pixels of each part.
    pub fn sizes(&self) -> Vec<usize> {
        let mut sizes = vec![0; self.count];
        self.all().for_each(|(_, columns, part)| sizes[part] += columns.len());
        sizes
    }

    /// Parts that reach the edge of an image `nx` pixels wide.
    pub fn at_edge(&self, nx: usize) -> impl Iterator<Item = usize> + '_ {
        let last = self.rows.len().saturating_sub(2);
        let edge = move |j: usize, run: &Range<usize>| j == 0 || j == last || run.start == 0 || run.end == nx;
        self.all().filter(move |(j, run, _)| edge(*j, run)).map(|(_, _, part)| part)
    }

    /// Shows pairs of parts that touch, the first here, the second on a neighbouring layer; a pair may come more than once.
    pub fn meeting(&self, other: &Runs, mut each: impl FnMut(usize, usize)) {
        let outside = self.side == Some(Side::Outside);
        let last = self.rows.len() - 1;
        for j in 0..last {
            let mut show = |a: usize, b: usize| each(self.parts[a] as usize, other.parts[b] as usize);
            touching(self, j, other, j, outside, &mut show);
            if outside && j > 0 {
                touching(self, j, other, j - 1, false, &mut show);
            }
            if outside && j + 1 < last {
                touching(self, j, other, j + 1, false, &mut show);
            }
        }
    }
}

/// Shows pairs of runs of row `i` of `a` and row `j` of `b` that share a column, or with `wider` have neighbouring ones.
fn touching(a: &Runs, i: usize, b: &Runs, j: usize, wider: bool, mut each: impl FnMut(usize, usize)) {
    let wider = u32::from(wider);
    let (mut k, mut l) = (a.rows[i] as usize, b.rows[j] as usize);
    let (end_k, end_l) = (a.rows[i + 1] as usize, b.rows[j + 1] as usize);
    while k < end_k && l < end_l {
        let ([a_start, a_end], [b_start, b_end]) = (a.runs[k], b.runs[l]);
        if a_start < b_end + wider && b_start < a_end + wider {
            each(k, l);
        }
        if a_end < b_end { k += 1 } else { l += 1 }
    }
}

/// Things that are joined pair by pair (union-find); the lowest of those that are joined stands for them.
#[derive(Debug, Clone, Default)]
pub struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// `count` things, each alone.
    pub fn new(count: usize) -> Self {
        DisjointSets { parent: (0..count as u32).collect() }
    }

    /// Adds `count` things, each alone; the number of the first.
    pub fn more(&mut self, count: usize) -> usize {
        let first = self.parent.len();
        self.parent.extend(first as u32..(first + count) as u32);
        first
    }

    /// Thing that stands for thing `k`.
    pub fn root(&mut self, mut k: usize) -> usize {
        while self.parent[k] as usize != k {
            self.parent[k] = self.parent[self.parent[k] as usize];
            k = self.parent[k] as usize;
        }
        k
    }

    /// Joins two things.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::{label4, label8};

    /// A random pattern, the same at every call.
    fn pattern(n: usize, seed: u32) -> Vec<f32> {
        let mut state = seed.wrapping_mul(2654435761).wrapping_add(12345);
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state
        };
        (0..n).map(|_| if next() % 100 < 45 { -1.0 } else { 1.0 }).collect()
    }

    #[test]
    fn parts_are_the_connected_components_in_their_order() {
        for (seed, dims) in (0..).zip([[1, 1], [7, 1], [1, 9], [13, 11], [40, 33]]) {
            let phi = pattern(dims[0] * dims[1], seed);
            let inside: Vec<bool> = phi.iter().map(|v| *v < 0.0).collect();
            let outside: Vec<bool> = inside.iter().map(|m| !m).collect();
            for (side, known) in [(Side::Inside, label4(&inside, dims)), (Side::Outside, label8(&outside, dims))] {
                let runs = Runs::new(&SparseImage::of(dims, &phi), side);
                let mut labels = vec![0; phi.len()];
                for (j, columns, part) in runs.all() {
                    labels[j * dims[0]..][columns].fill(part as u32 + 1);
                }
                assert_eq!((labels, runs.count), (known.labels, known.count), "{dims:?} {side:?}");
            }
        }
    }

    #[test]
    fn layers_touch_where_their_pixels_do() {
        let [nx, ny] = [19, 14];
        let (low, high) = (pattern(nx * ny, 5), pattern(nx * ny, 6));
        for side in [Side::Inside, Side::Outside] {
            let own = |v: f32| (v < 0.0) == (side == Side::Inside);
            let [a, b] = [&low, &high].map(|phi| Runs::new(&SparseImage::of([nx, ny], phi), side));
            let part = |runs: &Runs, n: usize| {
                runs.all().find(|(j, run, _)| *j == n / nx && run.contains(&(n % nx))).map(|r| r.2)
            };
            let mut expected = std::collections::BTreeSet::new();
            for (n, here) in low.iter().enumerate() {
                let (i, j) = (n % nx, n / nx);
                let mut there = vec![n];
                if side == Side::Outside {
                    there.extend((i > 0).then(|| n - 1));
                    there.extend((i + 1 < nx).then_some(n + 1));
                    there.extend((j > 0).then(|| n - nx));
                    there.extend((j + 1 < ny).then_some(n + nx));
                }
                for m in there.into_iter().filter(|&m| own(*here) && own(high[m])) {
                    expected.extend(part(&a, n).zip(part(&b, m)));
                }
            }
            let mut found = std::collections::BTreeSet::new();
            a.meeting(&b, |p, q| _ = found.insert((p, q)));
            assert_eq!(found, expected, "{side:?}");
        }
    }
}
