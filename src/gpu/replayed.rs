//! A fairing that the reference path goes on with where its machine fails: what is still needed of its nodes is made there once more.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::backend::Backend;
use crate::backend::fairing::{CorrectionRequest, FairingFrame, FairingState, MoveRequest, TransformRequest};
use crate::error::{Error, Result};
use crate::grid::tiled::Packed;
use crate::reference::Reference;
use crate::stack::heights::NODES;

/// A fairing and what it has been asked for.
pub struct Replayed<'a> {
    state: Box<dyn FairingState + 'a>,
    frame: FairingFrame<'a>,
    /// Whether the reference path may go on after this failure.
    goes_on: Box<dyn Fn(&Error) -> bool + 'a>,
    /// Whether it does.
    replaced: bool,
    nodes: VecDeque<(usize, Arc<Packed<f32>>)>,
    transformed: VecDeque<TransformRequest>,
    corrected: VecDeque<CorrectionRequest>,
}

impl<'a> Replayed<'a> {
    /// A fairing that has no nodes yet.
    pub fn new(
        state: Box<dyn FairingState + 'a>,
        frame: FairingFrame<'a>,
        goes_on: impl Fn(&Error) -> bool + 'a,
    ) -> Self {
        Replayed {
            state,
            frame,
            goes_on: Box::new(goes_on),
            replaced: false,
            nodes: VecDeque::new(),
            transformed: VecDeque::new(),
            corrected: VecDeque::new(),
        }
    }

    /// The answer to a question, by the reference path from the first failure on.
    fn ask<R>(&mut self, on: impl Fn(&mut dyn FairingState) -> Result<R>) -> Result<R> {
        match on(&mut *self.state) {
            Err(error) if !self.replaced && (self.goes_on)(&error) => {
                let mut state = Reference.fairing(self.frame)?;
                self.nodes.iter().for_each(|(k, phi)| state.take(*k, phi.clone()));
                state.transform(self.transformed.make_contiguous())?;
                self.corrected.iter().try_for_each(|request| state.correct(request))?;
                (self.state, self.replaced) = (state, true);
                on(&mut *self.state)
            }
            result => result,
        }
    }
}

/// The lowest node that a correction is made of.
fn lowest(request: &CorrectionRequest) -> usize {
    let means = request.ends.iter().chain(request.between.iter().map(|(mean, ..)| mean));
    let weights = means.flat_map(|mean| mean.weights.iter().map(|(k, _)| *k));
    weights.chain(request.beyond.into_iter().flatten()).fold(request.ends[0].node, usize::min)
}

impl FairingState for Replayed<'_> {
    fn take(&mut self, node: usize, phi: Arc<Packed<f32>>) {
        self.nodes.push_back((node, phi.clone()));
        self.state.take(node, phi);
    }

    fn transform(&mut self, nodes: &[TransformRequest]) -> Result<()> {
        self.ask(|state| state.transform(nodes))?;
        self.transformed.extend(nodes.iter().cloned());
        Ok(())
    }

    fn correct(&mut self, request: &CorrectionRequest) -> Result<()> {
        self.ask(|state| state.correct(request))?;
        self.corrected.push_back(request.clone());
        Ok(())
    }

    fn moved(&mut self, request: &MoveRequest) -> Result<Vec<Packed<f32>>> {
        self.ask(|state| state.moved(request))
    }

    fn forget(&mut self, below: usize) {
        self.state.forget(below);
        self.corrected.retain(|request| request.ends[1].node > below);
        let needed = self.corrected.iter().map(lowest).fold(below, usize::min);
        // Trajectories pass over the lowest node of an interval, whose gradient reads the one below.
        let lowest = needed / NODES * NODES;
        self.transformed.retain(|request| request.node >= lowest);
        self.nodes.retain(|(k, _)| k + 1 >= lowest);
    }
}
