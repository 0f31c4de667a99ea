//! The displacement of every interval from the fields of its two slices: Gauss-Newton on nodes, joint over the intervals.
//!
//! With `a = clip(A)(x - v/2)`, `b = clip(B)(x + v/2)`, `r = a - b` and `J = grad(a + b) / 2` a better v solves `S v = S v_old + d`, where
//! `S = <J J'> - <J><J>'` and `d = <J r> - <J><r>` are Gaussian-window means with the means of growth taken out; pixels are spread over the
//! nodes around them by tents. A ridge says: no evidence, no motion. Where there is a guess all of this holds for the difference to it.
//!
//! Neighbouring intervals j take part as rates, by their share of what changes: `c_j = 1/2 e^2 / (e^2 + (e_j h / h_j)^2)`, e^2 the window mean of
//! `(a - b)^2` where nothing moves but by the guess. Beside one in which much changes, an interval in which little does keeps to itself:
//! equal slices have exactly no motion.

use glam::DVec2;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::grid::field::{Field, bilinear, cell};
use crate::registration::displacement::{BLOCK, Displacement, DisplacementJob, smooth};

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
/// Weight of a neighbouring interval, times its share.
pub const COUPLING: f64 = 0.5;
/// A mean square change that is none, px^2: a thousandth of a pixel is what rounding may bring in.
pub const NO_CHANGE: f64 = 1e-6;
/// Mean weight of evidence that counts half.
pub const HALF_EVIDENCE: f64 = 1e-3;
/// Weight that is added to that of a node, so that there is some: a millionth of its pixels.
const LEAST_WEIGHT: f64 = 1e-6 * (BLOCK * BLOCK) as f64;

impl Round {
    /// Distance beyond which a pixel has no weight.
    pub fn reach(&self) -> f64 {
        3.0 * self.width
    }

    /// Weight of a pixel at distance `d`.
    fn weight(&self, d: f64) -> f64 {
        if d > self.reach() { 0.0 } else { libm::exp(-(d / self.width).powi(2)) }
    }

    /// Whether two rounds look at the slices in the same way.
    pub fn sees_as(&self, other: &Round) -> bool {
        [self.window, self.clip, self.width] == [other.window, other.clip, other.width]
    }

    /// Sigma of the window, nodes.
    pub fn window_sigma(&self, h: [f64; 2]) -> [f64; 2] {
        h.map(|side| self.window / (BLOCK as f64 * side))
    }

    /// Sigma with which vectors are smoothed, nodes.
    pub fn smoothing_sigma(&self, h: [f64; 2]) -> [f64; 2] {
        self.window_sigma(h).map(|sigma| 0.5 * sigma)
    }
}

/// Evidence of one interval per node: `S` (xx, yy, xy) and the right-hand side `S (v - guess) + d` (x, y), in px of the larger side.
type Evidence = Vec<[f64; 5]>;

/// Difference of the slices of one interval where nothing moves but by the guess: e^2 per node, px^2.
type Change = Vec<f64>;

/// Displacements of neighbouring intervals after some rounds.
pub fn displacements(job: &DisplacementJob<'_>) -> Vec<Displacement> {
    let mut current = job.begin.to_vec();
    for alike in ROUNDS[job.rounds.clone()].chunk_by(Round::sees_as) {
        let changes = changes(job, alike[0]);
        current = alike.iter().fold(current, |current, &round| better(job, &changes, &current, round));
    }
    current
}

fn changes(job: &DisplacementJob<'_>, round: Round) -> Vec<Change> {
    let change = |i: usize| change(&job.fields[i], &job.fields[i + 1], &job.guess[i], round, job.h);
    (0..job.gaps.len()).into_par_iter().map(change).collect()
}

/// One round from `current`.
fn better(job: &DisplacementJob<'_>, changes: &[Change], current: &[Displacement], round: Round) -> Vec<Displacement> {
    let &DisplacementJob { fields, gaps, guess, h, .. } = job;
    let evidence: Vec<Evidence> = (0..gaps.len())
        .into_par_iter()
        .map(|i| evidence(&fields[i], &fields[i + 1], &current[i], &guess[i], round, h))
        .collect();
    (0..gaps.len()).into_par_iter().map(|i| solve(i, &evidence, changes, gaps, &guess[i], round, h)).collect()
}

/// Both fields where the displacement brings them together: `a` and `b` at the pixels of one row. Pixels that are not `near` the contours
/// read what is clipped there as here.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row(fields: [&Field; 2], clip: f64, near: &[bool], v: &Displacement, j: usize, out: &mut [DVec2]) {
    v.read_row(j, 0, out);
    for (i, slot) in out.iter_mut().enumerate() {
        let n = j * fields[0].dims[0] + i;
        let (x, half) = (DVec2::new(i as f64, j as f64), 0.5 * *slot);
        *slot = if near[n] {
            DVec2::new(sample_clipped(fields[0], clip, x - half), sample_clipped(fields[1], clip, x + half))
        } else {
            DVec2::new(fields[0].data[n].clamp(-clip, clip), fields[1].data[n].clamp(-clip, clip))
        };
    }
}

/// Bilinear value of a clipped field.
#[inline(always)]
fn sample_clipped(field: &Field, clip: f64, x: DVec2) -> f64 {
    let ([i, j], place) = cell(field.dims, x, 0);
    let nx = field.dims[0];
    let node = j * nx + i;
    let at = |n: usize| field.data[n].clamp(-clip, clip);
    bilinear([at(node), at(node + 1), at(node + nx), at(node + nx + 1)], place)
}

/// Whether each pixel lies so near a contour that a value read up to `away` px off may lie within the clip.
fn near_contours(low: &Field, high: &Field, round: Round, away: f64) -> Vec<bool> {
    let reach = round.clip + away + 2.0;
    low.data.iter().zip(&high.data).map(|(a, b)| a.abs().min(b.abs()) < reach).collect()
}

/// Sums of pixels spread over the nodes around them.
struct Spread<'v, const N: usize> {
    nodes: &'v Displacement,
    sums: Vec<[f64; N]>,
    row: Vec<[f64; N]>,
}

impl<'v, const N: usize> Spread<'v, N> {
    fn new(nodes: &'v Displacement) -> Self {
        Spread { nodes, sums: vec![[0.0; N]; nodes.vectors.len()], row: vec![[0.0; N]; nodes.grid[0]] }
    }

    /// Adds row `j`, which `fill` spreads over the columns of nodes.
    fn add_row(&mut self, j: usize, fill: impl FnOnce(&mut [[f64; N]])) {
        self.row.fill([0.0; N]);
        fill(&mut self.row);
        let (before, place) = self.nodes.place(1, j as f64);
        let columns = self.nodes.grid[0];
        for (nodes, share) in self.sums[before * columns..].chunks_exact_mut(columns).zip([1.0 - place, place]) {
            let sums = nodes.as_flattened_mut().iter_mut();
            sums.zip(self.row.as_flattened()).for_each(|(sum, v)| *sum += share * v);
        }
    }
}

/// Adds what a pixel has to the nodes before and after it.
#[inline(always)]
fn add_pixel<const N: usize>(nodes: &mut [[f64; N]], (before, place): (usize, f64), values: [f64; N]) {
    for (node, share) in nodes[before..before + 2].iter_mut().zip([1.0 - place, place]) {
        node.iter_mut().zip(values).for_each(|(sum, v)| *sum += share * v);
    }
}

fn change(low: &Field, high: &Field, guess: &Displacement, round: Round, h: [f64; 2]) -> Change {
    let [nx, ny] = low.dims;
    let away = guess.largest();
    // Where nothing moves every pixel reads itself.
    let near = if away > 0.0 { near_contours(low, high, round, away) } else { vec![false; low.data.len()] };
    let mut pairs = vec![DVec2::ZERO; nx];
    let mut spread = Spread::new(guess);
    for j in 1..ny - 1 {
        row([low, high], round.clip, &near, guess, j, &mut pairs);
        spread.add_row(j, |nodes| {
            for (i, &DVec2 { x: a, y: b }) in pairs.iter().enumerate().take(nx - 1).skip(1) {
                let w = round.weight(a.abs().min(b.abs()));
                add_pixel(nodes, guess.place(0, i as f64), [w, w * (a - b).powi(2)]);
            }
        });
    }
    let mut sums = spread.sums;
    smooth(&mut sums, guess.grid, round.window_sigma(h));
    sums.iter().map(|[w, square]| square / (w + LEAST_WEIGHT)).collect()
}

fn evidence(low: &Field, high: &Field, v: &Displacement, guess: &Displacement, round: Round, h: [f64; 2]) -> Evidence {
    // Where nothing lies within the clip of a contour, wherever the displacement reads, nothing need be looked at.
    let near = near_contours(low, high, round, v.largest());
    let mut sums = moments([low, high], &near, v, round, h);
    smooth(&mut sums, v.grid, round.window_sigma(h));
    sums.iter()
        .zip(v.vectors.iter().zip(&guess.vectors))
        .map(|(sum, (v, guess))| {
            let weight = sum[0] / (BLOCK * BLOCK) as f64;
            let whole = sum[0] + LEAST_WEIGHT;
            let [xx, yy, xy, xr, yr, x, y, r]: [f64; 8] = std::array::from_fn(|k| sum[k + 1] / whole);
            let (sxx, syy, sxy) = (xx - x * x, yy - y * y, xy - x * y);
            let (dx, dy) = (xr - x * r, yr - y * r);
            let DVec2 { x: vx, y: vy } = (v - guess) * DVec2::from(h);
            let trust = weight / (weight + HALF_EVIDENCE);
            [sxx, syy, sxy, dx + sxx * vx + sxy * vy, dy + sxy * vx + syy * vy].map(|s| s * trust)
        })
        .collect()
}

/// Weighted moments of all pixels, at the nodes around them; rows without a pixel `near` a contour are flat.
fn moments([low, high]: [&Field; 2], near: &[bool], v: &Displacement, round: Round, h: [f64; 2]) -> Vec<[f64; 9]> {
    let [nx, ny] = low.dims;
    let clip = |d: f64| d.clamp(-round.clip, round.clip);
    let far_weight = round.weight(round.clip);
    let mut spread = Spread::new(v);
    let mut rows = [(); 3].map(|()| vec![DVec2::ZERO; nx]);
    let mut held = [usize::MAX; 3];
    for j in 1..ny - 1 {
        if !near[j * nx..(j + 1) * nx].contains(&true) {
            spread.add_row(j, |nodes| {
                for i in 1..nx - 1 {
                    let [a, b] = [low, high].map(|f| clip(f.data[j * nx + i]));
                    let (before, place) = v.place(0, i as f64);
                    for (node, share) in nodes[before..before + 2].iter_mut().zip([1.0 - place, place]) {
                        node[0] += share * far_weight;
                        node[8] += share * far_weight * (a - b);
                    }
                }
            });
            continue;
        }
        for wanted in j - 1..=j + 1 {
            if held[wanted % 3] != wanted {
                row([low, high], round.clip, near, v, wanted, &mut rows[wanted % 3]);
                held[wanted % 3] = wanted;
            }
        }
        let around = [j - 1, j, j + 1].map(|k| rows[k % 3].as_slice());
        spread.add_row(j, |nodes| add_moments(around, round, h, v, nodes));
    }
    spread.sums
}

/// Adds the weighted moments of a row's pixels to those of the nodes on either side; the rows beside it hold what gradients are taken from.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn add_moments(
    [below, here, above]: [&[DVec2]; 3],
    round: Round,
    h: [f64; 2],
    v: &Displacement,
    nodes: &mut [[f64; 9]],
) {
    let far_weight = round.weight(round.clip);
    let sum = |p: DVec2| p.x + p.y;
    for i in 1..here.len() - 1 {
        let DVec2 { x: a, y: b } = here[i];
        let d = a.abs().min(b.abs());
        let w = if d < round.clip { round.weight(d) } else { far_weight };
        let gx = 0.25 * (sum(here[i + 1]) - sum(here[i - 1])) / h[0];
        let gy = 0.25 * (sum(above[i]) - sum(below[i])) / h[1];
        let r = a - b;
        let moments = [1.0, gx * gx, gy * gy, gx * gy, gx * r, gy * r, gx, gy, r].map(|m| w * m);
        add_pixel(nodes, v.place(0, i as f64), moments);
    }
}

fn solve(
    i: usize,
    evidence: &[Evidence],
    changes: &[Change],
    gaps: &[f64],
    guess: &Displacement,
    round: Round,
    h: [f64; 2],
) -> Displacement {
    let neighbours: Vec<usize> =
        [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter(|&j| j < gaps.len()).collect();
    let mut vectors: Vec<DVec2> = (0..guess.vectors.len())
        .map(|k| {
            // The neighbours are added up first: the same either way up.
            let (mut beside, mut coupling) = ([0.0; 5], 0.0);
            for &j in &neighbours {
                // A neighbour's displacement counts as a rate.
                let rate = gaps[i] / gaps[j];
                let share = share(changes[i][k], rate * rate * changes[j][k]);
                let scale = [1.0, 1.0, 1.0, rate, rate];
                beside.iter_mut().zip(evidence[j][k]).zip(scale).for_each(|((s, e), k)| *s += share * k * e);
                coupling += share;
            }
            let own = evidence[i][k];
            let sum: [f64; 5] = std::array::from_fn(|c| own[c] + COUPLING * beside[c]);
            let [xx, yy, xy, bx, by] = sum;
            let ridge = round.ridge * (1.0 + COUPLING * coupling);
            let (xx, yy) = (xx + ridge, yy + ridge);
            let determinant = xx * yy - xy * xy;
            DVec2::new(yy * bx - xy * by, xx * by - xy * bx) / determinant / DVec2::from(h)
        })
        .collect();
    smooth::<2>(bytemuck::cast_slice_mut(&mut vectors), guess.grid, round.smoothing_sigma(h));
    vectors.iter_mut().zip(&guess.vectors).for_each(|(v, guess)| *v += guess);
    guess.with(vectors)
}

/// Share that an interval takes from a neighbour: `own` is its change, `other` the neighbour's in as much height, mean squares.
fn share(own: f64, other: f64) -> f64 {
    own / (own + other + NO_CHANGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_has_one_width_whatever_the_pixels() {
        // 8 px of the larger side: nodes lie BLOCK pixels apart.
        let nodes = 8.0 / BLOCK as f64;
        assert_eq!(WIDE.window_sigma([1.0, 1.0]), [nodes; 2]);
        assert_eq!(WIDE.window_sigma([0.5, 1.0]), [2.0 * nodes, nodes]);
        assert_eq!(WIDE.smoothing_sigma([1.0, 0.25]), [0.5 * nodes, 2.0 * nodes]);
    }

    #[test]
    fn rows_far_from_both_contours_are_what_their_pixels_are() {
        // Above row 48 one slice lies inside, the other outside, both beyond the clip.
        let dims = [40, 90];
        let (low, high) = (Field::from_fn(dims, |_, j| 30.0 - j as f64), Field::filled(dims, 50.0));
        let (v, h) = (Displacement::zero(dims), [1.0; 2]);
        let near = near_contours(&low, &high, WIDE, 0.0);
        assert!(near.contains(&true) && near.contains(&false));
        let of = |near: &[bool]| moments([&low, &high], near, &v, WIDE, h);
        for (short, whole) in of(&near).iter().flatten().zip(of(&vec![true; near.len()]).iter().flatten()) {
            assert!((short - whole).abs() < 1e-9 * (1.0 + whole.abs()), "{short} for {whole}");
        }
    }
}
