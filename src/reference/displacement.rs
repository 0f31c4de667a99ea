//! The displacement of every interval from the fields of its two slices: Gauss-Newton on blocks, joint over the intervals.
//!
//! With `a = clip(A)(x - v/2)`, `b = clip(B)(x + v/2)`, `r = a - b` and `J = grad(a + b) / 2` a better v solves `S v = S v_old + d`, where
//! `S = <J J'> - <J><J>'` and `d = <J r> - <J><r>` are Gaussian-window means with the means of growth taken out. Neighbouring intervals
//! take part as rates; a ridge says: no evidence, no motion. Where there is a guess all of this holds for the difference to it.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::displacement::{BLOCK, Displacement, DisplacementJob, smooth};
use crate::field::{Field, bilinear, cell};

/// One round of the iteration, lengths in px.
#[derive(Debug, Clone, Copy)]
pub struct Round {
    /// Sigma of the window.
    pub window: f64,
    /// Fields are clipped here.
    pub clip: f64,
    /// Width of the weight `exp(-(min(|a|, |b|) / w)^2)`; zero beyond three times that.
    pub width: f64,
    /// Weight of no motion but the guess.
    pub ridge: f64,
}

/// The first rounds.
pub const WIDE: Round = Round { window: 8.0, clip: 16.0, width: 8.0, ridge: 0.10 };
/// The last rounds.
pub const NARROW: Round = Round { window: 8.0, clip: 8.0, width: 5.0, ridge: 0.07 };
/// The rounds in order.
pub const ROUNDS: [Round; 7] = [WIDE, WIDE, WIDE, WIDE, NARROW, NARROW, NARROW];
/// Weight of a neighbouring interval.
pub const COUPLING: f64 = 0.5;
/// Mean weight of evidence that counts half.
pub const HALF_EVIDENCE: f64 = 1e-3;

impl Round {
    /// Distance beyond which a pixel has no weight.
    pub fn reach(&self) -> f64 {
        3.0 * self.width
    }

    /// Weight of a pixel at distance `d`.
    fn weight(&self, d: f64) -> f64 {
        if d > self.reach() { 0.0 } else { (-(d / self.width).powi(2)).exp() }
    }

    /// Sigma of the window, blocks.
    pub fn window_sigma(&self, h: [f64; 2]) -> [f64; 2] {
        h.map(|side| self.window / (BLOCK as f64 * side))
    }

    /// Sigma with which vectors are smoothed, blocks.
    pub fn smoothing_sigma(&self, h: [f64; 2]) -> [f64; 2] {
        self.window_sigma(h).map(|sigma| 0.5 * sigma)
    }
}

/// Evidence of one interval per block: `S` (xx, yy, xy) and the right-hand side `S (v - guess) + d` (x, y), in px of the larger side.
type Evidence = Vec<[f64; 5]>;

/// Displacements of neighbouring intervals after some rounds.
pub fn displacements(job: &DisplacementJob<'_>) -> Vec<Displacement> {
    ROUNDS[job.rounds.clone()].iter().fold(job.begin.to_vec(), |current, &round| better(job, &current, round))
}

/// One round from `current`.
pub fn better(job: &DisplacementJob<'_>, current: &[Displacement], round: Round) -> Vec<Displacement> {
    let &DisplacementJob { fields, gaps, guess, h, .. } = job;
    let evidence: Vec<Evidence> = (0..gaps.len())
        .into_par_iter()
        .map(|i| evidence(&fields[i], &fields[i + 1], &current[i], &guess[i], round, h))
        .collect();
    (0..gaps.len()).into_par_iter().map(|i| solve(i, &evidence, gaps, &guess[i], round, h)).collect()
}

/// Both fields where the displacement brings them together: `a` and `b` at the pixels of one row. Pixels that are not `near` the contours
/// read what is clipped there as here.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row(fields: [&Field; 2], clip: f64, near: &[bool], v: &Displacement, j: usize, out: &mut [[f64; 2]]) {
    v.read_row(j, 0, out);
    for (i, slot) in out.iter_mut().enumerate() {
        let n = j * fields[0].dims[0] + i;
        let (x, [vx, vy]) = ([i as f64, j as f64], *slot);
        *slot = if near[n] {
            [
                sample_clipped(fields[0], clip, [x[0] - 0.5 * vx, x[1] - 0.5 * vy]),
                sample_clipped(fields[1], clip, [x[0] + 0.5 * vx, x[1] + 0.5 * vy]),
            ]
        } else {
            fields.map(|f| f.data[n].clamp(-clip, clip))
        };
    }
}

/// Bilinear value of a clipped field.
#[inline(always)]
fn sample_clipped(field: &Field, clip: f64, x: [f64; 2]) -> f64 {
    let ([i, j], place) = cell(field.dims, x, 0);
    let nx = field.dims[0];
    let node = j * nx + i;
    bilinear([node, node + 1, node + nx, node + nx + 1].map(|n| field.data[n].clamp(-clip, clip)), place)
}

fn evidence(low: &Field, high: &Field, v: &Displacement, guess: &Displacement, round: Round, h: [f64; 2]) -> Evidence {
    let [nx, ny] = low.dims;
    let clip = |d: f64| d.clamp(-round.clip, round.clip);
    // Where nothing lies within the clip of a contour, wherever the displacement reads, nothing need be looked at.
    let reach = round.clip + v.largest() + 2.0;
    let near: Vec<bool> = low.data.iter().zip(&high.data).map(|(a, b)| a.abs().min(b.abs()) < reach).collect();
    let far_weight = round.weight(round.clip);
    let mut sums = vec![[0.0; 9]; v.grid[0] * v.grid[1]];
    let mut rows = [vec![[0.0; 2]; nx], vec![[0.0; 2]; nx], vec![[0.0; 2]; nx]];
    let mut held = [usize::MAX; 3];
    for j in 1..ny - 1 {
        let blocks = &mut sums[(j / BLOCK) * v.grid[0]..][..v.grid[0]];
        if !near[j * nx..(j + 1) * nx].contains(&true) {
            for i in 1..nx - 1 {
                let [a, b] = [low, high].map(|f| clip(f.data[j * nx + i]));
                blocks[i / BLOCK][0] += far_weight;
                blocks[i / BLOCK][8] += far_weight * (a - b);
            }
            continue;
        }
        for wanted in j - 1..=j + 1 {
            if held[wanted % 3] != wanted {
                row([low, high], round.clip, &near, v, wanted, &mut rows[wanted % 3]);
                held[wanted % 3] = wanted;
            }
        }
        add_moments([j - 1, j, j + 1].map(|k| rows[k % 3].as_slice()), round, h, blocks);
    }
    smooth(&mut sums, v.grid, round.window_sigma(h));
    sums.iter()
        .zip(v.vectors.iter().zip(&guess.vectors))
        .map(|(sum, (v, guess))| {
            let weight = sum[0] / (BLOCK * BLOCK) as f64;
            let whole = sum[0] + 1e-6 * (BLOCK * BLOCK) as f64;
            let [xx, yy, xy, xr, yr, x, y, r]: [f64; 8] = std::array::from_fn(|k| sum[k + 1] / whole);
            let (sxx, syy, sxy) = (xx - x * x, yy - y * y, xy - x * y);
            let (dx, dy) = (xr - x * r, yr - y * r);
            let (vx, vy) = ((v[0] - guess[0]) * h[0], (v[1] - guess[1]) * h[1]);
            let trust = weight / (weight + HALF_EVIDENCE);
            [sxx, syy, sxy, dx + sxx * vx + sxy * vy, dy + sxy * vx + syy * vy].map(|s| s * trust)
        })
        .collect()
}

/// Adds the weighted moments of a row's pixels to those of its blocks; the rows beside it hold what gradients are taken from.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn add_moments([below, here, above]: [&[[f64; 2]]; 3], round: Round, h: [f64; 2], blocks: &mut [[f64; 9]]) {
    let far_weight = round.weight(round.clip);
    let sum = |p: [f64; 2]| p[0] + p[1];
    for i in 1..here.len() - 1 {
        let [a, b] = here[i];
        let d = a.abs().min(b.abs());
        let w = if d < round.clip { round.weight(d) } else { far_weight };
        let gx = 0.25 * (sum(here[i + 1]) - sum(here[i - 1])) / h[0];
        let gy = 0.25 * (sum(above[i]) - sum(below[i])) / h[1];
        let r = a - b;
        let moments = [1.0, gx * gx, gy * gy, gx * gy, gx * r, gy * r, gx, gy, r];
        blocks[i / BLOCK].iter_mut().zip(moments).for_each(|(s, m)| *s += w * m);
    }
}

fn solve(
    i: usize,
    evidence: &[Evidence],
    gaps: &[f64],
    guess: &Displacement,
    round: Round,
    h: [f64; 2],
) -> Displacement {
    let neighbours: Vec<usize> =
        [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter(|&j| j < gaps.len()).collect();
    let ridge = round.ridge * (1.0 + COUPLING * neighbours.len() as f64);
    let mut vectors: Vec<[f64; 2]> = (0..guess.vectors.len())
        .map(|k| {
            // The neighbours are added up first: the same either way up.
            let mut beside = [0.0; 5];
            for &j in &neighbours {
                // A neighbour's displacement counts as a rate.
                let rate = gaps[i] / gaps[j];
                let scale = [1.0, 1.0, 1.0, rate, rate];
                beside.iter_mut().zip(evidence[j][k]).zip(scale).for_each(|((s, e), k)| *s += k * e);
            }
            let own = evidence[i][k];
            let sum: [f64; 5] = std::array::from_fn(|c| own[c] + COUPLING * beside[c]);
            let [xx, yy, xy, bx, by] = sum;
            let (xx, yy) = (xx + ridge, yy + ridge);
            let determinant = xx * yy - xy * xy;
            [(yy * bx - xy * by) / determinant / h[0], (xx * by - xy * bx) / determinant / h[1]]
        })
        .collect();
    smooth(&mut vectors, guess.grid, round.smoothing_sigma(h));
    vectors.iter_mut().zip(&guess.vectors).for_each(|(v, g)| *v = [v[0] + g[0], v[1] + g[1]]);
    Displacement { grid: guess.grid, vectors }
}
