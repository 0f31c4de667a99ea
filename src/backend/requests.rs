//! Questions that the pipeline asks of a backend, one struct a stage. An answer is a list of what there is per job, in the order of the jobs.
//!
//! `h` is the pixel's size in units of its larger side; fields, lengths and results are in that unit.

use std::ops::Range;
use std::sync::Arc;

use super::interval_morph::IntervalMorph;
use super::jobs::{PartJob, SweepPair, TraceJob};
use super::options::{ContourOptions, MorphOptions};
use super::padded_slice::PaddedSlice;
use crate::grid::field::Field;
use crate::registration::cells::Cells;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;

/// Request for the level sets of slices: anti-aliasing, distance, conditioning.
#[derive(Debug, Clone, Copy)]
pub struct ContourRequest<'a> {
    /// Slices on the padded image.
    pub slices: &'a [PaddedSlice],
    /// Pixels of the padded image.
    pub dims: [usize; 2],
    /// Pixel sides.
    pub h: [f64; 2],
    /// Options by which slices become level sets.
    pub options: ContourOptions,
}

/// Request for the level sets of parts of contours.
#[derive(Debug, Clone, Copy)]
pub struct PartRequest<'a> {
    /// Parts, each on its tile.
    pub jobs: &'a [PartJob],
    /// Pixel sides.
    pub h: [f64; 2],
}

/// Request for morphs with tracker particles.
#[derive(Debug, Clone, Copy)]
pub struct TraceRequest<'a> {
    /// Morphs, each on its tile.
    pub jobs: &'a [TraceJob<'a>],
    /// Pixel sides.
    pub h: [f64; 2],
    /// Parameters of all of them.
    pub options: MorphOptions,
}

/// Request for sweeps through intervals in both directions, blended, mended, and continued outwards as distances.
#[derive(Debug, Clone, Copy)]
pub struct SweepRequest<'a> {
    /// Pairs of sweeps, each on its tile.
    pub pairs: &'a [SweepPair<'a>],
    /// Pixel sides.
    pub h: [f64; 2],
    /// Parameters of all of them.
    pub options: MorphOptions,
}

/// Request for the layers of whole intervals.
#[derive(Debug, Clone, Copy)]
pub struct MorphRequest<'a> {
    /// Intervals to be morphed.
    pub intervals: &'a [IntervalMorph<'a>],
    /// Pixel sides.
    pub h: [f64; 2],
    /// Parameters of all sweeps.
    pub options: MorphOptions,
    /// Number of layers that the host composes together.
    pub at_once: usize,
}

/// Request for the slopes of slices' fields along their trajectories, per height.
#[derive(Debug, Clone)]
pub struct SlopeRequest<'a> {
    /// Fields in their moving frame.
    pub moving: &'a MotionField,
    /// Slices that are wanted.
    pub wanted: Range<usize>,
}

/// Request for layers of an interval on the whole padded image.
#[derive(Debug, Clone, Copy)]
pub struct LayerRequest<'a> {
    /// Fields in their moving frame.
    pub moving: &'a MotionField,
    /// Number of the interval.
    pub interval: usize,
    /// Slopes of the interval's slices.
    pub slopes: [&'a Arc<Field>; 2],
    /// Parts that meet nothing in the other slice.
    pub lone: &'a LoneParts,
    /// Times in the interval, 0 to 1.
    pub times: &'a [f64],
    /// Distance to which layers are clamped, px.
    pub limit: f64,
    /// Pixel sides.
    pub h: [f64; 2],
    /// Cells that count, for each time; others have one value, what their probes say (`cells::probed`). All, where there are none.
    pub wanted: Option<&'a [Cells]>,
}
