//! Sweeps on the GPU, and the slices made of them.

use std::cell::Cell;

use rayon::prelude::*;

use super::Gpu;
use super::atlas::{Atlas, in_batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::compose::{Copies, fill_slices};
use super::device::failure;
use super::extend::{Courses, ExtendLine, Upwind};
use super::hj_step;
use super::kernels::{Bound, shader};
use super::layout::{BLOCK, Copy, Job, Params, RUNNING, Reached, Sums, VANISHED, Work};
use super::recorder::{Listed, Recorder, Size};

use super::remeasure::{self, Sweeps};
use super::scatter::{Seeds, Valued, place_seeds};
use super::trace::{check_numbers, morph_params};
use super::work;
use crate::backend::MorphOptions;
use crate::backend::jobs::{Filled, SweepJob, SweepPair, Swept};
use crate::error::Result;
use crate::grid::field::Field;
use crate::progress::Progress;
use crate::reference::propagate::{FIRST_PASSES, PASSES};
use crate::report::Residual;

shader! {
    propagate = "common/job.wgsl" + "common/stencil.wgsl" + "common/field.wgsl" + "common/goal.wgsl"
        + "common/arrival.wgsl" + "common/course.wgsl" + twin "src/reference/propagate.rs";

    /// Takes over the time that the last step has reached.
    Advance for advance, "sweep_advance" {
        params: Uniform Params,
        jobs_mut: Write [Job],
        reached: Write Reached,
    }

    /// Errors at the contour's pixels, the largest speed, and what is left of each front.
    Measure for measure, "sweep_measure" {
        params: Uniform Params,
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        goal: Read [f32],
        sums: Write [Sums],
        courses: Read [[f32; 4]],
        errors: Write [f32],
    }

    /// The next time step of each job, or its end.
    Control for control, "sweep_control" {
        params: Uniform Params,
        sums: Write [Sums],
        jobs_mut: Write [Job],
        times: Read [f32],
        reached: Write Reached,
    }

    /// Speed over this step.
    Steer for steer, "sweep_steer" {
        params: Uniform Params,
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        courses: Read [[f32; 4]],
        errors: Write [f32],
        line: Write [f32],
        before: Write [[f32; 4]],
    }

    /// Errors by what a new morph has measured.
    Recall for recall, "sweep_recall" {
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        courses: Read [[f32; 4]],
        errors: Write [f32],
        remeasured: Write [[f32; 4]],
    }

    /// The largest speed with those errors, and what is left of each front.
    MeasureAgain for measure_again, "sweep_measure_again" {
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        goal: Read [f32],
        sums: Write [Sums],
        courses: Read [[f32; 4]],
        errors: Write [f32],
    }

    /// Speed over this step, with those errors.
    SteerAgain for steer_again, "sweep_steer_again" {
        params: Uniform Params,
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        phi: Read [f32],
        courses: Read [[f32; 4]],
        errors: Write [f32],
        line: Write [f32],
        before: Write [[f32; 4]],
    }

    /// What remains after this step.
    Spend for spend, "sweep_spend" {
        jobs: Read [Job],
        band: Read [[u32; 2]],
        work: Read Work,
        line: Write [f32],
        remeasured: Write [[f32; 4]],
    }
}

/// Steps after which a sweep is given up; real ones take less than a hundred per pixel of motion.
const MOST_STEPS: u32 = 100_000;
/// Bytes per band place beside the front's own: courses and speeds twice, misses, sources, rounds of filling, the start of a step.
const SWEEP_PLACE_BYTES: usize = PLACE_BYTES + 80;

/// Share of the device that a sweep takes with its morphs, for one without.
const WITH_MORPHS: f64 = 3.0;

/// Size of a pair of sweeps.
#[derive(Debug, Clone, Copy)]
pub struct PairSize {
    /// Edges between pixels that the longer one of its contours crosses.
    pub edges: usize,
    /// Room that their bands take.
    pub room: usize,
    /// Share of the device.
    pub share: f64,
}

/// The size of a pair of sweeps.
pub fn size(gpu: &Gpu, pair: &SweepPair<'_>, options: &MorphOptions) -> PairSize {
    let edges = crossings(&pair.up.source).max(crossings(&pair.up.goal));
    let room = 2 * places(edges, options.half_width, pair.up.source.data.len());
    let nodes = 2 * padded(pair.up.source.data.len());
    let copied = [room * 4, nodes / BLOCK * size_of::<Copy>()].map(|bytes| bytes * pair.up.times.len());
    let bytes = nodes * (NODE_BYTES + 4) + room * SWEEP_PLACE_BYTES + copied[0] + copied[1];
    let share = gpu.share(bytes, (4 * nodes).max(16 * room).max(copied[0]).max(copied[1]));
    // The morphs in between have sources and goals of their own.
    let share = if options.redistance > 0 { WITH_MORPHS * share } else { share };
    PairSize { edges, room, share: share.max(gpu.share_of_work(work::BAND_PLACE * room)) }
}

/// All pairs of sweeps, batch by batch, and their slices.
pub fn propagate(
    gpu: &Gpu,
    pairs: &[&SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    progress: &dyn Progress,
) -> Result<Vec<Filled>> {
    let sizes: Vec<PairSize> = pairs.par_iter().map(|pair| size(gpu, pair, options)).collect();
    in_batches(gpu, sizes.iter().map(|size| size.share), |batch| {
        let room = sizes[batch.clone()].iter().map(|size| size.room).sum();
        let batch = &pairs[batch];
        let swept = sweep(gpu, batch, h, options, room)?;
        let filled = fill_slices(gpu, batch, h, options, swept)?;
        progress.advance(2 * batch.len());
        Ok(filled)
    })
}

/// Both sweeps of some pairs whose bands take so much room: their courses, and their fronts at the times that are wanted.
pub fn sweep(
    gpu: &Gpu,
    pairs: &[&SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    room: usize,
) -> Result<(Vec<Swept>, Copies)> {
    let nodes: usize = pairs.iter().map(|p| 2 * p.up.source.data.len()).sum();
    let room = room + SPARE_PLACES;
    with_room(room, nodes.max(room), |room| run(gpu, pairs, h, options, room))
}

fn run(
    gpu: &Gpu,
    pairs: &[&SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    room: usize,
) -> Result<Room<(Vec<Swept>, Copies)>> {
    let device = &gpu.device;
    let sweeps: Vec<&SweepJob<'_>> = pairs.iter().flat_map(|p| [&p.up, &p.down]).collect();
    let mut atlas = Atlas::new(sweeps.iter().map(|s| s.source.dims));
    let times = place_times(&mut atlas, &sweeps);
    let seeds = place_seeds(&mut atlas.jobs, sweeps.iter().map(|s| Valued::courses(s)), h);
    let copies = Copies::new(gpu, &mut atlas, room)?;
    let [sources, goals]: [Vec<&Field>; 2] =
        [sweeps.iter().map(|s| &*s.source).collect(), sweeps.iter().map(|s| &*s.goal).collect()];
    let (phi, arrivals) = (gpu.send_tiles("phi", &atlas, &sources)?, gpu.send_tiles("goal", &atlas, &goals)?);
    let params = Params { value_capacity: copies.value_capacity, ..morph_params(h, options) };
    let front = Front::new(gpu, atlas, params, Some(phi), room)?;
    let times = &device.upload("times", &times)?;
    let sums = &device.zeroed("sums", sweeps.len())?;
    let reads: usize = sweeps.iter().map(|s| s.times.len()).sum();
    let reached = &device.headed("reached", reads.max(1))?;
    let before = &device.storage("before", room)?;
    let upwind = Upwind::new(&front)?;
    let carried = Courses::new(&front, &upwind)?;
    let lines = [device.storage("line", room)?, device.storage("line", room)?];
    let errors = &device.storage("errors", room)?;
    let seeds = Seeds::new(&front, seeds, &carried.copies[0])?;
    let (Front { params, jobs, work, phi, band, .. }, goal) = (&front, &arrivals);
    let advance = Advance { params, jobs_mut: jobs, reached }.bind(gpu);
    let control = Control { params, sums, jobs_mut: jobs, times, reached }.bind(gpu);
    let copy = copies.bind(gpu, &front, reached, before);
    // Which copy of the courses holds them changes from step to step.
    let courses = carried.copies.each_ref();
    let measure =
        courses.map(|courses| Measure { params, jobs, band, work, phi, goal, sums, courses, errors }.bind(gpu));
    let line = &lines[0];
    let steer = courses.map(|courses| Steer { params, jobs, band, work, phi, courses, errors, line, before }.bind(gpu));
    let extend_line = [[0, 1], [1, 0]].map(|way| {
        let ([line, next_line], sources) = (way.map(|k| &lines[k]), &upwind.sources);
        ExtendLine { work, sources, line, next_line }.bind(gpu)
    });
    let stages = hj_step::stages(&front, line, false);
    let each_job = Size::List(sweeps.len());
    // What new morphs measure is carried as courses are.
    let remeasured = (options.redistance > 0).then(|| Courses::new(&front, &upwind)).transpose()?;
    let again = remeasured.as_ref().map(|courses| {
        let copies = carried.copies.each_ref();
        Again {
            recall: [0, 1].map(|k| {
                let (courses, remeasured) = (copies[k], &courses.copies[k]);
                Recall { jobs, band, work, phi, courses, errors, remeasured }.bind(gpu)
            }),
            measure: copies
                .map(|courses| MeasureAgain { jobs, band, work, phi, goal, sums, courses, errors }.bind(gpu)),
            steer: copies
                .map(|courses| SteerAgain { params, jobs, band, work, phi, courses, errors, line, before }.bind(gpu)),
            spend: courses.copies.each_ref().map(|remeasured| Spend { jobs, band, work, line, remeasured }.bind(gpu)),
            courses,
        }
    });
    let mut recorder = Recorder::new(device, &gpu.profiler);
    front.begin(&mut recorder);
    seeds.scatter(&mut recorder, &front);
    recorder.run(&upwind.find, front.per_pixel());
    carried.extend(&mut recorder, &front, 0, FIRST_PASSES);
    let turn = Cell::new(0);
    // By what the last morph has measured, if there has been one.
    let step = |recorder: &mut Recorder<'_>, measured: bool| {
        let again = again.as_ref().filter(|_| measured);
        let turn = turn.replace(1 - turn.get());
        recorder.run(&advance, each_job);
        match again {
            Some(again) => {
                recorder.run(&again.recall[turn], front.per_pixel());
                recorder.run(&again.measure[turn], front.per_chunk());
            }
            None => recorder.run(&measure[turn], front.per_chunk()),
        }
        recorder.run(&control, each_job);
        recorder.run(again.map_or(&steer[turn], |again| &again.steer[turn]), front.per_pixel());
        for pass in 0..PASSES {
            recorder.run(&extend_line[pass % 2], front.per_pixel());
        }
        if let Some(again) = again {
            recorder.run(&again.spend[turn], front.per_pixel());
        }
        front.step(recorder, &stages);
        recorder.run(&copy, Size::Indirect(&reached.raw, 0, Listed::Copies));
        front.rebuild(recorder);
        let all = || [Some(&carried), again.map(|again| again.courses)].into_iter().flatten();
        all().for_each(|courses| recorder.run(&courses.carry[turn], front.per_pixel()));
        recorder.run(&upwind.find, front.per_pixel());
        all().for_each(|courses| courses.extend(recorder, &front, 1 - turn, PASSES));
    };
    let ends = |states: &[Job]| {
        check_numbers("sweep", states)?;
        match states.iter().find(|s| s.steps > MOST_STEPS && s.phase == RUNNING) {
            Some(stuck) => Err(failure(format!("a sweep does not end: t = {} after {} steps", stuck.now, stuck.steps))),
            None => Ok(()),
        }
    };
    let run = match &remeasured {
        None => {
            let expected = expected_steps(&sweeps, h, options);
            front.run(recorder, Some(copies.pool()), expected, |recorder| step(recorder, false), ends)
        }
        Some(remeasured) => {
            let sweeps = Sweeps { jobs: &sweeps, h, options, remeasured, holds: &turn };
            remeasure::run(&front, recorder, copies.pool(), &sweeps, step, ends)
        }
    };
    let (states, copied) = match run? {
        Room::Enough(end) => end,
        Room::Short(wanted) => return Ok(Room::Short(wanted)),
    };
    let pixels = states.iter().map(|s| s.pixels as usize).sum();
    gpu.profiler
        .count(&["hj_step", "hj_step", "hj_step", "reinit", "sweep_steer", "extend_find", "extend_carry"], pixels);
    gpu.profiler.count(&["extend_line", "extend_courses"], PASSES * pixels);
    if copied > copies.value_capacity {
        return Ok(Room::Short(room + 1));
    }
    Ok(Room::Enough((states.iter().map(swept).collect(), copies.finished(states, arrivals))))
}

/// Kernels that steer by what a new morph has measured, by which copy holds the courses.
struct Again<'b, 'g> {
    recall: [Bound<'g>; 2],
    measure: [Bound<'g>; 2],
    steer: [Bound<'g>; 2],
    spend: [Bound<'g>; 2],
    /// What it has measured.
    courses: &'b Courses<'g>,
}

/// Steps that the last of some sweeps needs, about: its fastest piece comes as far a step as the Courant number says.
fn expected_steps(sweeps: &[&SweepJob<'_>], h: [f64; 2], options: &MorphOptions) -> usize {
    let way = |sweep: &&SweepJob<'_>| sweep.courses.iter().map(|course| course[0].abs()).fold(0.0, f64::max);
    let way = sweeps.par_iter().map(way).reduce(|| 0.0, f64::max);
    (HASTE * way / (options.cfl * h[0].min(h[1]))) as usize
}

/// Steps of a sweep for each that its longest course at an even speed would take: pelvis 0.91, torso 1.14.
const HASTE: f64 = 1.15;

fn swept(s: &Job) -> Swept {
    Swept {
        steps: s.steps as usize,
        pixels: s.pixels as usize,
        residual: Residual { mean: f64::from(s.residual_mean), max: f64::from(s.residual_max) },
        vanished: (s.phase == VANISHED).then_some(f64::from(s.vanished)),
    }
}

/// Output times of all jobs, one after the other.
fn place_times(atlas: &mut Atlas, jobs: &[&SweepJob<'_>]) -> Vec<f32> {
    let mut times = Vec::new();
    for (slot, job) in atlas.jobs.iter_mut().zip(jobs) {
        (slot.first_time, slot.time_count) = (times.len() as u32, job.times.len() as u32);
        times.extend(job.times.iter().map(|&t| t as f32));
    }
    if times.is_empty() { vec![1.0] } else { times }
}
