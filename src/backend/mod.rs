//! Questions that the pipeline may ask of a machine. The order of the questions is the pipeline's; a backend answers batches of jobs.

pub mod answers;
pub mod blend;
pub mod conditioning;
pub mod interval_morph;
pub mod jobs;
pub mod options;
pub mod padded_slice;
pub mod replay;
pub mod requests;

pub use self::options::{ContourOptions, MorphOptions};
pub use self::padded_slice::PaddedSlice;

use self::interval_morph::Morphed;
use self::jobs::{Filled, Traced};
use self::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::report::DeviceUse;
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

/// A run on a backend, until it is dropped.
pub(crate) struct Lasting<'b>(&'b dyn Backend);

impl<'b> Lasting<'b> {
    /// Tells the backend that the run begins.
    pub fn on(backend: &'b dyn Backend) -> Self {
        backend.run_begins();
        Lasting(backend)
    }
}

impl Drop for Lasting<'_> {
    fn drop(&mut self) {
        self.0.run_ends();
    }
}

/// A machine that runs the numeric stages: `Reference` or `Gpu`. `h` is the pixel's size in units of its larger side; fields and results are in that
/// unit. Results come in the order of the jobs and do not depend on how a backend groups or parallelises them.
///
/// The questions of the stages are the program's own and are not documented: they may change in any version, so other implementations of this trait
/// may stop compiling.
pub trait Backend: Sync {
    /// Name for people and reports.
    fn name(&self) -> String;

    /// Bytes of the host's memory that it takes beside what a run takes on the reference path.
    fn host_bytes(&self) -> u64 {
        0
    }

    /// Use of its device so far, by whoever shares it; nothing where there is none.
    fn device_use(&self) -> Option<DeviceUse> {
        None
    }

    /// Begin of a run, for which a backend may keep what it has made or been sent until [`Backend::run_ends`].
    #[doc(hidden)]
    fn run_begins(&self) {}

    /// End of a run.
    #[doc(hidden)]
    fn run_ends(&self) {}

    /// Level sets of slices: anti-aliasing, distance, conditioning.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>>;

    /// Level sets of parts of contours.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn part_fields(&self, request: &PartRequest<'_>) -> Result<Vec<Field>>;

    /// Morphs with tracker particles.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>>;

    /// Sweeps through intervals in both directions, blended, mended, and continued outwards as distances.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>>;

    /// Sweeps through whole intervals, and the layers composed of them.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn morph_layers(&self, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>>;

    /// Displacements of neighbouring intervals after some rounds of the iteration.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn displacements(&self, request: &DisplacementJob<'_>) -> Result<Vec<Displacement>>;

    /// Slopes of the slices' fields along their trajectories, per height.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>>;

    /// Layers of intervals of a stack: for each interval one per time, each a row-major image.
    ///
    /// # Errors
    /// A backend's own failures.
    #[doc(hidden)]
    fn moving_layers(&self, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>>;
}
