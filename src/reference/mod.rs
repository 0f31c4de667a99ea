//! The f64 reference path: plain loops, one kernel a file, parallel over jobs. Every other backend is compared with it.

pub mod band;
pub mod contour_field;
pub mod displacement;
pub mod distance;
pub mod exact;
pub mod extend;
pub mod hj_step;
pub mod morph_layer;
pub mod moving_layer;
pub mod moving_slopes;
pub mod part;
pub mod particles;
pub mod propagate;
pub mod reinit;
pub mod scatter;
pub mod trace;

use rayon::prelude::*;

use crate::backend::blend::{blend, mend};
use crate::backend::interval_morph::Morphed;
use crate::backend::jobs::{Filled, SweepJob, SweepPair, Swept, Traced, blend_weights};
use crate::backend::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use crate::backend::{Backend, MorphOptions, PaddedSlice};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::registration::displacement::{Displacement, DisplacementJob};

/// The reference path. Jobs run in parallel on rayon's current pool, each by itself: the same bits for any number of threads.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reference;

/// Runs one job per item, results in order, telling how many are done, until the listener ends the run.
fn in_parallel<J: Sync, R: Send>(jobs: &[J], progress: &dyn Progress, run: impl Fn(&J) -> R + Sync) -> Result<Vec<R>> {
    jobs.par_iter()
        .with_max_len(1)
        .map(|job| {
            if progress.stops() {
                return Err(Error::Interrupted);
            }
            let result = run(job);
            progress.advance(1);
            Ok(result)
        })
        .collect()
}

/// Course of a sweep, and its level sets at the times asked for.
type SweptWithFields = (Swept, Vec<SparseImage<f32>>);

impl Backend for Reference {
    fn name(&self) -> String {
        format!("reference (f64, {} threads)", rayon::current_num_threads())
    }

    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        let &ContourRequest { slices, dims, h, options } = request;
        in_parallel(slices, progress, |slice| match slice {
            PaddedSlice::Mask(mask) => contour_field::field_of_mask(mask, dims, h, options),
            PaddedSlice::Level(u) => contour_field::field_of_level(u, h, options),
        })
    }

    fn part_fields(&self, &PartRequest { jobs, h }: &PartRequest<'_>) -> Result<Vec<Field>> {
        Ok(jobs.par_iter().map(|job| part::part_field(job, h)).collect())
    }

    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>> {
        in_parallel(request.jobs, progress, |job| trace::trace(job, request.h, &request.options))
    }

    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>> {
        let pairs: Vec<&SweepPair<'_>> = request.pairs.iter().collect();
        filled(&pairs, request.h, &request.options, progress)
    }

    fn morph_layers(&self, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
        let pairs: Vec<&SweepPair<'_>> =
            request.intervals.iter().flat_map(|of| of.pairs.iter().map(|(_, pair)| pair)).collect();
        let filled = filled(&pairs, request.h, &request.options, progress)?;
        morph_layer::layers(request, filled, &|requests| self.moving_layers(requests))
    }

    fn displacements(&self, request: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
        Ok(displacement::displacements(request))
    }

    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        let slopes = moving_slopes::slopes(request.moving, request.wanted.clone());
        progress.advance(slopes.len());
        Ok(slopes)
    }

    fn moving_layers(&self, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> {
        let layers =
            |of: &LayerRequest<'_>| (0..of.times.len()).into_par_iter().map(|k| moving_layer::layer(of, k)).collect();
        Ok(requests.par_iter().map(layers).collect())
    }
}

/// Both sweeps of these pairs, and their slices.
fn filled(
    pairs: &[&SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    progress: &dyn Progress,
) -> Result<Vec<Filled>> {
    let jobs: Vec<&SweepJob<'_>> = pairs.iter().flat_map(|p| [&p.up, &p.down]).collect();
    let swept = in_parallel(&jobs, progress, |job| propagate::propagate(job, h, options))?;
    let fill = |(pair, swept): (&&SweepPair<'_>, &[SweptWithFields])| {
        let [(up, up_fields), (down, down_fields)] = swept else { return Filled::default() };
        let last = pair.up.times.len().saturating_sub(1);
        let slice = |(k, &t): (usize, &f64)| {
            let weights = blend_weights(options.sweep, t, up, down);
            let mut phi = blend(&up_fields[k], &down_fields[last - k], weights);
            mend(pair, k, &mut phi);
            let far = distance::far_distance(phi, h, options.limit);
            SparseImage::single(&far)
        };
        let slices = pair.up.times.par_iter().enumerate().map(slice).collect();
        Filled { slices, up: up.clone(), down: down.clone() }
    };
    Ok(pairs.par_iter().zip(swept.par_chunks_exact(2)).map(fill).collect())
}
