//! What the pipeline may ask of a machine. The order of the questions is the pipeline's; a backend answers batches of jobs.

pub mod blend;
pub mod conditioning;
pub mod jobs;

use std::ops::Range;

use crate::backend::jobs::{Filled, PartJob, SweepPair, TraceJob, Traced};
use crate::error::Result;
use crate::grid::field::Field;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::registration::motion_field::{Cells, LoneParts, MotionField};
use crate::settings::{AntiAlias, Settings, Sweep};
use crate::stack::SliceContent;
use crate::storage::spill::Budget;

/// What a run may use.
#[derive(Clone, Copy)]
pub struct Means<'a> {
    /// Who computes.
    pub backend: &'a dyn Backend,
    /// Who is told.
    pub progress: &'a dyn Progress,
    /// How much may be in memory.
    pub budget: &'a Budget,
}

/// A slice on the padded image.
#[derive(Debug, Clone)]
pub enum PaddedSlice {
    /// Inside or not.
    Mask(Vec<bool>),
    /// Implicit function, negative inside.
    Level(Field),
}

impl PaddedSlice {
    /// The slice of `nx` x `ny` pixels with `pad` pixels of outside to either side along each axis.
    pub fn new(content: &SliceContent, [nx, ny]: [usize; 2], pad: [usize; 2]) -> Self {
        let dims = [nx + 2 * pad[0], ny + 2 * pad[1]];
        match content {
            SliceContent::Mask(mask) => {
                let mut out = vec![false; dims[0] * dims[1]];
                for j in 0..ny {
                    let to = (j + pad[1]) * dims[0] + pad[0];
                    mask.read(j * nx, &mut out[to..to + nx]);
                }
                PaddedSlice::Mask(out)
            }
            SliceContent::Level(u) => {
                // Outside as far from the level as the slice's own values are, so that a contour at the border lies near it.
                let far = f64::from(u.largest());
                let mut out = Field::filled(dims, far);
                let mut inside = vec![false; nx];
                for j in 0..ny {
                    u.sides().read(j * nx, &mut inside);
                    let row = &mut out.data[(j + pad[1]) * dims[0] + pad[0]..][..nx];
                    row.iter_mut().zip(&inside).filter(|(_, inside)| **inside).for_each(|(v, _)| *v = -far);
                }
                for (n, v) in u.near() {
                    let v = if *v == 0.0 { f32::MIN_POSITIVE } else { *v };
                    out.data[(n / nx + pad[1]) * dims[0] + n % nx + pad[0]] = f64::from(v);
                }
                PaddedSlice::Level(out)
            }
        }
    }
}

/// How slices become level sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourOptions {
    /// Rule for masks.
    pub anti_alias: AntiAlias,
    /// Kernel width, samples.
    pub sigma: f64,
    /// Half width of the tubes, px.
    pub half_width: f64,
}

/// Parameters of morphs and sweeps; see [`Settings`] for units and ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphOptions {
    /// Half width of the tube (gamma).
    pub half_width: f64,
    /// Start of the cut-off (beta).
    pub cut_off: f64,
    /// Courant number.
    pub cfl: f64,
    /// Arrival tolerance.
    pub tolerance: f64,
    /// Distance between particles.
    pub seed_spacing: f64,
    /// Which sweeps make layers.
    pub sweep: Sweep,
    /// Steps between re-estimations, 0: never.
    pub redistance: usize,
    /// Distance to which slices are right, px.
    pub limit: f64,
}

impl From<&Settings> for ContourOptions {
    fn from(s: &Settings) -> Self {
        ContourOptions { anti_alias: s.anti_alias, sigma: s.sigma, half_width: s.half_width }
    }
}

impl From<&Settings> for MorphOptions {
    fn from(s: &Settings) -> Self {
        MorphOptions {
            half_width: s.half_width,
            cut_off: s.cut_off,
            cfl: s.cfl,
            tolerance: s.tolerance,
            seed_spacing: s.seed_spacing,
            sweep: s.sweep,
            redistance: s.redistance,
            limit: s.margin() as f64,
        }
    }
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
    fn contour_fields(
        &self,
        slices: &[PaddedSlice],
        dims: [usize; 2],
        h: [f64; 2],
        options: ContourOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Field>>;

    /// Level sets of parts of contours.
    ///
    /// # Errors
    /// A backend's own failures.
    fn part_fields(&self, jobs: &[PartJob], h: [f64; 2]) -> Result<Vec<Field>>;

    /// Morphs with tracker particles.
    ///
    /// # Errors
    /// A backend's own failures.
    fn trace(
        &self,
        jobs: &[TraceJob<'_>],
        h: [f64; 2],
        options: &MorphOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Traced>>;

    /// Sweeps through intervals in both directions, blended, mended, and continued outwards as distances.
    ///
    /// # Errors
    /// A backend's own failures.
    fn propagate(
        &self,
        pairs: &[SweepPair<'_>],
        h: [f64; 2],
        options: &MorphOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Filled>>;

    /// Displacements of neighbouring intervals after some rounds of the iteration.
    ///
    /// # Errors
    /// A backend's own failures.
    fn displacements(&self, job: &DisplacementJob<'_>) -> Result<Vec<Displacement>>;

    /// Slopes of the fields of the `wanted` slices along their trajectories, per height.
    ///
    /// # Errors
    /// A backend's own failures.
    fn moving_slopes(&self, moving: &MotionField, wanted: Range<usize>, progress: &dyn Progress) -> Result<Vec<Field>>;

    /// Layers of interval `i`, whose slices have these slopes, at these times on the whole padded image, clamped to `limit` px. Where `wanted` names cells for each time,
    /// of others only the corners and the middle count.
    ///
    /// # Errors
    /// A backend's own failures.
    #[expect(clippy::too_many_arguments, reason = "one stage reads what all stages before it have made")]
    fn moving_layers(
        &self,
        moving: &MotionField,
        slopes: [&Field; 2],
        lone: &LoneParts,
        i: usize,
        times: &[f64],
        limit: f64,
        h: [f64; 2],
        wanted: Option<&[Cells]>,
    ) -> Result<Vec<Vec<f32>>>;
}
