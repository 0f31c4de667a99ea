//! Constrained fairing: a smoothing along z that leaves the input contours where they are and makes them invisible.
//!
//! It is a function of the stack. At the nodes of every interval (`nodes`) the signed distance u becomes `v = B tanh(u / (n B))` with the 3D
//! gradient `n = max(|grad u|, 0.3)`, which counts near the surface only; along z the middle gap counts as GAP px, so that heights have no unit. With
//! the mean K along the trajectories of the moving field (or straight along z), and P, by which it would move a plane (`plane`), `D = K v - v - P`, a
//! node between the contours i and i + 1 is moved by `C = alpha n (D - (1 - w) D_i - w D_{i+1})`, `w = 3 t^2 - 2 t^3`, where v is small against B
//! (`correction`): as smoothing would move it, less what would move the contours. D_i is read where the contour has the node's distance (`level`), and
//! fades out where its |v| / B goes from 0.82 to 0.88. Nothing moves where the surface lies flat, where walls are thin (`thin`) or a part is on one contour
//! alone (`goes_on`). Where the surface does not go on beyond contour i, so that its tip is there, D_i does not count and C is w times as large, likewise
//! beyond i + 1: how it closes has no say on the other side. Where slopes may not overshoot, neither may C (`limit`).
//!
//! A layer at any height moves by the C1 curve in z through the C of the nodes, 0 at contours, cut off where that swings beyond what a node may
//! move by. Beyond the first and the last contour nothing moves, and nothing there has a say.

mod along;
mod correction;
mod difference;
mod flatness;
mod kept;
mod level;
mod limit;
mod near;
mod nodes;
mod plane;
mod rise;
mod thin;
mod transform;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use multiversion::multiversion;
use rayon::prelude::*;

use self::kept::{Node, Transformed, WaitingLayer, blocks_near};
use self::limit::{bounded, cut};
use self::near::{NearSquares, widest};
pub use self::nodes::Nodes;
use self::transform::{Lengths, transform};

use crate::error::Result;
use crate::grid::sparse_image::{AREA, SparseImage};
use crate::registration::displacement::Resting;
use crate::registration::motion_stack::MotionStack;
use crate::stack::heights::NODES;
use crate::surface::Layer;

/// Length that the stack's middle gap counts as along z, px of the larger side.
const GAP: f64 = 6.0;
/// B, px of the larger side: half of a gap.
const BOUND: f64 = 0.5 * GAP;

/// Does `work` on a thread of the pool, from which its loops need not hand anything over to another.
fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Layers of fewer pixels are worked on side by side, as many as there are threads.
pub const SMALL: usize = 1 << 20;
/// Gaps whose layers are then faired together, where there is memory.
pub const GAPS_AT_ONCE: usize = 4;
/// Larger ones that are worked on side by side, where there is memory: what one thread does for one of them others need not wait for.
pub const LARGE_AT_ONCE: usize = 4;

/// Facts about a stack that fairing needs.
pub struct FairingSpec<'m> {
    /// The frame in which layers follow each other, and the padding of its image.
    pub moving: Option<(&'m MotionStack<'m>, [usize; 2])>,
    /// Heights of the contours, increasing.
    pub contours: Vec<f64>,
    /// Which of them are not empty.
    pub drawn: Vec<bool>,
    /// The first and last of the intervals whose layers come.
    pub layers: Range<usize>,
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// Middle gap of the whole stack, see [`middle_gap`](crate::stack::heights::middle_gap).
    pub gap: f64,
    /// Strength, 0 to 1.5.
    pub alpha: f64,
    /// Degree to which the stack is relief whose contours are rugged, 0 to 1, see [`Change`](crate::stack::change::Change).
    pub rugged: f64,
    /// Whether layers may not leave the range of their two contours.
    pub limited: bool,
    /// Whether the slope at the first and at the last contour is one that an end asks for: it stays.
    pub steered: [bool; 2],
    /// Distances count up to this, unit of the spacing.
    pub farthest: f64,
    /// For an interval with parts that are kept apart the share of the strength at each pixel: smoothing would join them.
    pub shares: Vec<Option<Vec<f32>>>,
    /// Nodes that come before anything is made of them, and large layers that are worked on side by side: no layer depends on it.
    pub nodes_at_once: usize,
}

/// Takes layers in order of height, all nodes among them, and hands them on, faired.
pub struct Fairing<'m> {
    spec: FairingSpec<'m>,
    nodes: Nodes,
    /// Per interval the nodes that its means are taken from, and the lowest that one of it or above is.
    averaged: Vec<Range<usize>>,
    lowest: Vec<usize>,
    side: f64,
    /// Layers that are not handed on.
    waiting: VecDeque<WaitingLayer>,
    /// Nodes that have come and are still needed.
    kept: VecDeque<Node>,
    /// Number of the first of them.
    first: usize,
    /// The node with which there is enough to work on.
    awaited: usize,
    /// The lowest node without v.
    transformed: usize,
    /// The lowest interval without corrections, and the lowest whose layers wait.
    corrected: usize,
    finished: usize,
}

impl<'m> Fairing<'m> {
    /// Nothing yet.
    pub fn new(spec: FairingSpec<'m>) -> Self {
        let (nodes, start) = (Nodes::new(spec.contours.clone(), &spec.drawn, spec.gap), spec.layers.start);
        let side = spec.spacing[0].max(spec.spacing[1]);
        let averaged: Vec<Range<usize>> = (0..nodes.intervals()).map(|i| nodes.averaged(i)).collect();
        let mut lowest: Vec<usize> = averaged.iter().map(|nodes| nodes.start).collect();
        (1..lowest.len()).rev().for_each(|i| lowest[i - 1] = lowest[i - 1].min(lowest[i]));
        let first = NODES * start;
        Fairing {
            spec,
            nodes,
            averaged,
            lowest,
            side,
            waiting: VecDeque::new(),
            kept: VecDeque::new(),
            first,
            awaited: first,
            transformed: first,
            corrected: start,
            finished: start,
        }
    }

    /// B, unit of the spacing.
    fn bound(&self) -> f32 {
        (BOUND * self.side) as f32
    }

    /// Takes the next layer; hands on what is finished.
    ///
    /// # Errors
    /// The errors of `sink`.
    pub fn push(&mut self, layer: Layer, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let contours = self.spec.layers.start..=self.spec.layers.end;
        let [low, high] = [*contours.start(), *contours.end()].map(|i| self.spec.contours[i]);
        let node = self.nodes.at(layer.z).filter(|_| layer.z >= low && layer.z <= high);
        let waiting = WaitingLayer::new(layer);
        if node.is_some() {
            self.kept.push_back(Node::new(waiting.phi.clone()));
        }
        self.waiting.push_back(waiting);
        match node {
            Some(node) if node == NODES * self.spec.layers.end => self.advance(node, true, sink),
            Some(node) if node >= self.awaited => {
                self.awaited = node + self.spec.nodes_at_once;
                self.advance(node, false, sink)
            }
            _ => Ok(()),
        }
    }

    /// Hands on everything that is left.
    ///
    /// # Errors
    /// The errors of `sink`.
    pub fn finish(mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let left = std::mem::take(&mut self.waiting);
        left.into_iter().try_for_each(|waiting| sink(waiting.layer()))
    }

    /// Makes whatever can be made once `newest` has come, the `last` of all or not.
    fn advance(&mut self, newest: usize, last: bool, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        // A gradient along z is taken from nodes to both sides.
        let known = |k: usize| last || self.nodes.beside(k)[1] <= newest;
        let ready = (self.transformed..=newest).find(|k| !known(*k)).unwrap_or(newest + 1);
        self.transform(ready)?;
        let mut correct = self.corrected..self.corrected;
        while correct.end < self.spec.layers.end {
            // The contours beyond the interval's own are asked whether the surface goes on there.
            let beyond = (NODES * (correct.end + 2)).min(self.nodes.last());
            let needed = self.averaged[correct.end].end.max(beyond + 1);
            if needed > ready && !last {
                break;
            }
            correct.end += 1;
        }
        self.correct(correct.clone());
        self.corrected = correct.end;
        // The curve's slope at a contour reads the corrections on both sides.
        let finished = if last { self.corrected } else { self.corrected.saturating_sub(1) };
        if self.finished < finished { self.finish_intervals(finished, sink) } else { Ok(()) }
    }

    fn node(&self, k: usize) -> Option<&Node> {
        self.kept.get(k.checked_sub(self.first)?)
    }

    fn node_mut(&mut self, k: usize) -> Option<&mut Node> {
        self.kept.get_mut(k.checked_sub(self.first)?)
    }

    /// Layers that are worked on at the same time: rows of small ones are too little for all threads.
    fn at_once(&self) -> usize {
        let small = self.spec.dims[0] * self.spec.dims[1] < SMALL;
        if small { rayon::current_num_threads() } else { self.spec.nodes_at_once }
    }

    /// Makes v of the nodes below `end`, whose neighbours are there.
    fn transform(&mut self, end: usize) -> Result<()> {
        while self.transformed < end {
            let some = self.transformed..(self.transformed + self.at_once()).min(end);
            let at_slices = self.at_slices(some.clone())?;
            let made = || some.clone().into_par_iter().map(|k| self.made(k, &at_slices)).collect::<Result<Vec<_>>>();
            let made = in_pool(made)?;
            self.transformed = some.end;
            for (k, made) in some.zip(made) {
                if let Some(node) = self.node_mut(k) {
                    node.made = made;
                }
            }
        }
        Ok(())
    }

    /// What the places of some nodes share with all others of their intervals, by these.
    fn at_slices(&self, nodes: Range<usize>) -> Result<BTreeMap<usize, Arc<[Resting; 2]>>> {
        let Some((moving, _)) = self.spec.moving else { return Ok(BTreeMap::new()) };
        let intervals: BTreeSet<usize> = nodes.map(|k| moving.interval(self.nodes.height(k))).collect();
        let known = |i: usize| self.kept.iter().rev().filter_map(Node::place).find(|place| place.interval == i);
        let shared = |i: usize| known(i).map_or_else(|| moving.resting(i), |place| Ok(place.at_slices.clone()));
        intervals.into_iter().map(|i| Ok((i, shared(i)?))).collect()
    }

    fn made(&self, k: usize, at_slices: &BTreeMap<usize, Arc<[Resting; 2]>>) -> Result<Option<Transformed>> {
        let Some(here) = self.node(k) else { return Ok(None) };
        let own = (self.nodes.height(k), &here.phi);
        let beside = |k: usize| self.node(k).map_or(own, |node| (self.nodes.height(k), &node.phi));
        let [below, above] = self.nodes.beside(k).map(beside);
        let rise = (GAP * self.side / self.spec.gap * (above.0 - below.0)) as f32;
        let lengths = Lengths { spacing: self.spec.spacing, bound: self.bound(), rise };
        let [v, gradient] = transform([below.1, &here.phi, above.1], lengths);
        let far = self.bound() * widest(self.nodes.contour(k).is_some());
        let squares = NearSquares::new(&v, far);
        let (mut place, mut near) = (None, Vec::new());
        if let Some((moving, pad)) = self.spec.moving
            && let Some(shared) = at_slices.get(&moving.interval(own.0))
        {
            let (found, paths) = moving.place(own.0, shared.clone())?;
            near = blocks_near(&v, &squares, far, &paths, pad);
            place = Some(found);
        }
        Ok(Some(Transformed { v, gradient, squares, place, near }))
    }

    /// Hands on everything below the upper contour of the interval before `end`, moved, and with the last interval that contour and what lies
    /// beyond so far.
    fn finish_intervals(&mut self, end: usize, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let below = self.spec.contours[end];
        let whole = end == self.spec.layers.end;
        let count = self.waiting.iter().take_while(|w| w.z < below || whole).count();
        let layers: Vec<WaitingLayer> = self.waiting.drain(..count).collect();
        let contours = &self.spec.contours[self.finished..=end];
        let at_once = self.at_once();
        for some in layers.chunks(at_once) {
            let moved = |w: &WaitingLayer| {
                let above = contours.partition_point(|z| *z < w.z);
                match contours.get(above) {
                    Some(z) if above > 0 && w.z < *z => self.moved(w, self.finished + above - 1),
                    _ => w.layer(),
                }
            };
            let layers: Vec<Layer> = in_pool(|| some.into_par_iter().map(moved).collect());
            layers.into_iter().try_for_each(&mut *sink)?;
        }
        self.finished = end;
        self.forget();
        Ok(())
    }

    /// A layer of interval `i` moved by the curve through the corrections.
    fn moved(&self, waiting: &WaitingLayer, i: usize) -> Layer {
        let of = |(k, w): (usize, f64)| Some((self.node(k)?.correction.as_ref()?, w as f32));
        let terms: Vec<(&SparseImage<f32>, f32)> = self.nodes.curve(waiting.z).into_iter().filter_map(of).collect();
        let (farthest, side) = (self.spec.farthest as f32, self.side as f32);
        let ends = [i, i + 1].map(|i| self.node(NODES * i).map(|node| &node.phi));
        let [phi] = SparseImage::of_squares(self.spec.dims, |square, [out]| {
            let still = terms.iter().all(|(correction, _)| correction.whole(square) == Some(0.0));
            match waiting.phi.whole(square) {
                Some(v) if still => return [Some(v)],
                _ => out.copy_from_slice(waiting.phi.square(square)),
            }
            if still {
                return [None];
            }
            let mut sum = [0.0f32; AREA];
            for (correction, w) in &terms {
                sum.iter_mut().zip(correction.square(square)).for_each(|(sum, c)| *sum += w * c);
            }
            let ends = match ends {
                [Some(low), Some(high)] if self.spec.limited => Some([low.square(square), high.square(square)]),
                _ => None,
            };
            shift(out, &sum, ends, [farthest, side]);
            [None]
        });
        waiting.with(phi)
    }

    /// Drops what no later mean, curve or gradient needs.
    fn forget(&mut self) {
        // A place by which trajectories pass through an interval is its lowest node's.
        let averaged = self.lowest.get(self.corrected).map_or(usize::MAX, |node| node / NODES * NODES);
        let averaged = averaged.min(NODES * self.corrected.saturating_sub(1));
        // The curve reads a node below the interval.
        let needed = averaged
            .min((NODES * self.finished).saturating_sub(1))
            .min(self.nodes.beside(self.transformed.min(self.nodes.last()))[0]);
        while self.first < needed && self.kept.pop_front().is_some() {
            self.first += 1;
        }
    }
}

/// Moves the distances of a square by `sum`, cut off where it swings beyond the range of both `ends`, where there are such; never to 0.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn shift(out: &mut [f32; AREA], sum: &[f32; AREA], ends: Option<[&[f32; AREA]; 2]>, [farthest, side]: [f32; 2]) {
    let mut moved = *sum;
    if let Some([low, high]) = ends {
        for n in 0..AREA {
            moved[n] = cut(sum[n], out[n], [low[n], high[n]], side);
        }
    }
    for n in 0..AREA {
        let u = bounded(out[n] + moved[n], farthest);
        let u = if u == 0.0 { f32::MIN_POSITIVE } else { u };
        out[n] = if sum[n] != 0.0 { u } else { out[n] };
    }
}

#[cfg(test)]
mod tests;
