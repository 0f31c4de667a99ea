//! Constrained fairing: a smoothing along z that leaves the input contours where they are and makes them invisible.
//!
//! It is a function of the stack. At the nodes of every interval (`nodes`) the signed distance u becomes `v = B tanh(u / (n B))` with the 3D
//! gradient `n = max(|grad u|, 0.3)`, which counts near the surface only; along z a median gap counts as GAP px, so that heights have no unit. With
//! the mean K along the trajectories of the moving field (or straight along z), `D = K v - v`, a node between the contours i and i + 1
//! is moved by `C = alpha n (D - (1 - w) D_i - w D_{i+1})`, `w = 3 t^2 - 2 t^3`, where v is small against B: as smoothing would move it, less
//! what would move the contours (D_i fades out where its |v| / B goes from 0.82 to 0.88), and not where the surface lies flat or a part is on
//! one contour alone (`goes_on`). Where slopes
//! may not overshoot, neither may C (`limit`). A layer at any height moves by the C1 curve in z through the C of the nodes, 0 at contours, cut off
//! where that swings beyond what a node may move by. Beyond
//! the first and the last contour nothing moves, and nothing there has a say.

mod along;
mod flatness;
mod kept;
mod limit;
mod near;
mod nodes;
mod transform;

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec2;
use rayon::prelude::*;

use self::along::add;
use self::kept::{Near, Node, Transformed, WaitingLayer, blocks_near};
use self::limit::{cut, goes_on, limited};
use self::near::{NearSquares, SATURATED, fade, nearer, nearness, widest};
pub use self::nodes::Nodes;
use self::transform::{Lengths, transform};

use crate::error::Result;
use crate::grid::sparse_image::{AREA, SparseImage};
use crate::grid::spline::smoothstep;
use crate::registration::displacement::{Displacement, Resting};
use crate::registration::motion_stack::MotionStack;
use crate::stack::heights::NODES;
use crate::surface::Layer;

/// Length that the stack's median gap counts as along z, px of the larger side.
const GAP: f64 = 6.0;
/// B, px of the larger side: half of a gap.
const BOUND: f64 = 0.5 * GAP;

/// Height over which v's gradient along z is taken, at least, in median gaps: over a far shorter one it would tell of rounding and of the steps of a sweep,
/// and nodes of longer gaps read v there. It counts in gaps of less than a quarter of the median.
const LEAST_RISE: f64 = 1.0 / 16.0;

/// Does `work` on a thread of the pool, from which its loops need not hand anything over to another.
fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Layers of fewer pixels are worked on side by side.
const SMALL: usize = 1 << 20;

/// Facts about a stack that fairing needs.
pub struct FairingSpec<'m> {
    /// The frame in which layers follow each other, and the padding of its image.
    pub moving: Option<(&'m MotionStack<'m>, [usize; 2])>,
    /// Heights of the contours, increasing.
    pub contours: Vec<f64>,
    /// The first and last of the intervals whose layers come.
    pub layers: Range<usize>,
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// Median gap of the whole stack.
    pub gap: f64,
    /// Strength, 0 to 1.5.
    pub alpha: f64,
    /// Whether layers may not leave the range of their two contours.
    pub limited: bool,
    /// Whether the slope at the first and at the last contour is one that an end asks for: it stays.
    pub steered: [bool; 2],
    /// Distances count up to this, unit of the spacing.
    pub farthest: f64,
    /// For an interval with parts that are kept apart the share of the strength at each pixel: smoothing would join them.
    pub shares: Vec<Option<Vec<f32>>>,
}

/// Distances of a node, and where the trajectories of another one read them.
type Seen<'n> = (&'n Arc<SparseImage<f32>>, Option<Displacement>);

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
    /// The lowest node without v.
    transformed: usize,
    /// The lowest interval without corrections, and the lowest whose layers wait.
    corrected: usize,
    finished: usize,
}

impl<'m> Fairing<'m> {
    /// Nothing yet.
    pub fn new(spec: FairingSpec<'m>) -> Self {
        let (nodes, start) = (Nodes::new(spec.contours.clone()), spec.layers.start);
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
            Some(node) => self.advance(node, node == NODES * self.spec.layers.end, sink),
            None => Ok(()),
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
        // A gradient along z is taken from the nodes to both sides.
        let ready = if last { newest + 1 } else { newest };
        self.transform(ready)?;
        while self.corrected < self.spec.layers.end {
            // The contours beyond the interval's own are asked whether the surface goes on there.
            let beyond = (NODES * (self.corrected + 2)).min(self.nodes.last());
            let needed = self.averaged[self.corrected].end.max(beyond + 1);
            if needed > ready && !last {
                break;
            }
            self.correct(self.corrected);
            self.corrected += 1;
        }
        // The curve's slope at a contour reads the corrections on both sides.
        while self.finished + 1 < self.corrected || (last && self.finished < self.corrected) {
            self.finish_interval(sink)?;
        }
        Ok(())
    }

    fn node(&self, k: usize) -> Option<&Node> {
        self.kept.get(k.checked_sub(self.first)?)
    }

    /// Layers that are worked on at the same time: rows of small ones are too little for all threads.
    fn at_once(&self) -> usize {
        if self.spec.dims[0] * self.spec.dims[1] < SMALL { rayon::current_num_threads() } else { 1 }
    }

    /// Makes v of the nodes below `end`, whose neighbours are there.
    fn transform(&mut self, end: usize) -> Result<()> {
        while self.transformed < end {
            let some = self.transformed..(self.transformed + self.at_once()).min(end);
            let made = || some.clone().into_par_iter().map(|k| self.made(k)).collect::<Result<Vec<_>>>();
            let made = in_pool(made)?;
            self.transformed = some.end;
            for (k, made) in some.zip(made) {
                if let Some(node) = k.checked_sub(self.first).and_then(|k| self.kept.get_mut(k)) {
                    node.made = made;
                }
            }
        }
        Ok(())
    }

    fn made(&self, k: usize) -> Result<Option<Transformed>> {
        let Some(here) = self.node(k) else { return Ok(None) };
        let beside = |k: Option<usize>| k.and_then(|k| Some((self.nodes.height(k), &self.node(k)?.phi)));
        let own = (self.nodes.height(k), &here.phi);
        let below = beside(k.checked_sub(1)).unwrap_or(own);
        let above = beside((k < self.nodes.last()).then_some(k + 1)).unwrap_or(own);
        let scale = GAP * self.side / self.spec.gap;
        let rise = (scale * (above.0 - below.0)).max(LEAST_RISE * GAP * self.side) as f32;
        let lengths = Lengths { spacing: self.spec.spacing, bound: self.bound(), rise };
        let [v, gradient] = transform([below.1, &here.phi, above.1], lengths);
        let far = self.bound() * widest(self.nodes.contour(k).is_some());
        let squares = NearSquares::new(&v, far);
        let (mut place, mut near) = (None, Vec::new());
        if let Some((moving, pad)) = self.spec.moving {
            let known = self.kept.iter().take(k - self.first).rev().find_map(Node::place);
            let (found, paths) = moving.place(own.0, known)?;
            near = blocks_near(&v, &squares, far, &paths, pad);
            place = Some(found);
        }
        Ok(Some(Transformed { v, gradient, squares, place, near }))
    }

    /// Offsets of the trajectories from node `k` to node `l` in the blocks near its surface, px of the image; `None` where they stand still.
    fn offsets(&self, k: usize, l: usize) -> Option<Displacement> {
        let (_, pad) = self.spec.moving.filter(|_| k != l)?;
        let (from, to) = (self.node(k)?.made.as_ref()?, self.node(l)?.place()?);
        let (near, from) = (&from.near, from.place.as_ref()?);
        // The lowest node of every interval between both is among those that are kept.
        let intervals = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let of = |i| self.kept.iter().filter_map(Node::place).find(|place| place.interval == i);
        let between: Vec<&[Resting; 2]> = intervals.filter_map(of).map(|place| &*place.at_slices).collect();
        let mut offsets = Displacement::zero(self.spec.dims);
        let offset = |&(block, slices): &Near| {
            from.carry(slices, to, &between) - DVec2::from(pad.map(|p| p as f64)) - offsets.centre(block)
        };
        let found: Vec<DVec2> = near.par_iter().map(offset).collect();
        near.iter().zip(found).for_each(|((block, _), offset)| offsets.vectors[*block] = offset);
        Some(offsets)
    }

    /// `K v - v` at node `k`, zero far from its surface.
    fn difference(&self, k: usize) -> SparseImage<f32> {
        let dims = self.spec.dims;
        let Some(own) = self.node(k).and_then(|node| node.made.as_ref()) else { return SparseImage::filled(dims, 0.0) };
        let at_contour = self.nodes.contour(k).is_some();
        let far = self.bound() * widest(at_contour);
        let term = |(l, w): (usize, f64)| {
            let other = self.node(l).and_then(|node| node.made.as_ref())?;
            Some((&other.v, w as f32, self.offsets(k, l)))
        };
        let terms: Vec<(&SparseImage<f32>, f32, Option<Displacement>)> =
            self.nodes.weights(k).into_iter().filter_map(term).collect();
        let nowhere = |square: [usize; 2]| own.squares.is_far(square).then_some([0.0]);
        let [difference] = SparseImage::of_stretches(dims, nowhere, |[left, first], width, [rows]: [&mut [f32]; 1]| {
            let mut row = vec![0.0; width];
            for (j, out) in (first..).zip(rows.chunks_exact_mut(width)) {
                own.v.read(left, j, &mut row);
                for pixels in nearer(&row, far) {
                    let (out, row) = (&mut out[pixels.clone()], &row[pixels.clone()]);
                    out.iter_mut().zip(row).for_each(|(sum, own)| *sum = -own);
                    for (v, w, offsets) in &terms {
                        add(v, *w, offsets.as_ref(), j, left + pixels.start, out);
                    }
                    if at_contour {
                        let fading = out.iter_mut().zip(row);
                        fading.for_each(|(sum, own)| *sum *= fade(own.abs() / self.bound()) as f32);
                    }
                }
            }
        });
        difference
    }

    /// Makes the corrections of the nodes of interval `i`.
    fn correct(&mut self, i: usize) {
        let ends = [NODES * i, NODES * (i + 1)];
        let mut at_ends = ends.map(|k| k.checked_sub(self.first).and_then(|k| self.kept.get_mut(k)?.difference.take()));
        for (k, known) in ends.into_iter().zip(&mut at_ends) {
            known.get_or_insert_with(|| in_pool(|| self.difference(k)));
        }
        let between: Vec<usize> = (ends[0] + 1..ends[1]).collect();
        for some in between.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|&k| self.correction(k, i, ends, &at_ends)).collect::<Vec<_>>();
            for (&k, made) in some.iter().zip(in_pool(made)) {
                if let Some(node) = k.checked_sub(self.first).and_then(|k| self.kept.get_mut(k)) {
                    node.correction = made;
                }
            }
        }
        // The next interval begins with the upper one.
        let [_, upper] = at_ends;
        if let Some(node) = ends[1].checked_sub(self.first).and_then(|k| self.kept.get_mut(k)) {
            node.difference = upper;
        }
    }

    /// Correction of node `k` of interval `i`: its own difference less what the contours below and above would move by, read along the
    /// trajectories.
    fn correction(
        &self,
        k: usize,
        i: usize,
        ends: [usize; 2],
        at_ends: &[Option<SparseImage<f32>>; 2],
    ) -> Option<SparseImage<f32>> {
        let node = self.node(k)?;
        let Transformed { v, gradient, squares, .. } = node.made.as_ref()?;
        let [low, high] = [self.node(ends[0])?, self.node(ends[1])?];
        let [at_low, at_high] = [at_ends[0].as_ref()?, at_ends[1].as_ref()?];
        let d = self.difference(k);
        let offsets = ends.map(|end| self.offsets(k, end));
        // What lies on the other side of either contour.
        let beyond = [ends[0].checked_sub(NODES), Some(ends[1] + NODES)];
        let beyond = beyond.map(|end| end.and_then(|end| Some((&self.node(end)?.phi, self.offsets(k, end)))));
        let t = (k - ends[0]) as f64 / NODES as f64;
        let (first, last) = (i == 0, i + 1 == self.nodes.intervals());
        let at_first = if first && self.spec.steered[0] { smoothstep(t) } else { 1.0 };
        let at_last = if last && self.spec.steered[1] { smoothstep(1.0 - t) } else { 1.0 };
        let alpha = (at_first * at_last * self.spec.alpha) as f32;
        let (w, bound, nx) = (smoothstep(t) as f32, self.bound(), self.spec.dims[0]);
        let nowhere = |square: [usize; 2]| squares.is_far(square).then_some([0.0]);
        let shares = self.spec.shares.get(i).and_then(Option::as_ref);
        let side = self.side as f32;
        let [correction] = SparseImage::of_stretches(self.spec.dims, nowhere, |[left, first], width, [rows]| {
            let [mut own, mut slope, mut here, mut own_d] = [const { Vec::new() }; 4];
            [&mut own, &mut slope, &mut here, &mut own_d].into_iter().for_each(|line| line.resize(width, 0.0));
            // Both contours' differences and distances along the trajectories, and their distances straight along z.
            let mut there: [Vec<f32>; 6] = Default::default();
            for (j, out) in (first..).zip(rows.chunks_exact_mut(width)) {
                v.read(left, j, &mut own);
                gradient.read(left, j, &mut slope);
                d.read(left, j, &mut own_d);
                for pixels in nearer(&own, SATURATED * bound) {
                    let begin = left + pixels.start;
                    there.iter_mut().for_each(|there| {
                        there.clear();
                        there.resize(pixels.len(), 0.0);
                    });
                    let [low_d, high_d, low_along, high_along, low_straight, high_straight] = &mut there;
                    add(at_low, 1.0, offsets[0].as_ref(), j, begin, low_d);
                    add(at_high, 1.0, offsets[1].as_ref(), j, begin, high_d);
                    add(&low.phi, 1.0, offsets[0].as_ref(), j, begin, low_along);
                    add(&high.phi, 1.0, offsets[1].as_ref(), j, begin, high_along);
                    if self.spec.limited {
                        low.phi.read(begin, j, low_straight);
                        high.phi.read(begin, j, high_straight);
                        node.phi.read(begin, j, &mut here[pixels.clone()]);
                    }
                    let on = |p: usize| goes_on([low_along[p], high_along[p]], self.spec.farthest);
                    let mut share: Vec<f32> = (0..pixels.len()).map(on).collect();
                    if share.iter().any(|share| *share < 1.0) {
                        let own = [&*low_along, &*high_along];
                        self.tips(&mut share, own, &beyond, [begin, j]);
                    }
                    for (p, n) in pixels.enumerate() {
                        let alpha = alpha * shares.map_or(1.0, |s| s[j * nx + left + n]);
                        let alpha = alpha * share[p];
                        let rise = alpha * (own_d[n] - (1.0 - w) * low_d[p] - w * high_d[p]);
                        let c = slope[n] * rise * nearness(own[n].abs() / bound) as f32;
                        let ranges = [[low_along[p], high_along[p]], [low_straight[p], high_straight[p]]];
                        out[n] = if self.spec.limited { limited(c, here[n], ranges, side) } else { c };
                    }
                }
            }
        });
        Some(correction)
    }

    /// Tips: a surface that ends in an interval still goes on if it does so from its contour to the other side: it is the tip of a body. `share` says
    /// how far it goes on within the interval, `own` are the distances of the interval's contours, `beyond` those on their other sides; of pixels
    /// from `first` on.
    fn tips(&self, share: &mut [f32], own: [&Vec<f32>; 2], beyond: &[Option<Seen<'_>>; 2], first: [usize; 2]) {
        let farthest = self.spec.farthest;
        for (side, beyond) in beyond.iter().enumerate() {
            let Some((phi, offsets)) = beyond else { continue };
            let mut there = vec![0.0; share.len()];
            add(phi, 1.0, offsets.as_ref(), first[1], first[0], &mut there);
            for (p, share) in share.iter_mut().enumerate() {
                let [here, other] = [own[side][p], own[1 - side][p]];
                if here.abs() < other.abs() {
                    *share = share.max(goes_on([here, there[p]], farthest));
                }
            }
        }
    }

    /// Hands on everything below the upper contour of the lowest interval that is not finished, moved, and with the last interval that contour
    /// and what lies beyond so far.
    fn finish_interval(&mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let [low, high] = [0, 1].map(|k| self.nodes.height(NODES * (self.finished + k)));
        let whole = self.finished + 1 == self.spec.layers.end;
        let count = self.waiting.iter().take_while(|w| w.z < high || whole).count();
        let layers: Vec<WaitingLayer> = self.waiting.drain(..count).collect();
        let at_once = self.at_once();
        for some in layers.chunks(at_once) {
            let moved = |w: &WaitingLayer| if w.z > low && w.z < high { self.moved(w) } else { w.layer() };
            let layers: Vec<Layer> = in_pool(|| some.into_par_iter().map(moved).collect());
            layers.into_iter().try_for_each(&mut *sink)?;
        }
        self.finished += 1;
        self.forget();
        Ok(())
    }

    /// A layer between contours moved by the curve through the corrections.
    fn moved(&self, waiting: &WaitingLayer) -> Layer {
        let of = |(k, w): (usize, f64)| Some((self.node(k)?.correction.as_ref()?, w as f32));
        let terms: Vec<(&SparseImage<f32>, f32)> = self.nodes.curve(waiting.z).into_iter().filter_map(of).collect();
        let (farthest, side) = (self.spec.farthest as f32, self.side as f32);
        let ends = [self.finished, self.finished + 1].map(|i| self.node(NODES * i).map(|node| &node.phi));
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
            let ends = ends.map(|end| end.map(|phi| phi.square(square)));
            for (n, (u, mut c)) in out.iter_mut().zip(sum).enumerate().filter(|(_, (_, c))| *c != 0.0) {
                if let (true, [Some(low), Some(high)]) = (self.spec.limited, ends) {
                    c = cut(c, *u, [low[n], high[n]], side);
                }
                *u = (*u + c).clamp(-farthest, farthest);
                if *u == 0.0 {
                    *u = f32::MIN_POSITIVE;
                }
            }
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
        let needed = averaged.min((NODES * self.finished).saturating_sub(1));
        while self.first < needed && self.kept.pop_front().is_some() {
            self.first += 1;
        }
    }
}

#[cfg(test)]
mod tests;
