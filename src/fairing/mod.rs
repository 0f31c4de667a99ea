//! Constrained fairing: a smoothing along z that leaves the input contours where they are and makes them invisible.
//!
//! It is a function of the stack. At the nodes of every interval (`nodes`) the signed distance u becomes `v = B tanh(u / (n B))` with the 3D
//! gradient `n = max(|grad u|, .3)`, which counts near the surface only; along z a median gap counts as GAP px, so that heights have no unit. With
//! the mean K along the trajectories of the moving field (or straight along z), `D = K v - v`, a node between the contours i and i + 1
//! is moved by `C = alpha n (D - (1 - w) D_i - w D_{i+1})`, `w = 3 t^2 - 2 t^3`, where v is small against B: as smoothing would move it, less
//! what would move the contours (D_i fades out where its |v| / B goes from .82 to .88), and not where the surface lies flat or a part is on
//! one contour alone (`goes_on`). Where slopes
//! may not overshoot, neither may C (`limit`). A layer at any height moves by the C1 curve in z through the C of the nodes, 0 at contours, cut off
//! where that swings beyond what a node may move by. Beyond
//! the first and the last contour nothing moves, and nothing there has a say.

mod nodes;

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

pub use self::nodes::Nodes;
use crate::backend::Backend;
use crate::backend::fairing::{
    CorrectionRequest, FairingFrame, FairingState, LayerMove, MoveRequest, NodeMean, TransformRequest,
};
use crate::error::Result;
use crate::grid::spline::smoothstep;
use crate::grid::tiled::Packed;
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
    pub shares: Vec<Option<Arc<Vec<f32>>>>,
}

/// A layer that waits to be handed on.
struct WaitingLayer {
    /// Height.
    z: f64,
    /// Its distances.
    phi: Arc<Packed<f32>>,
    output: bool,
    contour: Option<usize>,
}

impl WaitingLayer {
    /// A layer that has come, packed.
    fn new(layer: Layer, dims: [usize; 2]) -> Self {
        let Layer { z, phi, output, contour } = layer;
        WaitingLayer { z, phi: Arc::new(Packed::of(dims, &phi)), output, contour }
    }

    /// The layer with these distances.
    fn with(&self, phi: &Packed<f32>) -> Layer {
        Layer { z: self.z, phi: phi.unpack(), output: self.output, contour: self.contour }
    }
}

/// Takes layers in order of height, all nodes among them, and hands them on, faired.
pub struct Fairing<'m> {
    spec: FairingSpec<'m>,
    nodes: Nodes,
    /// Per interval the nodes that its means are taken from, and the lowest that one of it or above is.
    averaged: Vec<Range<usize>>,
    lowest: Vec<usize>,
    side: f64,
    /// What the backend keeps of the nodes.
    state: Box<dyn FairingState + 'm>,
    /// Layers that are not handed on.
    waiting: VecDeque<WaitingLayer>,
    /// The lowest node without v.
    transformed: usize,
    /// The lowest interval without corrections, and the lowest whose layers wait.
    corrected: usize,
    finished: usize,
}

impl<'m> Fairing<'m> {
    /// Nothing yet.
    ///
    /// # Errors
    /// The errors of `backend`.
    pub fn new(spec: FairingSpec<'m>, backend: &'m dyn Backend) -> Result<Self> {
        let (nodes, start) = (Nodes::new(spec.contours.clone()), spec.layers.start);
        let side = spec.spacing[0].max(spec.spacing[1]);
        let averaged: Vec<Range<usize>> = (0..nodes.intervals()).map(|i| nodes.averaged(i)).collect();
        let mut lowest: Vec<usize> = averaged.iter().map(|nodes| nodes.start).collect();
        (1..lowest.len()).rev().for_each(|i| lowest[i - 1] = lowest[i - 1].min(lowest[i]));
        let FairingSpec { moving, dims, spacing, limited, farthest, .. } = spec;
        let frame = FairingFrame { moving, dims, spacing, bound: BOUND * side, limited, farthest };
        Ok(Fairing {
            state: backend.fairing(frame)?,
            spec,
            nodes,
            averaged,
            lowest,
            side,
            waiting: VecDeque::new(),
            transformed: NODES * start,
            corrected: start,
            finished: start,
        })
    }

    /// Takes the next layer; hands on what is finished.
    ///
    /// # Errors
    /// The errors of the backend and of `sink`.
    pub fn push(&mut self, layer: Layer, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let contours = self.spec.layers.start..=self.spec.layers.end;
        let [low, high] = [*contours.start(), *contours.end()].map(|i| self.spec.contours[i]);
        let node = self.nodes.at(layer.z).filter(|_| layer.z >= low && layer.z <= high);
        let dims = self.spec.dims;
        // On a thread of the pool, from which the loops need not hand anything over to another.
        let waiting = rayon::scope(|_| WaitingLayer::new(layer, dims));
        let phi = waiting.phi.clone();
        self.waiting.push_back(waiting);
        match node {
            Some(node) => {
                self.state.take(node, phi);
                self.advance(node, node == NODES * self.spec.layers.end, sink)
            }
            None => Ok(()),
        }
    }

    /// Hands on everything that is left.
    ///
    /// # Errors
    /// The errors of `sink`.
    pub fn finish(mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let left = std::mem::take(&mut self.waiting);
        left.into_iter().try_for_each(|waiting| sink(waiting.with(&waiting.phi)))
    }

    /// Makes whatever can be made once `newest` has come, the `last` of all or not.
    fn advance(&mut self, newest: usize, last: bool, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        // A gradient along z is taken from the nodes to both sides.
        let ready = if last { newest + 1 } else { newest };
        while self.corrected < self.spec.layers.end {
            // The contours beyond the interval's own are asked whether the surface goes on there.
            let beyond = (NODES * (self.corrected + 2)).min(self.nodes.last());
            let needed = self.averaged[self.corrected].end.max(beyond + 1);
            if needed > ready && !last {
                break;
            }
            self.transform(needed.min(ready))?;
            self.state.correct(&self.correction(self.corrected))?;
            self.corrected += 1;
        }
        // The curve's slope at a contour reads the corrections on both sides.
        while self.finished + 1 < self.corrected || (last && self.finished < self.corrected) {
            self.finish_interval(sink)?;
        }
        Ok(())
    }

    /// Makes v of the nodes below `end`, whose neighbours are there.
    fn transform(&mut self, end: usize) -> Result<()> {
        let some: Vec<TransformRequest> = (self.transformed..end).map(|k| self.transformation(k)).collect();
        self.transformed = self.transformed.max(end);
        if some.is_empty() { Ok(()) } else { self.state.transform(&some) }
    }

    /// What v of node `k` is made of.
    fn transformation(&self, k: usize) -> TransformRequest {
        // Below the first and above the last node that comes there is nothing.
        let [first, last] = [self.spec.layers.start, self.spec.layers.end].map(|i| NODES * i);
        let beside = [k.saturating_sub(1).max(first), (k + 1).min(last)];
        let [below, above] = beside.map(|k| self.nodes.height(k));
        let scale = GAP * self.side / self.spec.gap;
        let rise = (scale * (above - below)).max(LEAST_RISE * GAP * self.side);
        TransformRequest { node: k, z: self.nodes.height(k), beside, rise, at_contour: self.nodes.contour(k).is_some() }
    }

    /// What the corrections of interval `i` are made of.
    fn correction(&self, i: usize) -> CorrectionRequest {
        let mean = |k: usize| NodeMean { node: k, weights: self.nodes.weights(k) };
        let [low, high] = [NODES * i, NODES * (i + 1)];
        let (first, last) = (i == 0, i + 1 == self.nodes.intervals());
        let between = |k: usize| {
            let t = (k - low) as f64 / NODES as f64;
            let at_first = if first && self.spec.steered[0] { smoothstep(t) } else { 1.0 };
            let at_last = if last && self.spec.steered[1] { smoothstep(1.0 - t) } else { 1.0 };
            (mean(k), t, at_first * at_last * self.spec.alpha)
        };
        CorrectionRequest {
            ends: [mean(low), mean(high)],
            beyond: [low.checked_sub(NODES), Some(high + NODES).filter(|k| *k <= self.nodes.last())],
            between: (low + 1..high).map(between).collect(),
            shares: self.spec.shares.get(i).cloned().flatten(),
        }
    }

    /// Hands on everything below the upper contour of the lowest interval that is not finished, moved, and with the last interval that contour
    /// and what lies beyond so far.
    fn finish_interval(&mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let ends = [self.finished, self.finished + 1].map(|i| NODES * i);
        let [low, high] = ends.map(|k| self.nodes.height(k));
        let whole = self.finished + 1 == self.spec.layers.end;
        let count = self.waiting.iter().take_while(|w| w.z < high || whole).count();
        let waiting: Vec<WaitingLayer> = self.waiting.drain(..count).collect();
        let within = |w: &WaitingLayer| w.z > low && w.z < high;
        let of =
            |w: &WaitingLayer| LayerMove { phi: w.phi.clone(), node: self.nodes.at(w.z), curve: self.nodes.curve(w.z) };
        let layers = waiting.iter().filter(|w| within(w)).map(of).collect();
        let mut moved = self.state.moved(&MoveRequest { ends, layers })?.into_iter();
        for some in waiting.chunks(rayon::current_num_threads()) {
            let mut pairs: Vec<(&WaitingLayer, Option<Packed<f32>>)> = some.iter().map(|w| (w, None)).collect();
            pairs.iter_mut().filter(|(w, _)| within(w)).for_each(|(_, to)| *to = moved.next());
            let layer = |(w, moved): (&WaitingLayer, Option<Packed<f32>>)| w.with(moved.as_ref().unwrap_or(&w.phi));
            let layers: Vec<Layer> = pairs.into_par_iter().map(layer).collect();
            layers.into_iter().try_for_each(&mut *sink)?;
        }
        self.finished += 1;
        self.forget();
        Ok(())
    }

    /// Drops what no later mean, curve or gradient needs.
    fn forget(&mut self) {
        // A place by which trajectories pass through an interval is its lowest node's.
        let averaged = self.lowest.get(self.corrected).map_or(usize::MAX, |node| node / NODES * NODES);
        let averaged = averaged.min(NODES * self.corrected.saturating_sub(1));
        // The curve reads a node below the interval, and v of nodes to come the node below them.
        let needed = averaged.min((NODES * self.finished).saturating_sub(1)).min(self.transformed.saturating_sub(1));
        self.state.forget(needed);
    }
}

#[cfg(test)]
mod tests;
