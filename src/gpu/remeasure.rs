//! The paper's re-estimation on the GPU: every few steps of its sweeps a new morph measures what remains of each front's way.
//!
//! Seeds are found on the host, so that these sweeps stop for it; the morphs of all sweeps run together. In between what remains is carried with the
//! band as courses are: `[remaining distance, how far it is valid, 0, 0]`.

use std::borrow::Cow;
use std::cell::Cell;

use super::answers::Wanted;
use super::band::{Front, Room};
use super::buffer::Buffer;
use super::extend::Courses;
use super::layout::{Job, RUNNING, Values};
use super::recorder::Recorder;
use super::scatter::{Seeds, Valued, place_seeds};
use super::trace::trace;
use crate::backend::MorphOptions;
use crate::backend::jobs::{SweepJob, TraceJob};
use crate::contour::seeds::seeds;
use crate::error::Result;
use crate::grid::field::Field;
use crate::progress::Silent;
use crate::reference::propagate::FIRST_PASSES;

/// What the morphs are made of.
pub struct Sweeps<'s> {
    /// Sweeps of the front.
    pub jobs: &'s [&'s SweepJob<'s>],
    /// Pixel sides.
    pub h: [f64; 2],
    /// Options of morphs and sweeps.
    pub options: &'s MorphOptions,
    /// What is measured, by band place.
    pub remeasured: &'s Courses<'s>,
    /// Which of its copies holds it.
    pub holds: &'s Cell<usize>,
}

/// Takes steps until no job runs, with a new morph before some of them, as [`Front::run`] does without; `step` is told whether there has been one.
///
/// # Errors
/// The errors of `ends`, and of the device.
pub fn run<'g>(
    front: &Front<'g>,
    mut recorder: Recorder<'g>,
    pool: &Buffer<Values>,
    sweeps: &Sweeps<'_>,
    step: impl Fn(&mut Recorder<'g>, bool),
    ends: impl Fn(&[Job]) -> Result<()>,
) -> Result<Room<(Vec<Job>, u32)>> {
    let mut measured = false;
    loop {
        for _ in 0..sweeps.options.redistance {
            step(&mut recorder, measured);
        }
        let jobs: Wanted<Job> = recorder.read(&front.jobs, 0, front.atlas.jobs.len());
        let lists = front.look(&mut recorder);
        let number = recorder.read::<u32>(pool, 0, 1);
        let phi: Wanted<f32> = recorder.read(&front.phi, 0, front.atlas.node_count());
        let landed = recorder.submit()?.wait()?;
        recorder = Recorder::new(&front.gpu.device, &front.gpu.profiler);
        if let Some(wanted) = front.overflow(&landed, &lists)? {
            return Ok(Room::Short(wanted));
        }
        let states = landed.values(&jobs)?;
        ends(&states)?;
        if states.iter().all(|s| s.phase != RUNNING) {
            return Ok(Room::Enough((states, landed.value(&number)?)));
        }
        let phi = landed.values(&phi)?;
        drop(landed);
        remeasure(front, &mut recorder, sweeps, &states, &phi)?;
        measured = true;
    }
}

/// A new morph from every front that is still on its way, as the paper does: what remains at its particles, brought to the pixels.
fn remeasure<'g>(
    front: &Front<'g>,
    recorder: &mut Recorder<'g>,
    &Sweeps { jobs, h, options, remeasured, holds }: &Sweeps<'_>,
    states: &[Job],
    phi: &[f32],
) -> Result<()> {
    let mut owners = Vec::new();
    let mut morphs: Vec<TraceJob<'_>> = Vec::new();
    for (q, (job, state)) in jobs.iter().zip(states).enumerate() {
        if state.phase != RUNNING || state.reaches == 1 {
            continue;
        }
        let own = &phi[state.offset as usize..][..job.source.data.len()];
        let source = Field { dims: job.source.dims, data: own.iter().copied().map(f64::from).collect() };
        // A front that is gone has none.
        let seeds = seeds(&source, h, options.seed_spacing);
        if !seeds.is_empty() {
            owners.push(q);
            morphs.push(TraceJob { source: Cow::Owned(source), goal: Cow::Borrowed(&job.goal), seeds });
        }
    }
    if morphs.is_empty() {
        return Ok(());
    }
    let traced = trace(front.gpu, &morphs, h, options, &Silent)?;
    let none = |job: &&SweepJob<'_>| Valued { dims: job.source.dims, seeds: (&[]).into(), values: (&[]).into() };
    let mut valued: Vec<Valued<'_>> = jobs.iter().map(none).collect();
    for ((q, morph), traced) in owners.into_iter().zip(&morphs).zip(traced) {
        valued[q].seeds = morph.seeds.iter().map(|seed| seed.x).collect();
        valued[q].values = traced.tracks.iter().map(|track| [track.distance, track.kept, 0.0, 0.0]).collect();
    }
    let placed = place_seeds(&mut front.atlas.jobs.clone(), valued.into_iter(), h);
    let holds = holds.get();
    Seeds::new(front, placed, &remeasured.copies[holds])?.scatter(recorder, front);
    remeasured.extend(recorder, front, holds, FIRST_PASSES);
    Ok(())
}
