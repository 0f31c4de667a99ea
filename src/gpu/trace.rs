//! Morphs with tracker particles on the GPU.

use rayon::prelude::*;

use super::Gpu;
use super::atlas::{Atlas, in_batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::device::failure;
use super::hj_step;
use super::kernels::shader;
use super::layout::{Job, NOWHERE, Params, Particle, RUNNING, Sums, Work};
use super::particles::Particles;
use super::recorder::{Recorder, Size};
use super::work;
use crate::backend::MorphOptions;
use crate::backend::jobs::{TraceJob, Traced};
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::stencil::step_share;
use crate::progress::Progress;
use crate::report::Residual;

shader! {
    trace = "common/job.wgsl" + "common/arrival.wgsl" + twin "src/reference/trace.rs";

    /// Speed near each front and its distance from the goal.
    Measure for measure, "trace_measure" {
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        goal: Read [f32],
        sums: Write [Sums],
    }

    /// The next time step of each job, or its end.
    Control for control, "trace_control" {
        params: Uniform Params,
        sums: Write [Sums],
        jobs_mut: Write [Job],
    }
}

/// Morphs of all jobs, batch by batch.
pub fn trace(
    gpu: &Gpu,
    jobs: &[TraceJob<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    progress: &dyn Progress,
) -> Result<Vec<Traced>> {
    let room_of = |job: &TraceJob<'_>| {
        let edges = crossings(&job.source).max(crossings(&job.goal));
        places(edges, options.half_width, job.source.data.len())
    };
    let rooms: Vec<usize> = jobs.par_iter().map(room_of).collect();
    let share = |(job, room): (&TraceJob<'_>, &usize)| {
        let (nodes, particles) = (padded(job.source.data.len()), job.seeds.len());
        let bytes = nodes * (NODE_BYTES + 4) + room * PLACE_BYTES + particles * size_of::<Particle>();
        let share = gpu.share(bytes, (4 * nodes).max(8 * room).max(particles * size_of::<Particle>()));
        share.max(gpu.share_of_work(work::BAND_PLACE * room))
    };
    in_batches(gpu, jobs.iter().zip(&rooms).map(share), |batch| {
        let room = rooms[batch.clone()].iter().sum::<usize>() + SPARE_PLACES;
        let batch = &jobs[batch];
        let nodes: usize = batch.iter().map(|j| j.source.data.len()).sum();
        let traced = with_room(room, nodes.max(room), |room| run(gpu, batch, h, options, room))?;
        progress.advance(batch.len());
        Ok(traced)
    })
}

fn run(
    gpu: &Gpu,
    morphs: &[TraceJob<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    room: usize,
) -> Result<Room<Vec<Traced>>> {
    let device = &gpu.device;
    let atlas = Atlas::new(morphs.iter().map(|m| m.source.dims));
    let [sources, goals]: [Vec<&Field>; 2] =
        [morphs.iter().map(|m| &*m.source).collect(), morphs.iter().map(|m| &*m.goal).collect()];
    let (phi, goal) = (gpu.send_tiles("phi", &atlas, &sources)?, &gpu.send_tiles("goal", &atlas, &goals)?);
    let front = Front::new(gpu, atlas, morph_params(h, options), Some(phi), room)?;
    let sums = &device.zeroed("sums", morphs.len())?;
    let starts = morphs.iter().map(|m| m.seeds.iter().map(|s| s.x));
    let particles = Particles::new(&front, starts, goal)?;
    let Front { params, jobs, band, work, phi, .. } = &front;
    let measure = Measure { jobs, band, work, phi, goal, sums }.bind(gpu);
    let control = Control { params, sums, jobs_mut: jobs }.bind(gpu);
    let stages = hj_step::stages(&front, goal, true);
    let each_job = Size::List(morphs.len());
    let mut recorder = Recorder::new(device, &gpu.profiler);
    front.begin(&mut recorder);
    let step = |recorder: &mut Recorder<'_>| {
        recorder.run(&measure, front.per_chunk());
        recorder.run(&control, each_job);
        recorder.run(&particles.predict, particles.each());
        front.step(recorder, &stages);
        front.rebuild(recorder);
        recorder.run(&particles.correct, particles.each());
    };
    let states = match front
        .run(recorder, None, expected_steps(morphs, h, options), step, |states| check_numbers("morph", states))?
    {
        Room::Enough((states, _)) => states,
        Room::Short(wanted) => return Ok(Room::Short(wanted)),
    };
    let mut tracks = particles.land(&front)?.into_iter();
    gpu.profiler.count(&["hj_step", "hj_step", "hj_step", "reinit"], states.iter().map(|s| s.pixels as usize).sum());
    let traced = |(morph, s): (&TraceJob<'_>, &Job)| Traced {
        tracks: tracks.by_ref().take(morph.seeds.len()).collect(),
        steps: s.steps as usize,
        pixels: s.pixels as usize,
        residual: Residual { mean: f64::from(s.residual_mean), max: f64::from(s.residual_max) },
    };
    Ok(Room::Enough(morphs.iter().zip(&states).map(traced).collect()))
}

/// Steps that the last of some morphs needs, about: its contour comes nearly as far a step as the Courant number says until it is near its goal.
fn expected_steps(morphs: &[TraceJob<'_>], h: [f64; 2], options: &MorphOptions) -> usize {
    let way = |morph: &TraceJob<'_>| morph.seeds.iter().map(|seed| morph.goal.sample(seed.x).abs()).fold(0.0, f64::max);
    let way = morphs.par_iter().map(way).reduce(|| 0.0, f64::max);
    ((DETOUR * way / (options.cfl * h[0].min(h[1]))) as usize).saturating_add(LAST_STEPS)
}

/// Steps of a morph for each that the straight way at full speed would take (pelvis 1.09, torso 1.22), and those near its goal.
const DETOUR: f64 = 1.25;
const LAST_STEPS: usize = 16;
/// Time that any step takes.
const INSTANT: f32 = 1e-12;

/// Fails where a job's time or what is left of its way is no number, or none that can be, and where its time stands still: comparisons on the
/// device do not see that, and the steps of such a job hardly end.
pub fn check_numbers(what: &str, states: &[Job]) -> Result<()> {
    let stands = |s: &Job| s.phase == RUNNING && s.steps > 0 && s.dt < INSTANT;
    let number = |s: &Job| [s.now, s.dt, s.residual_max, s.residual_mean].iter().all(|v| v.is_finite() && *v < NOWHERE);
    let sound = |s: &Job| number(s) && !stands(s);
    match states.iter().find(|s| !sound(s)) {
        None => Ok(()),
        Some(s) => Err(failure(format!(
            "a {what} is no number: after {} steps t = {}, dt = {}, residual {}",
            s.steps, s.now, s.dt, s.residual_max
        ))),
    }
}

/// Parameters of morphs and sweeps.
pub fn morph_params(h: [f64; 2], options: &MorphOptions) -> Params {
    Params {
        hx: h[0] as f32,
        hy: h[1] as f32,
        gamma: options.half_width as f32,
        beta: options.cut_off as f32,
        cfl: options.cfl as f32,
        step_share: step_share(options.cfl) as f32,
        tolerance: options.tolerance as f32,
        limit: options.limit as f32,
        ..Params::default()
    }
}
