//! The stack in its moving frame: fields on a shelf, displacements between them, and what the stages ask of both.

use std::ops::Range;
use std::sync::Arc;

use super::Run;
use crate::contours::Contour;
use crate::displacement::{Displacement, DisplacementJob};
use crate::error::Result;
use crate::field::Field;
use crate::jobs::Direction;
use crate::matching::lone_solids;
use crate::motion::Frame;
use crate::moving_field::{LEAST_DEPTH, LoneParts, MovingField, drawn_in};
use crate::reference::displacement::ROUNDS;
use crate::section::NEIGHBOURS;
use crate::settings::Motion;
use crate::shelf::Shelf;

/// The stack in its moving frame.
pub(super) struct MovingStack<'b> {
    /// The frame, without fields.
    pub frame: MovingField,
    fields: Shelf<'b, Field>,
}

impl MovingStack<'_> {
    /// Some slices alone, numbered from 0.
    fn part(&self, slices: Range<usize>) -> Result<MovingField> {
        let fields = slices.clone().map(|i| self.fields.get(i)).collect::<Result<_>>()?;
        Ok(self.frame.part(slices, fields))
    }

    /// Interval `i` alone, as number 0; its rates are those of the stack.
    pub fn interval(&self, i: usize) -> Result<MovingField> {
        self.part(i..i + 2)
    }

    /// The mid frame of interval `i`.
    pub fn middle(&self, i: usize) -> Frame {
        Frame::middle_of(&self.frame, i)
    }
}

impl<'a> Run<'a> {
    /// The stack in its moving frame.
    pub(super) fn moving(&mut self, contours: &Shelf<'a, Contour>) -> Result<MovingStack<'a>> {
        self.stage("motion", contours.len() - 1, |run| {
            let fields = run.filled_fields(contours)?;
            let z: Vec<f64> = (0..contours.len()).map(|i| contours.light(i).z).collect();
            let displacements = match run.settings.motion {
                Motion::Field => {
                    let guess = run.frames(contours)?;
                    run.displacements(&fields, &guess)?
                }
                Motion::Rigid => run.frames(contours)?,
                Motion::None => vec![Displacement::zero(run.padded()); z.len() - 1],
            };
            run.progress.advance(z.len() - 1);
            Ok(MovingStack {
                frame: MovingField::with_gaps(z, run.span.gaps.clone(), run.px, Vec::new(), displacements),
                fields,
            })
        })
    }

    /// Distances of all slices; an empty one reads as its nearest contours drawn in.
    fn filled_fields(&self, contours: &Shelf<'a, Contour>) -> Result<Shelf<'a, Field>> {
        let mut fields = Shelf::new(self.budget);
        let full = |i: &usize| contours.light(*i).solids.count > 0;
        for i in 0..contours.len() {
            fields.push(if full(&i) {
                contours.get(i)?.phi.clone()
            } else {
                let nearest = [(0..i).rev().find(full), (i + 1..contours.len()).find(full)];
                let nearest = nearest.into_iter().flatten().map(|k| contours.get(k)).collect::<Result<Vec<_>>>()?;
                drawn_in(&nearest, self.padded())
            })?;
        }
        Ok(fields)
    }

    /// Displacements of all intervals: all rounds together where the fields fit into memory, else round by round a few intervals at a time,
    /// with one to either side that takes part.
    fn displacements(&self, fields: &Shelf<'a, Field>, guess: &[Displacement]) -> Result<Vec<Displacement>> {
        let gaps = &self.span.gaps;
        let count = gaps.len();
        let load = |slices: Range<usize>| slices.map(|i| fields.get(i)).collect::<Result<Vec<Arc<Field>>>>();
        // A field, the same clipped, and what is known of its blocks.
        let at_once = self.budget.at_once(count, 3 * self.field_bytes());
        if at_once == count {
            let job = DisplacementJob {
                fields: &load(0..count + 1)?,
                gaps,
                guess,
                begin: guess,
                rounds: 0..ROUNDS.len(),
                h: self.h,
            };
            return self.backend.displacements(&job);
        }
        let own = at_once.saturating_sub(2).max(1);
        let mut current = guess.to_vec();
        for round in 0..ROUNDS.len() {
            let mut better = Vec::with_capacity(count);
            for first in (0..count).step_by(own) {
                let end = (first + own).min(count);
                let around = first.saturating_sub(1)..(end + 1).min(count);
                let job = DisplacementJob {
                    fields: &load(around.start..around.end + 1)?,
                    gaps: &gaps[around.clone()],
                    guess: &guess[around.clone()],
                    begin: &current[around.clone()],
                    rounds: round..round + 1,
                    h: self.h,
                };
                let found = self.backend.displacements(&job)?;
                better.extend(found.into_iter().skip(first - around.start).take(end - first));
            }
            current = better;
        }
        Ok(current)
    }

    /// Slopes of the fields of all slices beside layers.
    pub(super) fn slopes(&mut self, moving: &MovingStack<'a>) -> Result<Shelf<'a, Field>> {
        let count = moving.fields.len();
        self.stage("slopes", count, |run| {
            let mut slopes = Shelf::new(run.budget);
            let at_once = run.budget.at_once(count, 2 * run.field_bytes());
            let own = if at_once == count { count } else { at_once.saturating_sub(2 * NEIGHBOURS).max(1) };
            let wanted = run.span.layers.start..run.span.layers.end + 1;
            (0..wanted.start).try_for_each(|_| slopes.push(Field::default()))?;
            for first in wanted.clone().step_by(own) {
                let end = (first + own).min(wanted.end);
                let around = first.saturating_sub(NEIGHBOURS)..(end + NEIGHBOURS).min(count);
                let found = run.backend.moving_slopes(&moving.part(around.clone())?, run.progress)?;
                found.into_iter().skip(first - around.start).take(end - first).try_for_each(|f| slopes.push(f))?;
            }
            Ok(slopes)
        })
    }

    /// Parts that meet nothing in the other slice along their trajectories, interval by interval.
    pub(super) fn lone_parts(
        &self,
        contours: &Shelf<'a, Contour>,
        moving: &MovingStack<'a>,
    ) -> Result<Shelf<'a, LoneParts>> {
        let mut out = Shelf::new(self.budget);
        (0..self.span.layers.start).try_for_each(|_| out.push(LoneParts::default()))?;
        for i in self.span.layers.clone() {
            let [low, high] = [Direction::Up, Direction::Down].map(|direction| {
                let (own, other, way) = match direction {
                    Direction::Up => (i, i + 1, 1.0),
                    Direction::Down => (i + 1, i, -1.0),
                };
                let (own, other) = (contours.get(own)?, moving.fields.get(other)?);
                let u = &moving.frame.at_slices[i][usize::from(direction == Direction::Down)];
                let parts = without_partner(&own, |x| {
                    let v = u.at(x);
                    other.sample([x[0] + way * v[0], x[1] + way * v[1]]) < 0.0
                });
                lone_solids(&own, &parts, self.h, self.margin, direction, self.backend)
            });
            out.push(LoneParts { low: low?, high: high? })?;
        }
        Ok(out)
    }
}

/// Numbers of the parts, at least [`LEAST_DEPTH`] deep, no pixel of which meets anything.
fn without_partner(contour: &Contour, meets: impl Fn([f64; 2]) -> bool) -> Vec<u32> {
    let mut lone: Vec<bool> = contour.solid_depth.iter().map(|d| *d >= LEAST_DEPTH).collect();
    lone[0] = false;
    let nx = contour.phi.dims[0];
    for (node, &label) in contour.solids.labels.iter().enumerate() {
        if lone[label as usize] && meets([(node % nx) as f64, (node / nx) as f64]) {
            lone[label as usize] = false;
        }
    }
    (0..).zip(lone).filter(|(_, lone)| *lone).map(|(part, _)| part).collect()
}
