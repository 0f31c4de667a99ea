//! The heights that fairing is made at, and the mean along z over them.
//!
//! Every interval has the same few nodes, its contours among them, whatever layers are asked for; beyond the first and the last contour there is
//! nothing. The mean of v at height z is that of the straight lines through the nodes, weighted by a quadratic B-spline `S = 2 sigma` wide between
//! knots. With its second antiderivative, `F(y) = 1/24 [(y + 3/2)+^4 - 3 (y + 1/2)+^4 + 3 (y - 1/2)+^4 - (y - 3/2)+^4]`, `= y` beyond 3/2, and
//! `k(x) = S F(x / S)`, node j has the weight
//!
//! ```text
//! W_j = (k(z_{j+1} - z) - k(z_j - z)) / (z_{j+1} - z_j)  -  (k(z_j - z) - k(z_{j-1} - z)) / (z_j - z_{j-1})
//! ```
//!
//! The weights add up to 1 and the mean of a line is the line, however uneven the nodes. Reflected in an end contour e, nodes carry
//! `2 v_e - v_j`: there the mean is v_e itself. A contour beside an empty slice is such an end: how a body closes there has no say in what lies on
//! the other side, which would swell (a ball's next layers by a fifth of their area).

use std::collections::BTreeMap;
use std::ops::Range;

use crate::grid::spline::smoothstep;
use crate::stack::heights::{NODE_TIMES, NODES, at_time};

/// Sigma of the mean, gaps. Creases (1: the truth's) and mean Dice of the real cases, medium and hard, at 0.3: 0.951, 0.992; 0.9537, 0.9236; at a third: 0.939, 0.988;
/// 0.9535, 0.9233; at 0.4: 0.927, 0.967; 0.9531, 0.9225.
const SIGMA: f64 = 1.0 / 3.0;
/// Ends of the B-spline, distances of its knots.
const END: f64 = 1.5;
/// Height over which v's gradient along z is taken to either side, at least, in middle gaps: over a far shorter one it would tell of pixels, of rounding and
/// of the steps of a sweep, and nodes of longer gaps read v there. It counts in gaps of less than a quarter of the middle one.
const LEAST_RISE: f64 = 1.0 / 16.0;
/// Smaller weights are rounding's.
const LEAST: f64 = 1e-9;

/// The nodes of a stack.
#[derive(Debug, Clone)]
pub struct Nodes {
    contours: Vec<f64>,
    /// Heights of all nodes, increasing.
    heights: Vec<f64>,
    /// Per interval whether both of its contours are drawn.
    open: Vec<bool>,
    /// Height over which a gradient is taken to either side, at least.
    rise: f64,
}

/// The nodes between two ends, in which means are reflected.
struct Run<'n>(&'n [f64]);

impl Run<'_> {
    fn last(&self) -> isize {
        self.0.len() as isize - 1
    }

    /// Height of node `m` of the run, of a reflected one where there is none; the last of those once more beyond them.
    fn height(&self, m: isize) -> f64 {
        let (last, of) = (self.last(), |m: isize| self.0[m as usize]);
        let (low, high) = (of(0), of(last));
        match m {
            _ if m < -last => self.height(-last) - (high - low),
            _ if m < 0 => 2.0 * low - of(-m),
            _ if m <= last => of(m),
            _ if m <= 2 * last => 2.0 * high - of(2 * last - m),
            _ => self.height(2 * last) + (high - low),
        }
    }
}

impl Nodes {
    /// The nodes of contours at increasing heights, two at least; `drawn` says which are not empty, `gap` is the middle gap of the whole stack.
    pub fn new(contours: Vec<f64>, drawn: &[bool], gap: f64) -> Self {
        let of = |w: &[f64]| {
            let ends = [w[0], w[1]];
            std::iter::once(ends[0]).chain(NODE_TIMES.map(|t| at_time(ends, t)))
        };
        let heights = contours.windows(2).flat_map(of).chain(contours.last().copied()).collect();
        let open = drawn.windows(2).map(|pair| pair[0] && pair[1]).collect();
        Nodes { contours, heights, open, rise: LEAST_RISE * gap }
    }

    /// The nodes below and above node `k` by which its gradient along z is known: those beside it, but of narrow gaps the nearest that are far enough
    /// away. Neither lies beyond an empty slice, nor beyond an end.
    pub fn beside(&self, k: usize) -> [usize; 2] {
        let near = |l: usize| (self.heights[l] - self.heights[k]).abs() < self.rise;
        let (mut below, mut above) = (k.saturating_sub(1), (k + 1).min(self.last()));
        while below > 0 && near(below) && self.open[(below - 1) / NODES] && self.open[below / NODES] {
            below -= 1;
        }
        while above < self.last() && near(above) && self.open[above / NODES] && self.open[(above - 1) / NODES] {
            above += 1;
        }
        [below, above]
    }

    /// Intervals between the contours.
    pub fn intervals(&self) -> usize {
        self.contours.len() - 1
    }

    /// Number of the last node.
    pub fn last(&self) -> usize {
        self.heights.len() - 1
    }

    /// Height of a node.
    pub fn height(&self, k: usize) -> f64 {
        self.heights[k]
    }

    /// The node at this very height.
    pub fn at(&self, z: f64) -> Option<usize> {
        self.heights.binary_search_by(|h| h.total_cmp(&z)).ok()
    }

    /// The contour that node `k` is.
    pub fn contour(&self, k: usize) -> Option<usize> {
        k.is_multiple_of(NODES).then_some(k / NODES)
    }

    /// Weights of the nodes in the mean at node `k`.
    pub fn weights(&self, k: usize) -> Vec<(usize, f64)> {
        let Some((first, run)) = self.run(k) else { return vec![(k, 1.0)] };
        let z = self.heights[k];
        let width = self.width(z);
        let curve = |x: f64| width * antiderivative(x / width);
        let mut weights = BTreeMap::<usize, f64>::new();
        let mut add = |node: isize, w: f64| *weights.entry(first + node as usize).or_default() += w;
        let (last, n) = (run.last(), (k - first) as isize);
        let reaches = |m: isize, beside: isize| {
            let near = (run.height(beside) - z).abs() < END * width;
            m.abs_diff(n) <= 1 || near
        };
        // Of the node itself, then upwards and downwards as far as the hat of a node, whose foot is the node before, meets the spline.
        let upwards = (n..=2 * last).take_while(|&m| reaches(m, m - 1));
        let downwards = (-last..n).rev().take_while(|&m| reaches(m, m + 1));
        for m in upwards.chain(downwards) {
            let [below, here, above] = [m - 1, m, m + 1].map(|m| run.height(m) - z);
            let rise = |a: f64, b: f64| (curve(b) - curve(a)) / (b - a);
            let w = rise(here, above) - rise(below, here);
            match m {
                _ if m < 0 => {
                    add(0, 2.0 * w);
                    add(-m, -w);
                }
                _ if m > last => {
                    add(last, 2.0 * w);
                    add(2 * last - m, -w);
                }
                _ => add(m, w),
            }
        }
        weights.into_iter().filter(|(_, w)| w.abs() > LEAST).collect()
    }

    /// The number of the first node between the ends around node `k`, and all of these; `None` at an end that is not the stack's own, and in an interval
    /// without a contour.
    fn run(&self, k: usize) -> Option<(usize, Run<'_>)> {
        let below = k.div_ceil(NODES).checked_sub(1);
        let above = (k / NODES < self.intervals()).then_some(k / NODES);
        if below.into_iter().chain(above).any(|i| !self.open[i]) {
            return None;
        }
        let i = above.or(below)?;
        let low = self.open[..i].iter().rposition(|open| !open).map_or(0, |closed| closed + 1);
        let high = self.open[i..].iter().position(|open| !open).map_or(self.intervals(), |closed| i + closed);
        Some((NODES * low, Run(&self.heights[NODES * low..=NODES * high])))
    }

    /// Distance of the spline's knots: at a contour by the mean of the gaps next to it, between them a smooth step, so that what follows is C1.
    fn width(&self, z: f64) -> f64 {
        let last = self.intervals();
        let i = self.contours.partition_point(|c| *c <= z).clamp(1, last) - 1;
        let w = smoothstep((z - self.contours[i]) / (self.contours[i + 1] - self.contours[i]));
        2.0 * SIGMA * ((1.0 - w) * self.gap_at(i) + w * self.gap_at(i + 1))
    }

    /// The mean of the gaps next to a contour, at an end the one there is.
    fn gap_at(&self, i: usize) -> f64 {
        let gap = |k: usize| self.contours[k + 1] - self.contours[k];
        let below = i.checked_sub(1).filter(|k| self.open[*k]).map(gap);
        let above = (i < self.intervals() && self.open[i]).then(|| gap(i));
        let (one, other) = (below.or(above), above.or(below));
        0.5 * (one.unwrap_or(1.0) + other.unwrap_or(1.0))
    }

    /// Nodes that the means of interval `i`, contours included, are taken from.
    pub fn averaged(&self, i: usize) -> Range<usize> {
        let reach = |k: usize| self.weights(k).into_iter().map(|(m, _)| m);
        let all = (NODES * i..=NODES * (i + 1)).flat_map(reach);
        let (low, high) = all.fold((usize::MAX, 0), |(low, high), m| (low.min(m), high.max(m)));
        low..high + 1
    }

    /// Intervals that must be known to make the layers of interval `i`: those of the nodes that its corrections and those beside it are
    /// taken from, and of the nodes beside these, by which their gradients are known.
    pub fn known(&self, i: usize) -> Range<usize> {
        let beside = i.saturating_sub(1)..=(i + 1).min(self.intervals() - 1);
        let nodes = beside.map(|i| self.averaged(i)).reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
        let nodes = nodes.unwrap_or_default();
        let (low, high) = (self.beside(nodes.start)[0], self.beside(nodes.end.max(1) - 1)[1]);
        low / NODES..high.div_ceil(NODES)
    }

    /// Weights of the corrections of the nodes in that of a layer at `z`, within the stack: the cubic Hermite curve through them in z, its slope
    /// at a node that of the line between its neighbours, at an end that of the one there is. (The parabola's, `(b s_a + a s_b) / (a + b)` of lines a
    /// and b high, follows the shorter one: where gaps are unlike the curve swings out of the longer.)
    pub fn curve(&self, z: f64) -> Vec<(usize, f64)> {
        if let Some(k) = self.at(z) {
            return vec![(k, 1.0)];
        }
        let k = self.heights.partition_point(|h| *h < z).clamp(1, self.last()) - 1;
        let rise = |k: usize| self.heights[k + 1] - self.heights[k];
        let t = (z - self.heights[k]) / rise(k);
        let mut weights = BTreeMap::<usize, f64>::new();
        let mut add = |k: usize, w: f64| *weights.entry(k).or_default() += w;
        add(k, smoothstep(1.0 - t));
        add(k + 1, smoothstep(t));
        for (at, w) in [(k, t * (1.0 - t).powi(2)), (k + 1, -t * t * (1.0 - t))] {
            let w = w * rise(k);
            let sides = [at.checked_sub(1), (at < self.last()).then_some(at)];
            for (side, other) in [(sides[0], sides[1]), (sides[1], sides[0])] {
                let Some(line) = side else { continue };
                let share = other.map_or(1.0, |other| rise(line) / (rise(line) + rise(other)));
                add(line + 1, w * share / rise(line));
                add(line, -w * share / rise(line));
            }
        }
        weights.into_iter().collect()
    }
}

/// `F(y)`: the second antiderivative of the quadratic B-spline.
fn antiderivative(y: f64) -> f64 {
    if y >= END {
        return y;
    }
    let power = |from: f64| (y + from).max(0.0).powi(4);
    (power(1.5) - 3.0 * power(0.5) + 3.0 * power(-0.5)) / 24.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::heights::middle_gap;

    fn all(contours: Vec<f64>) -> Nodes {
        let drawn = vec![true; contours.len()];
        let gap = middle_gap(&contours);
        Nodes::new(contours, &drawn, gap)
    }

    fn uneven() -> Nodes {
        all(vec![0.0, 10.0, 21.0, 30.0, 42.0, 51.0, 52.0, 60.0])
    }

    /// The mean at node `k` by the midpoint rule: straight lines through the nodes, reflected in the ends, under the B-spline.
    fn integrated(nodes: &Nodes, k: usize, v: impl Fn(f64) -> f64) -> f64 {
        const STEPS: usize = 4000;
        let (z, width) = (nodes.height(k), nodes.width(nodes.height(k)));
        let line = |x: f64| {
            let m = nodes.heights.partition_point(|h| *h <= x).clamp(1, nodes.last()) - 1;
            let (a, b) = (nodes.height(m), nodes.height(m + 1));
            v(a) + (v(b) - v(a)) * (x - a) / (b - a)
        };
        let (low, high) = (nodes.height(0), nodes.height(nodes.last()));
        let at = |x: f64| match x {
            _ if x < low => 2.0 * v(low) - line(2.0 * low - x),
            _ if x > high => 2.0 * v(high) - line(2.0 * high - x),
            _ => line(x),
        };
        let step = 3.0 / STEPS as f64;
        let places = (0..STEPS).map(|n| -1.5 + (n as f64 + 0.5) * step);
        let spline = |y: f64| if y.abs() < 0.5 { 0.75 - y * y } else { 0.5 * (1.5 - y.abs()).powi(2) };
        places.map(|y| step * spline(y) * at(z + y * width)).sum()
    }

    #[test]
    fn the_mean_is_the_integral_of_the_straight_lines() {
        let nodes = uneven();
        let wave = |z: f64| (z / 4.0).sin() + 0.02 * z;
        for k in 0..=nodes.last() {
            let mean: f64 = nodes.weights(k).into_iter().map(|(m, w)| w * wave(nodes.height(m))).sum();
            let expected = integrated(&nodes, k, wave);
            assert!((mean - expected).abs() < 1e-5, "node {k}: {mean} for {expected}");
        }
    }

    #[test]
    fn a_line_is_its_own_mean_and_an_end_its_own() {
        let nodes = uneven();
        for k in 0..=nodes.last() {
            let weights = nodes.weights(k);
            let line: f64 = weights.iter().map(|&(m, w)| w * (3.0 - 0.5 * nodes.height(m))).sum();
            assert!((line - 3.0 + 0.5 * nodes.height(k)).abs() < 1e-8, "node {k}: {line}");
        }
        assert_eq!(nodes.weights(0).len(), 1, "{:?}", nodes.weights(0));
    }

    #[test]
    fn equal_gaps_have_these_weights() {
        let nodes = all((0..8).map(|i| f64::from(i) * 3.0).collect());
        let weights: BTreeMap<usize, f64> = nodes.weights(14).into_iter().collect();
        for (away, w) in [0.2725, 0.2210, 0.1098, 0.0308, 0.0022].into_iter().enumerate() {
            assert!(
                (weights[&(14 + away)] - w).abs() < 1e-4 && (weights[&(14 - away)] - w).abs() < 1e-4,
                "{weights:?}"
            );
        }
    }

    #[test]
    fn beside_an_empty_slice_a_stack_ends() {
        let whole = [0.0, 10.0, 21.0, 30.0, 42.0, 51.0, 52.0, 60.0];
        // Slice 3 is empty: below and above it two stacks of their own.
        let nodes = Nodes::new(whole.to_vec(), &[true, true, true, false, true, true, true, true], 10.0);
        for (first, count) in [(0, 3), (4, 4)] {
            let own = all(whole[first..first + count].to_vec());
            for k in 0..=own.last() {
                let [found, expected] = [nodes.weights(k + NODES * first), own.weights(k)];
                assert_eq!(found.len(), expected.len(), "node {k} from contour {first} on");
                for ((m, w), (n, v)) in found.into_iter().zip(expected) {
                    assert!(m == n + NODES * first && (w - v).abs() < 1e-12, "node {k} from contour {first} on");
                }
            }
        }
        for k in NODES * 2..=NODES * 4 {
            assert_eq!(nodes.weights(k), vec![(k, 1.0)]);
        }
    }

    #[test]
    fn gradients_reach_over_nodes_of_narrow_gaps_but_not_beyond_an_empty_slice() {
        // The middle gap is 16: a node apart at least.
        let contours = vec![0.0, 1.0, 17.0, 33.0, 34.0, 35.0, 51.0];
        let nodes = all(contours.clone());
        assert_eq!(nodes.rise, 1.0);
        assert_eq!(nodes.beside(10), [9, 11], "a wide gap's nodes lie far enough apart");
        assert_eq!([0, 2, 4].map(|k| nodes.beside(k)), [[0, 4], [0, 5], [0, 5]]);
        assert_eq!([13, 16].map(|k| nodes.beside(k)), [[11, 17], [12, 20]]);
        assert_eq!(nodes.beside(nodes.last()), [nodes.last() - 1, nodes.last()]);
        let cut = Nodes::new(contours, &[true, true, true, true, false, true, true], 16.0);
        // Slice 4, node 16, is empty.
        assert_eq!([12, 13, 20].map(|k| cut.beside(k)), [[11, 13], [12, 14], [19, 21]]);
    }

    #[test]
    fn upside_down_the_weights_are_the_same() {
        let nodes = uneven();
        let turned = all(nodes.contours.iter().rev().map(|z| 60.0 - z).collect());
        let same = |own: Vec<(usize, f64)>, turned: Vec<(usize, f64)>| {
            let mirrored = turned.into_iter().rev().map(|(m, w)| (nodes.last() - m, w));
            own.len() == mirrored.len() && own.iter().zip(mirrored).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-9)
        };
        for k in 0..=nodes.last() {
            assert!(same(nodes.weights(k), turned.weights(nodes.last() - k)), "node {k}");
        }
        for z in [0.3, 12.0, 29.9, 51.7, 59.9] {
            assert!(same(nodes.curve(z), turned.curve(60.0 - z)), "height {z}");
        }
    }

    #[test]
    fn what_lies_farther_than_known_has_no_say() {
        let nodes = uneven();
        for i in 0..nodes.intervals() {
            let known = nodes.known(i);
            let low = known.start.saturating_sub(2);
            // With two intervals more the gaps that widths depend on are the same.
            let part = all(nodes.contours[low..(known.end + 3).min(nodes.contours.len())].to_vec());
            for k in NODES * i..=NODES * (i + 1) {
                let own = part.weights(k - NODES * low).into_iter().map(|(m, w)| (m + NODES * low, w));
                assert_eq!(nodes.weights(k), own.collect::<Vec<_>>(), "node {k}");
            }
        }
    }

    #[test]
    fn a_curve_through_the_nodes_of_a_line_is_the_line_and_c1() {
        let nodes = uneven();
        let at = |z: f64, v: &dyn Fn(f64) -> f64| {
            nodes.curve(z).into_iter().map(|(k, w)| w * v(nodes.height(k))).sum::<f64>()
        };
        let wave = |z: f64| (z / 4.0).sin();
        for k in 1..nodes.last() {
            let z = nodes.height(k);
            assert!((at(z + 0.1, &|z| 2.0 * z - 1.0) - 2.0 * (z + 0.1) + 1.0).abs() < 1e-9);
            let [below, here, above] = [z - 1e-5, z, z + 1e-5].map(|z| at(z, &wave));
            assert!(((above - here) - (here - below)).abs() < 1e-8, "node {k}");
        }
    }
}
