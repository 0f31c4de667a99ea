//! Slices on which several labels are drawn.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::appearance::Appearance;
use crate::error::{Error, Result};
use crate::stack::{ContourStack, Slice, SliceContent};

/// Labels by their places in a [`LabelStack`], the lower first.
pub(super) type Pair = (usize, usize);

/// Drawn slices of several labels. Labels are called by their places in `labels`.
#[derive(Debug, Clone)]
pub struct LabelStack {
    /// All labels together.
    pub stack: ContourStack,
    /// The labels' numbers, increasing.
    pub labels: Vec<i64>,
    /// Their names and colours, as far as the input says them.
    pub appearances: Vec<Appearance>,
    /// For each slice and pixel 0, or the place of its label and 1.
    pub drawn: Vec<Vec<u32>>,
    /// Whether every label is given all slices, and not only those from its own first to its own last.
    pub all_slices: bool,
}

impl LabelStack {
    /// Checks that each label can be reconstructed.
    ///
    /// # Errors
    /// Those of [`ContourStack::validate`]; [`Error::Stack`] naming a label that is drawn on fewer than two slices.
    pub fn validate(&self) -> Result<()> {
        self.stack.validate()?;
        for (a, label) in self.labels.iter().enumerate() {
            let slices = self.slices(a).len();
            if slices < 2 {
                return Err(Error::Stack(format!(
                    "label {label} is drawn on {} of the slices, at least 2 are needed; leave it out of `--labels`",
                    if slices == 0 { "none" } else { "1" },
                )));
            }
        }
        Ok(())
    }

    /// Slices that label `a` is given.
    pub fn slices(&self, a: usize) -> Range<usize> {
        let here = |slice: &Vec<u32>| slice.contains(&(a as u32 + 1));
        let first = self.drawn.iter().position(here).unwrap_or(0);
        let last = self.drawn.iter().rposition(here).map_or(0, |k| k + 1);
        if self.all_slices && last > 0 { 0..self.drawn.len() } else { first..last }
    }

    /// Pixels drawn with label `a`, and the first of them.
    pub(super) fn drawn_pixels(&self, a: usize) -> (u64, usize) {
        let all = self.drawn.iter().flatten().enumerate().filter(|(_, l)| **l == a as u32 + 1);
        all.fold((0, usize::MAX), |(count, first), (n, _)| (count + 1, first.min(n)))
    }

    /// Label `a` alone.
    pub fn alone(&self, a: usize) -> ContourStack {
        self.united(&[a])
    }

    /// Some labels as one body.
    pub(super) fn united(&self, labels: &[usize]) -> ContourStack {
        let slices = labels.iter().map(|&a| self.slices(a)).reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
        let mut inside = vec![false; self.labels.len() + 1];
        labels.iter().for_each(|&a| inside[a + 1] = true);
        let slice = |k: usize| {
            let mask = self.drawn[k].iter().map(|&l| inside[l as usize]).collect();
            let Slice { name, z, extra, .. } = &self.stack.slices[k];
            Slice { name: name.clone(), z: *z, extra: *extra, content: SliceContent::Mask(mask) }
        };
        ContourStack {
            slices: slices.unwrap_or(0..0).map(slice).collect(),
            unit: self.stack.unit.clone(),
            ..self.stack
        }
    }

    /// For each slice the labels that have pixels side by side.
    pub(super) fn touching(&self) -> Vec<BTreeSet<Pair>> {
        let nx = self.stack.dims[0];
        let on = |slice: &Vec<u32>| {
            let mut pairs = BTreeSet::new();
            for (n, &a) in slice.iter().enumerate() {
                let right = if (n + 1) % nx == 0 { 0 } else { slice[n + 1] };
                let below = slice.get(n + nx).copied().unwrap_or(0);
                for b in [right, below] {
                    if a != b && a > 0 && b > 0 {
                        pairs.insert((a.min(b) as usize - 1, a.max(b) as usize - 1));
                    }
                }
            }
            pairs
        };
        self.drawn.iter().map(on).collect()
    }

    /// Labels that touch each other on two neighbouring slices, some by way of others; only groups of more than one.
    pub(super) fn groups(&self, touching: &[BTreeSet<Pair>]) -> Vec<Vec<usize>> {
        let mut group: Vec<usize> = (0..self.labels.len()).collect();
        for (a, b) in touching.windows(2).flat_map(|w| w[0].intersection(&w[1])) {
            let (into, from) = (group[*a], group[*b]);
            group.iter_mut().filter(|g| **g == from).for_each(|g| *g = into);
        }
        let members = |g: usize| (0..group.len()).filter(|&a| group[a] == g).collect::<Vec<_>>();
        (0..group.len()).map(members).filter(|m| m.len() > 1).collect()
    }
}
