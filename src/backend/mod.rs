//! Questions that the pipeline may ask of a machine. The order of the questions is the pipeline's; a backend answers batches of jobs.

pub mod blend;
pub mod conditioning;
pub mod fairing;
pub mod jobs;
pub mod options;
pub mod padded_slice;
pub mod requests;

pub use self::options::{ContourOptions, MorphOptions};
pub use self::padded_slice::PaddedSlice;

use self::fairing::{FairingFrame, FairingState};
use self::jobs::{Filled, Traced};
use self::requests::{ContourRequest, LayerRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest};
use crate::error::Result;
use crate::grid::field::Field;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::storage::spill::Budget;

/// Means that a run may use.
#[derive(Clone, Copy)]
pub struct Means<'a> {
    /// Backend that computes.
    pub backend: &'a dyn Backend,
    /// Listener that is told how far the work has come.
    pub progress: &'a dyn Progress,
    /// Bound on what may be in memory.
    pub budget: &'a Budget,
}

/// A machine that runs the numeric stages. `h` is the pixel's size in units of its larger side; fields and results are in that unit.
/// Results come in the order of the jobs and do not depend on how a backend groups or parallelises them.
pub trait Backend: Sync {
    /// Name for people and reports.
    fn name(&self) -> String;

    /// Bytes of the host's memory that it takes beside what a run takes on the reference path.
    fn host_bytes(&self) -> u64 {
        0
    }

    /// Level sets of slices: anti-aliasing, distance, conditioning.
    ///
    /// # Errors
    /// A backend's own failures.
    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>>;

    /// Level sets of parts of contours.
    ///
    /// # Errors
    /// A backend's own failures.
    fn part_fields(&self, request: &PartRequest<'_>) -> Result<Vec<Field>>;

    /// Morphs with tracker particles.
    ///
    /// # Errors
    /// A backend's own failures.
    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>>;

    /// Sweeps through intervals in both directions, blended, mended, and continued outwards as distances.
    ///
    /// # Errors
    /// A backend's own failures.
    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>>;

    /// Displacements of neighbouring intervals after some rounds of the iteration.
    ///
    /// # Errors
    /// A backend's own failures.
    fn displacements(&self, request: &DisplacementJob<'_>) -> Result<Vec<Displacement>>;

    /// Slopes of the slices' fields along their trajectories, per height.
    ///
    /// # Errors
    /// A backend's own failures.
    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>>;

    /// Layers of an interval, each a row-major image, one per time.
    ///
    /// # Errors
    /// A backend's own failures.
    fn moving_layers(&self, request: &LayerRequest<'_>) -> Result<Vec<Vec<f32>>>;

    /// A fairing that has no nodes yet.
    ///
    /// # Errors
    /// A backend's own failures.
    fn fairing<'a>(&'a self, frame: FairingFrame<'a>) -> Result<Box<dyn FairingState + 'a>>;
}
