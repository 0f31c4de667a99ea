//! The f64 reference path: plain loops, one kernel a file, parallel over jobs. Every other backend is compared with it.

pub mod band;
pub mod contour_field;
pub mod displacement;
pub mod distance;
pub mod exact;
pub mod extend;
pub mod hj_step;
pub mod moving_field;
pub mod part;
pub mod particles;
pub mod propagate;
pub mod reinit;
pub mod scatter;
pub mod trace;

use std::ops::Range;

use rayon::prelude::*;

use crate::backend::blend::{blend, mend};
use crate::backend::jobs::{Filled, PartJob, SweepJob, SweepPair, Swept, TraceJob, Traced, blend_weights};
use crate::backend::{Backend, ContourOptions, MorphOptions, PaddedSlice};
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::tiled::Packed;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::registration::motion_field::{Cells, LoneParts, MotionField};

/// The reference path. Jobs run in parallel on rayon's current pool, each by itself: the same bits for any number of threads.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reference;

/// Runs one job per item, results in order, telling how many are done.
fn in_parallel<J: Sync, R: Send>(jobs: &[J], progress: &dyn Progress, run: impl Fn(&J) -> R + Sync) -> Vec<R> {
    jobs.par_iter()
        .with_max_len(1)
        .map(|job| {
            let result = run(job);
            progress.advance(1);
            result
        })
        .collect()
}

/// How a sweep went, and its level sets at the times asked for.
type SweptWithFields = (Swept, Vec<Packed<f32>>);

impl Backend for Reference {
    fn name(&self) -> String {
        format!("reference (f64, {} threads)", rayon::current_num_threads())
    }

    fn contour_fields(
        &self,
        slices: &[PaddedSlice],
        dims: [usize; 2],
        h: [f64; 2],
        options: ContourOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Field>> {
        Ok(in_parallel(slices, progress, |slice| match slice {
            PaddedSlice::Mask(mask) => contour_field::field_of_mask(mask, dims, h, options),
            PaddedSlice::Level(u) => contour_field::field_of_level(u, h, options),
        }))
    }

    fn part_fields(&self, jobs: &[PartJob], h: [f64; 2]) -> Result<Vec<Field>> {
        Ok(jobs.par_iter().map(|job| part::part_field(job, h)).collect())
    }

    fn trace(
        &self,
        jobs: &[TraceJob<'_>],
        h: [f64; 2],
        options: &MorphOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Traced>> {
        Ok(in_parallel(jobs, progress, |job| trace::trace(job, h, options)))
    }

    fn propagate(
        &self,
        pairs: &[SweepPair<'_>],
        h: [f64; 2],
        options: &MorphOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<Filled>> {
        let jobs: Vec<&SweepJob<'_>> = pairs.iter().flat_map(|p| [&p.up, &p.down]).collect();
        let swept = in_parallel(&jobs, progress, |job| propagate::propagate(job, h, options));
        let fill = |(pair, swept): (&SweepPair<'_>, &[SweptWithFields])| {
            let [(up, up_fields), (down, down_fields)] = swept else { return Filled::default() };
            let last = pair.up.times.len().saturating_sub(1);
            let slice = |(k, &t): (usize, &f64)| {
                let weights = blend_weights(options.sweep, t, up, down);
                let mut phi = blend(&up_fields[k], &down_fields[last - k], weights);
                mend(pair, k, &mut phi);
                let far = distance::far_distance(phi, h, options.limit);
                Packed::single(&far)
            };
            let slices = pair.up.times.par_iter().enumerate().map(slice).collect();
            Filled { slices, up: up.clone(), down: down.clone() }
        };
        Ok(pairs.par_iter().zip(swept.par_chunks_exact(2)).map(fill).collect())
    }

    fn displacements(&self, job: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
        Ok(displacement::displacements(job))
    }

    fn moving_slopes(&self, moving: &MotionField, wanted: Range<usize>, progress: &dyn Progress) -> Result<Vec<Field>> {
        let slopes = moving_field::slopes(moving, wanted);
        progress.advance(slopes.len());
        Ok(slopes)
    }

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
    ) -> Result<Vec<Vec<f32>>> {
        let layer = |(k, &t): (usize, &f64)| {
            moving_field::layer(moving, slopes, lone, i, t, limit, h, wanted.map(|cells| &cells[k]))
        };
        Ok(times.par_iter().enumerate().map(layer).collect())
    }
}
