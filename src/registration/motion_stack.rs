//! A stack in its moving frame whose large parts lie on shelves: fields of the slices, displacements of the intervals.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::error::Result;
use crate::grid::field::Field;
use crate::registration::displacement::{Displacement, Resting};
use crate::registration::mid_frame::Frame;
use crate::registration::motion_field::{MotionField, Moved, Paths, Place, rate, through_middle, time};
use crate::storage::spill::{Budget, Large, SpillVec};

/// The stack in its moving frame.
pub struct MotionStack<'b> {
    heights: Vec<f64>,
    gaps: Vec<f64>,
    px: f64,
    relief: f64,
    doubt: f64,
    fields: SpillVec<'b, Field>,
    displacements: SpillVec<'b, Displacement>,
    at_slices: SpillVec<'b, [Displacement; 2]>,
    rates: SpillVec<'b, Displacement>,
    through_middle: SpillVec<'b, [Displacement; 2]>,
}

/// What a rate reads of an interval.
fn moved(interval: &Option<(Arc<[Displacement; 2]>, f64)>) -> Option<Moved<'_>> {
    interval.as_ref().map(|(v, gap)| (&**v, *gap))
}

/// Things of a stack on shelves, as many made side by side as there is room for.
fn spilled<'b, T: Large + Send>(
    budget: &'b Budget,
    count: usize,
    make: impl Fn(usize) -> Result<T> + Sync,
) -> Result<SpillVec<'b, T>> {
    let mut made = SpillVec::new(budget);
    let at_once = if budget.is_bounded() { 1 } else { count.max(1) };
    for first in (0..count).step_by(at_once) {
        let some = (first..(first + at_once).min(count)).into_par_iter().map(&make).collect::<Result<Vec<T>>>()?;
        some.into_iter().try_for_each(|one| made.push(one))?;
    }
    Ok(made)
}

impl<'b> MotionStack<'b> {
    /// The moving stack that follows from `fields` and `displacements` of slices at these heights. `gaps` are those of the stack, which may be
    /// longer; `px` is the length of a pixel's larger side, `relief` how far the whole stack is relief, `doubt` what contours may be off by, px; `drawn` says which slices are not empty.
    ///
    /// # Errors
    /// The errors of the shelves.
    #[expect(clippy::too_many_arguments, reason = "the facts of one stack, known to one caller")]
    pub fn new(
        heights: Vec<f64>,
        gaps: Vec<f64>,
        px: f64,
        relief: f64,
        doubt: f64,
        fields: SpillVec<'b, Field>,
        displacements: SpillVec<'b, Displacement>,
        drawn: &[bool],
        budget: &'b Budget,
    ) -> Result<Self> {
        let intervals = heights.len() - 1;
        let at_slices: SpillVec<'_, [Displacement; 2]> =
            spilled(budget, intervals, |i| Ok(displacements.get(i)?.at_slices()))?;
        let rates: SpillVec<'_, Displacement> = spilled(budget, heights.len(), |i| {
            let beside = |k: Option<usize>| k.map(|k| Ok((at_slices.get(k)?, gaps[k]))).transpose();
            let (low, high) = (beside(i.checked_sub(1))?, beside(Some(i).filter(|i| *i < intervals))?);
            // Nothing moves onto an empty slice, and where it is far nothing goes astray on the way there and back.
            let (low, high) = match [i > 0 && drawn[i - 1], i + 1 < drawn.len() && drawn[i + 1]] {
                [true, false] => (low.map(|(v, h)| (v, high.map_or(h, |(_, beyond)| h.max(beyond)))), None),
                [false, true] => (None, high.map(|(v, h)| (v, low.map_or(h, |(_, beyond)| h.max(beyond))))),
                _ => (low, high),
            };
            let between = |k: &usize| *k < intervals && drawn[*k] && drawn[*k + 1];
            let [farther, beyond] = [i.checked_sub(2), Some(i + 1)].map(|k| k.filter(between));
            let (farther, beyond) = (beside(farther)?, beside(beyond)?);
            Ok(rate([moved(&low), moved(&high)], [moved(&farther), moved(&beyond)], doubt))
        })?;
        let through_middle = spilled(budget, intervals, |i| {
            Ok(through_middle(&*displacements.get(i)?, gaps[i], [&*rates.get(i)?, &*rates.get(i + 1)?]))
        })?;
        Ok(MotionStack { heights, gaps, px, relief, doubt, fields, displacements, at_slices, rates, through_middle })
    }

    /// Number of slices.
    pub fn slices(&self) -> usize {
        self.heights.len()
    }

    /// Height of interval `i`.
    pub fn gap(&self, i: usize) -> f64 {
        self.gaps[i]
    }

    /// The field of slice `i`.
    ///
    /// # Errors
    /// The errors of the shelf.
    pub fn field(&self, i: usize) -> Result<Arc<Field>> {
        self.fields.get(i)
    }

    /// The displacement of interval `i` at its slices.
    ///
    /// # Errors
    /// The errors of the shelf.
    pub fn at_slices(&self, i: usize) -> Result<Arc<[Displacement; 2]>> {
        self.at_slices.get(i)
    }

    /// The rate of motion at slice `i`.
    ///
    /// # Errors
    /// The errors of the shelf.
    pub fn rate(&self, i: usize) -> Result<Arc<Displacement>> {
        self.rates.get(i)
    }

    /// The moving field of some slices alone, numbered from 0.
    ///
    /// # Errors
    /// The errors of the shelves.
    pub fn part(&self, slices: Range<usize>) -> Result<MotionField> {
        let fields = slices.clone().map(|i| self.fields.get(i)).collect::<Result<_>>()?;
        Ok(MotionField { fields, ..self.frame(slices)? })
    }

    /// The moving field of some slices without their fields.
    ///
    /// # Errors
    /// The errors of the shelves.
    pub fn frame(&self, slices: Range<usize>) -> Result<MotionField> {
        let intervals = slices.start..slices.end - 1;
        Ok(MotionField {
            heights: self.heights[slices.clone()].to_vec(),
            gaps: self.gaps[intervals.clone()].to_vec(),
            px: self.px,
            relief: self.relief,
            doubt: self.doubt,
            fields: Vec::new(),
            displacements: intervals.clone().map(|i| self.displacements.get(i)).collect::<Result<_>>()?,
            at_slices: intervals.clone().map(|i| self.at_slices.get(i)).collect::<Result<_>>()?,
            through_middle: intervals.map(|i| self.through_middle.get(i)).collect::<Result<_>>()?,
            rates: slices.map(|i| self.rates.get(i)).collect::<Result<_>>()?,
        })
    }

    /// The mid frame of interval `i`.
    ///
    /// # Errors
    /// The errors of the shelves.
    pub fn middle(&self, i: usize) -> Result<Frame> {
        Ok(Frame::middle_of(&self.frame(i..i + 2)?, 0))
    }

    /// The interval in which a height lies, that above a contour, the nearest beyond the stack.
    pub fn interval(&self, z: f64) -> usize {
        self.heights.partition_point(|h| *h <= z).clamp(1, self.displacements.len()) - 1
    }

    /// The displacement of interval `i` at its slices, to be read by the places of its layers.
    ///
    /// # Errors
    /// The errors of the shelf.
    pub fn resting(&self, i: usize) -> Result<Arc<[Resting; 2]>> {
        Ok(Arc::new(self.at_slices.get(i)?.each_ref().map(Resting::from)))
    }

    /// The place of height `z`, the nearest slice's beyond the stack, and the paths through it; `at_slices` is what its interval's places share.
    ///
    /// # Errors
    /// The errors of the shelves.
    pub fn place(&self, z: f64, at_slices: Arc<[Resting; 2]>) -> Result<(Place, Paths)> {
        let interval = self.interval(z);
        let t = time(z, self.heights[interval], self.heights[interval + 1]);
        let frame = self.frame(interval..interval + 2)?;
        Ok(Place::new(&frame, 0, interval, t, at_slices))
    }
}
