//! Inputs of the sweeps, which the stages before have made.

use std::sync::Arc;

use crate::contour::Contour;
use crate::error::Result;
use crate::grid::field::Field;
use crate::pipeline::ends::end_caps::End;
use crate::pipeline::fit::Fitted;
use crate::pipeline::matching::Interval;
use crate::pipeline::tracks::Sides;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_stack::MotionStack;
use crate::storage::spill::SpillVec;

/// Pairs of parts by their numbers.
pub type Pairs = Vec<(u32, u32)>;
/// The two contours of an interval in its frame.
pub type Seen = [Arc<Contour>; 2];

/// The moving frame, and what the field method needs where the morph knows nothing.
pub struct FieldFallback<'c, 'b> {
    pub moving: &'c MotionStack<'b>,
    pub slopes: SpillVec<'b, Field>,
    pub lone: SpillVec<'b, LoneParts>,
}

/// The contours of all intervals in their frames.
pub struct SeenStack<'c, 'b> {
    pub contours: &'c SpillVec<'b, Contour>,
    /// Lower and upper contour of each interval; `None` where contours stay in the image's own frame.
    pub moved: Option<SpillVec<'b, Contour>>,
}

impl SeenStack<'_, '_> {
    pub fn get(&self, i: usize) -> Result<Seen> {
        match &self.moved {
            Some(moved) => Ok([moved.get(2 * i)?, moved.get(2 * i + 1)?]),
            None => Ok([self.contours.get(i)?, self.contours.get(i + 1)?]),
        }
    }

    /// The contours of interval `i` with some of their arrays.
    pub fn some(&self, i: usize, wanted: &[usize]) -> Result<Seen> {
        let of = |end: usize| match &self.moved {
            Some(moved) => moved.some(2 * i + end, wanted),
            None => self.contours.some(i + end, wanted),
        };
        Ok([of(0)?, of(1)?])
    }
}

/// Inputs of the sweeps.
pub struct SweepInputs<'c, 'b> {
    pub contours: &'c SpillVec<'b, Contour>,
    pub beside: Option<FieldFallback<'c, 'b>>,
    pub seen: SeenStack<'c, 'b>,
    /// Pairs that are kept apart, as the mid frame numbers them.
    pub parted: Vec<Pairs>,
    pub intervals: SpillVec<'b, Interval>,
    pub sides: SpillVec<'b, Sides>,
    pub fitted: SpillVec<'b, Fitted>,
    pub ends: [End; 2],
}
