//! The stages whose calls may wait for the device and be answered together: those whose jobs lie in an atlas.

use std::borrow::Cow;

use crate::backend::interval_morph::{IntervalMorph, Morphed};
use crate::backend::jobs::{PartJob, TraceJob, Traced};
use crate::backend::{ContourOptions, MorphOptions, PaddedSlice};
use crate::error::Result;
use crate::gpu::queue::{Calls, Waits};
use crate::grid::field::Field;

/// A pixel's sides.
type Sides = [f64; 2];

/// Calls that wait, stage by stage.
#[derive(Debug, Default)]
pub struct WaitingCalls {
    /// Level sets of slices.
    pub slices: Calls<(Sides, ContourOptions), SliceJob<'static>, Field>,
    /// Level sets of parts.
    pub parts: Calls<Sides, PartJob, Field>,
    /// Morphs.
    pub traces: Calls<(Sides, MorphOptions), TraceJob<'static>, Traced>,
    /// Morphs of whole intervals.
    pub morphs: Calls<(Sides, MorphOptions), IntervalMorph<'static>, Morphed>,
}

/// A slice on its padded image.
#[derive(Debug, Clone)]
pub struct SliceJob<'a> {
    /// The slice.
    pub slice: Cow<'a, PaddedSlice>,
    /// Pixels of the image.
    pub dims: [usize; 2],
}

impl Waits for SliceJob<'_> {
    type Owned = SliceJob<'static>;

    fn owned(&self) -> Result<SliceJob<'static>> {
        Ok(SliceJob { slice: Cow::Owned(self.slice.clone().into_owned()), dims: self.dims })
    }

    fn lent<'j>(jobs: &'j [SliceJob<'static>]) -> &'j [Self] {
        jobs
    }
}

impl Waits for PartJob {
    type Owned = PartJob;

    fn owned(&self) -> Result<PartJob> {
        Ok(self.clone())
    }

    fn lent(jobs: &[PartJob]) -> &[Self] {
        jobs
    }
}

impl Waits for TraceJob<'_> {
    type Owned = TraceJob<'static>;

    fn owned(&self) -> Result<TraceJob<'static>> {
        Ok(self.owned())
    }

    fn lent<'j>(jobs: &'j [TraceJob<'static>]) -> &'j [Self] {
        jobs
    }
}

impl Waits for IntervalMorph<'_> {
    type Owned = IntervalMorph<'static>;

    fn owned(&self) -> Result<IntervalMorph<'static>> {
        self.owned()
    }

    fn steps(&self) -> usize {
        2 * self.pairs.len()
    }

    fn lent<'j>(jobs: &'j [IntervalMorph<'static>]) -> &'j [Self] {
        jobs
    }
}
