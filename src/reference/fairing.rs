//! Fairing on the reference path: nodes are kept packed, and layers are worked on side by side where they are small.

use std::collections::VecDeque;
use std::sync::Arc;

use rayon::prelude::*;

use super::fairing_near::widest;
use super::fairing_nodes::{Node, Transformed, blocks_near};
use super::fairing_transform::{Lengths, transform};
use crate::backend::fairing::{CorrectionRequest, FairingFrame, FairingState, MoveRequest, TransformRequest};
use crate::error::Result;
use crate::grid::tiled::Packed;
use crate::registration::displacement::Resting;

/// Layers of fewer pixels are worked on side by side.
const SMALL: usize = 1 << 20;

/// Nodes that have come and are still needed.
pub struct ReferenceFairing<'m> {
    pub(super) frame: FairingFrame<'m>,
    pub(super) kept: VecDeque<Node>,
    /// Number of the first of them.
    first: usize,
}

/// Does `work` on a thread of the pool, from which its loops need not hand anything over to another.
pub(super) fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

impl<'m> ReferenceFairing<'m> {
    /// Nothing yet.
    pub fn new(frame: FairingFrame<'m>) -> Self {
        ReferenceFairing { frame, kept: VecDeque::new(), first: 0 }
    }

    /// B.
    pub(super) fn bound(&self) -> f32 {
        self.frame.bound as f32
    }

    pub(super) fn node(&self, k: usize) -> Option<&Node> {
        self.kept.get(k.checked_sub(self.first)?)
    }

    pub(super) fn node_mut(&mut self, k: usize) -> Option<&mut Node> {
        self.kept.get_mut(k.checked_sub(self.first)?)
    }

    /// Layers that are worked on at the same time: rows of small ones are too little for all threads.
    pub(super) fn at_once(&self) -> usize {
        if self.frame.dims[0] * self.frame.dims[1] < SMALL { rayon::current_num_threads() } else { 1 }
    }

    /// Places of one interval that were made side by side keep its displacement at the slices once.
    fn share_slices(&mut self) {
        let mut known: Option<(usize, Arc<[Resting; 2]>)> = None;
        let places = self.kept.iter_mut().filter_map(|node| node.made.as_mut()?.place.as_mut());
        for place in places {
            match &known {
                Some((interval, at_slices)) if *interval == place.interval => place.at_slices = at_slices.clone(),
                _ => known = Some((place.interval, place.at_slices.clone())),
            }
        }
    }

    /// v and the gradient of a node, and its place in the moving frame.
    fn made(&self, asked: &TransformRequest) -> Result<Option<Transformed>> {
        let Some(here) = self.node(asked.node) else { return Ok(None) };
        let [below, above] = asked.beside.map(|k| self.node(k).map_or(&here.phi, |node| &node.phi));
        let lengths = Lengths { spacing: self.frame.spacing, bound: self.bound(), rise: asked.rise as f32 };
        let [v, gradient] = transform([below, &here.phi, above], lengths);
        let far = self.bound() * widest(asked.at_contour);
        let (mut place, mut near) = (None, Vec::new());
        if let Some((moving, pad)) = self.frame.moving {
            let known = self.kept.iter().take(asked.node - self.first).rev().find_map(Node::place);
            let (found, paths) = moving.place(asked.z, known)?;
            near = blocks_near(&v, far, &paths, pad);
            place = Some(found);
        }
        Ok(Some(Transformed { v, gradient, at_contour: asked.at_contour, place, near }))
    }
}

impl FairingState for ReferenceFairing<'_> {
    fn take(&mut self, node: usize, phi: Arc<Packed<f32>>) {
        if self.kept.is_empty() {
            self.first = node;
        }
        self.kept.push_back(Node::new(phi));
    }

    fn transform(&mut self, nodes: &[TransformRequest]) -> Result<()> {
        for some in nodes.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|asked| self.made(asked)).collect::<Result<Vec<_>>>();
            for (asked, made) in some.iter().zip(in_pool(made)?) {
                if let Some(node) = self.node_mut(asked.node) {
                    node.made = made;
                }
            }
            self.share_slices();
        }
        Ok(())
    }

    fn correct(&mut self, request: &CorrectionRequest) -> Result<()> {
        let mut at_ends = [None, None];
        for (known, end) in at_ends.iter_mut().zip(&request.ends) {
            let found = self.node_mut(end.node).and_then(|node| node.difference.take());
            let made = || in_pool(|| Packed::of(self.frame.dims, &self.difference(end)));
            *known = Some(found.unwrap_or_else(made));
        }
        for some in request.between.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|node| self.correction(node, request, &at_ends)).collect::<Vec<_>>();
            for ((mean, ..), made) in some.iter().zip(in_pool(made)) {
                if let Some(node) = self.node_mut(mean.node) {
                    node.correction = made;
                }
            }
        }
        // The next interval begins with the upper one.
        let [_, upper] = at_ends;
        if let Some(node) = self.node_mut(request.ends[1].node) {
            node.difference = upper;
        }
        Ok(())
    }

    fn moved(&mut self, request: &MoveRequest) -> Result<Vec<Packed<f32>>> {
        let moved = |layer| self.layer(layer, request.ends);
        Ok(request
            .layers
            .chunks(self.at_once())
            .flat_map(|some| in_pool(|| some.par_iter().map(moved).collect::<Vec<_>>()))
            .collect())
    }

    fn forget(&mut self, below: usize) {
        while self.first < below && self.kept.pop_front().is_some() {
            self.first += 1;
        }
    }
}
