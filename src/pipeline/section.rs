//! Sections of a stack: intervals that are reconstructed alone, with the slices beside them that have a say.
//!
//! What an interval becomes depends on a bounded number of slices to either side, so that sections put together are, bit by bit, the body that
//! a single run makes.

use std::borrow::Cow;
use std::ops::Range;

use crate::error::{Error, Result};
use crate::fairing::Nodes;
use crate::pipeline::fit::CHAIN_REACH;
use crate::reference::displacement::ROUNDS;
use crate::settings::Link;
use crate::settings::{Method, Motion, Settings};
use crate::stack::ContourStack;
use crate::stack::ending::ending;
use crate::stack::heights::middle_gap;

/// Slices that a slope of a field reads on either side of its own.
pub(crate) const NEIGHBOURS: usize = 2;

/// Intervals that are kept, and what has to be computed for them. All numbers are the stack's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Intervals whose layers are kept.
    pub kept: Range<usize>,
    /// Intervals whose layers are computed: fairing reads beyond those that are kept.
    pub(crate) layers: Range<usize>,
    /// Intervals that are traced: slopes are fitted along chains of contours.
    pub(crate) traced: Range<usize>,
    /// Slices that are read.
    pub slices: Range<usize>,
}

impl Section {
    /// The whole stack.
    pub fn whole(stack: &ContourStack) -> Self {
        let all = 0..stack.slices.len().saturating_sub(1);
        Section { kept: all.clone(), layers: all.clone(), traced: all, slices: 0..stack.slices.len() }
    }

    /// Part `number` (from 1) of `count`, as even in intervals as can be.
    ///
    /// # Errors
    /// [`Error::Setting`] for a part that is not there.
    pub fn part(stack: &ContourStack, settings: &Settings, number: usize, count: usize) -> Result<Self> {
        let intervals = stack.slices.len().saturating_sub(1);
        let fail = |name: &str, message| Err(Error::Setting { name: name.into(), message });
        if !(1..=intervals).contains(&count) {
            return fail("parts", format!("must lie in [1, {intervals}], the stack's intervals; got {count}"));
        }
        if !(1..=count).contains(&number) {
            return fail("part", format!("must be K/{count} with K in [1, {count}]; got {number}/{count}"));
        }
        Ok(Section::keeping(stack, settings, (number - 1) * intervals / count..number * intervals / count))
    }

    /// Its slices.
    pub(crate) fn stack<'s>(&self, stack: &'s ContourStack) -> Cow<'s, ContourStack> {
        if self.slices.len() == stack.slices.len() {
            return Cow::Borrowed(stack);
        }
        Cow::Owned(ContourStack {
            slices: stack.slices[self.slices.clone()].to_vec(),
            unit: stack.unit.clone(),
            ..*stack
        })
    }

    /// Output heights at or between its slices, and beyond where the stack ends.
    pub(crate) fn heights(&self, stack: &ContourStack, heights: &[f64]) -> Vec<f64> {
        let low = if self.slices.start == 0 { f64::NEG_INFINITY } else { stack.slices[self.slices.start].z };
        let beyond = self.slices.end == stack.slices.len();
        let high = if beyond { f64::INFINITY } else { stack.slices[self.slices.end - 1].z };
        heights.iter().copied().filter(|z| (low..=high).contains(z)).collect()
    }

    /// The settings with the links of its slices.
    pub(crate) fn settings(&self, settings: &Settings) -> Settings {
        let here = |l: &Link| self.slices.contains(&l.slice) && self.slices.contains(&(l.slice + 1));
        let links = settings.links.iter().filter(|l| here(l));
        let links = links.map(|l| Link { slice: l.slice - self.slices.start, ..*l }).collect();
        Settings { links, ..settings.clone() }
    }

    /// These intervals.
    pub(crate) fn keeping(stack: &ContourStack, settings: &Settings, kept: Range<usize>) -> Self {
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let count = z.len() - 1;
        let beyond = |r: &Range<usize>, by: usize| r.start.saturating_sub(by)..(r.end + by).min(count);
        let mut layers = kept.clone();
        if settings.fair > 0.0 {
            let nodes = Nodes::new(z.clone(), &vec![true; z.len()], middle_gap(&z));
            let known = kept.clone().map(|i| nodes.known(i));
            layers = known.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or(layers);
        }
        let traced = match settings.method {
            Method::Morph => beyond(&layers, CHAIN_REACH),
            Method::Field => layers.clone(),
        };
        // What lies beyond an end follows from contours that can lie farther in.
        let mut told = traced.clone();
        let innermost = |z: &[f64]| ending(z, middle_gap(z)).last().copied().unwrap_or(0);
        if layers.start == 0 {
            told.end = told.end.max(innermost(&z));
        }
        if layers.end == count {
            let from_top: Vec<f64> = z.iter().rev().copied().collect();
            told.start = told.start.min(count - innermost(&from_top));
        }
        let moved = match (settings.method, settings.motion) {
            (Method::Morph, Motion::None) => told,
            // Rates know the intervals beside theirs, every round those beside its own.
            _ => beyond(&beyond(&told, NEIGHBOURS), 1 + ROUNDS.len()),
        };
        let mut slices = moved.start..moved.end + 1;
        // An empty slice reads as its nearest contours.
        let empty = |i: usize| stack.slices[i].content.is_empty();
        while slices.start > 0 && empty(slices.start) {
            slices.start -= 1;
        }
        while slices.end < z.len() && empty(slices.end - 1) {
            slices.end += 1;
        }
        Section { kept, layers, traced, slices }
    }
}
