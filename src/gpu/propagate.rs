//! Sweeps on the GPU, and the slices made of them.

use super::Gpu;
use super::atlas::{Atlas, batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::compose::{Copies, fill_slices};
use super::device::failure;
use super::kernels::{Bound, Recorder, Size};
use super::layout::{BLOCK, Copy, Job, RUNNING, Reached, Read, Round, Rounds, Seed, Source, Sums, VANISHED};
use super::trace::morph_params;
use crate::backend::MorphOptions;
use crate::backend::jobs::{Filled, SweepJob, SweepPair, Swept};
use crate::error::Result;
use crate::progress::Progress;
use crate::reference::propagate::{FIRST_PASSES, PASSES};
use crate::reference::scatter::RADIUS;
use crate::report::Residual;

/// Steps between two looks at the jobs.
const LOOK: usize = 16;
/// Steps after which a sweep is given up; real ones take less than a hundred per pixel of motion.
const MOST_STEPS: u32 = 100_000;
/// Bytes per band place beside the front's own: courses and speeds twice, errors, sources, rounds of filling, the start of a step.
const SWEEP_PLACE_BYTES: usize = PLACE_BYTES + 80;

/// All pairs of sweeps, batch by batch, and their slices.
pub fn propagate(
    gpu: &Gpu,
    pairs: &[SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    progress: &dyn Progress,
) -> Result<Vec<Filled>> {
    let room_of = |pair: &SweepPair<'_>| {
        let edges = crossings(&pair.up.source).max(crossings(&pair.up.goal));
        2 * places(edges, options.half_width, pair.up.source.data.len())
    };
    let rooms: Vec<usize> = pairs.iter().map(room_of).collect();
    let share = |(pair, room): (&SweepPair<'_>, &usize)| {
        let nodes = 2 * padded(pair.up.source.data.len());
        let copied = [room * 4, nodes / BLOCK * size_of::<Copy>()].map(|bytes| bytes * pair.up.times.len());
        let bytes = nodes * (NODE_BYTES + 4) + room * SWEEP_PLACE_BYTES + copied[0] + copied[1];
        gpu.share(bytes, (4 * nodes).max(16 * room).max(copied[0]).max(copied[1]))
    };
    let mut out = Vec::with_capacity(pairs.len());
    for batch in batches(pairs.iter().zip(&rooms).map(share)) {
        let room = rooms[batch.clone()].iter().sum::<usize>() + SPARE_PLACES;
        let batch = &pairs[batch];
        let nodes: usize = batch.iter().map(|p| 2 * p.up.source.data.len()).sum();
        let swept = with_room(room, nodes.max(room), |room| run(gpu, batch, h, options, room))?;
        out.extend(fill_slices(gpu, batch, h, options, swept)?);
        progress.advance(2 * batch.len());
    }
    Ok(out)
}

/// Buffers of the carried values, in band order; the first index says which step's turn it is.
struct Carried<'g> {
    measure: [Bound<'g>; 2],
    steer: [Bound<'g>; 2],
    carry: [Bound<'g>; 2],
    /// Passes from these courses to the others.
    courses: [Bound<'g>; 2],
    /// Passes over the speed, there and back.
    line: [Bound<'g>; 2],
}

fn run(
    gpu: &Gpu,
    pairs: &[SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    room: usize,
) -> Result<Room<(Vec<Swept>, Copies)>> {
    let (device, k) = (&gpu.device, &gpu.kernels);
    let jobs: Vec<&SweepJob<'_>> = pairs.iter().flat_map(|p| [&p.up, &p.down]).collect();
    let mut atlas = Atlas::new(jobs.iter().map(|j| j.source.dims));
    let times = place_times(&mut atlas, &jobs);
    let (seeds, bins) = place_seeds(&mut atlas, &jobs, h);
    let copies = Copies::new(gpu, &mut atlas, room)?;
    let phi = atlas.pack(jobs.iter().map(|j| &*j.source), 1.0);
    let goal = device.upload("goal", &atlas.pack(jobs.iter().map(|j| &*j.goal), 1.0))?;
    let params = super::layout::Params { value_capacity: copies.value_capacity, ..morph_params(h, options) };
    let front = Front::new(gpu, atlas, params, Some(&phi), room)?;
    let (times, seeds, bins) =
        (device.upload("times", &times)?, device.upload("seeds", &seeds)?, device.upload("bins", &bins)?);
    let sums = device.zeroed::<Sums>("sums", jobs.len())?;
    let reads: usize = jobs.iter().map(|j| j.times.len()).sum();
    let reached = device.headed::<Reached, Read>("reached", reads)?;
    let before = device.storage::<[f32; 4]>("before", room)?;
    let courses = [0, 1].map(|_| device.storage::<[f32; 4]>("courses", room));
    let line = [0, 1].map(|_| device.storage::<f32>("line", room));
    let ([courses_a, courses_b], [line_a, line_b]) = (courses, line);
    let (courses, line) = ([courses_a?, courses_b?], [line_a?, line_b?]);
    let errors = device.storage::<f32>("errors", room)?;
    let sources = device.storage::<Source>("sources", room)?;
    let rounds = device.headed::<Rounds, Round>("rounds", room)?;
    let Front { params, jobs: table, work: lists, phi, band, slots, earlier, .. } = &front;
    let scatter = k.scatter.bind(
        device,
        &[
            ("params", params),
            ("jobs", table),
            ("work", lists),
            ("band", band),
            ("phi", phi),
            ("seeds", &seeds),
            ("bins", &bins),
            ("courses", &courses[0]),
            ("rounds", &rounds),
        ],
    );
    let fill = k.scatter_fill.bind(
        device,
        &[
            ("params", params),
            ("jobs", table),
            ("band", band),
            ("courses", &courses[0]),
            ("rounds", &rounds),
            ("slots", slots),
        ],
    );
    let find = k.extend_find.bind(
        device,
        &[
            ("params", params),
            ("jobs", table),
            ("work", lists),
            ("band", band),
            ("phi", phi),
            ("slots", slots),
            ("sources", &sources),
        ],
    );
    let advance = k.sweep_advance.bind(device, &[("params", params), ("states", table), ("reached", &reached)]);
    let control = k.sweep_control.bind(
        device,
        &[("params", params), ("sums", &sums), ("states", table), ("times", &times), ("reached", &reached)],
    );
    let copy = copies.bind(gpu, &front, &reached, &before);
    let carried = Carried {
        measure: [0, 1].map(|a| {
            k.sweep_measure.bind(
                device,
                &[
                    ("params", params),
                    ("jobs", table),
                    ("band", band),
                    ("work", lists),
                    ("phi", phi),
                    ("goal", &goal),
                    ("sums", &sums),
                    ("courses", &courses[a]),
                    ("errors", &errors),
                ],
            )
        }),
        steer: [0, 1].map(|a| {
            k.sweep_steer.bind(
                device,
                &[
                    ("params", params),
                    ("jobs", table),
                    ("band", band),
                    ("work", lists),
                    ("phi", phi),
                    ("courses", &courses[a]),
                    ("errors", &errors),
                    ("line", &line[0]),
                    ("before", &before),
                ],
            )
        }),
        carry: [0, 1].map(|a| {
            k.extend_carry.bind(
                device,
                &[
                    ("params", params),
                    ("work", lists),
                    ("courses", &courses[a]),
                    ("next_courses", &courses[1 - a]),
                    ("earlier", earlier),
                ],
            )
        }),
        courses: [0, 1].map(|a| {
            k.extend_courses.bind(
                device,
                &[("work", lists), ("sources", &sources), ("courses", &courses[a]), ("next_courses", &courses[1 - a])],
            )
        }),
        line: [0, 1].map(|a| {
            k.extend_line.bind(
                device,
                &[("work", lists), ("sources", &sources), ("line", &line[a]), ("next_line", &line[1 - a])],
            )
        }),
    };
    let stages = front.bind_step(&line[0], false);
    let each_job = Size::List(jobs.len());
    let mut work = Recorder::new(device, &gpu.profiler);
    front.begin(&mut work);
    work.run(&scatter, front.per_pixel());
    work.run(&fill, Size::One);
    work.run(&find, front.per_pixel());
    for pass in 0..FIRST_PASSES {
        work.run(&carried.courses[pass % 2], front.per_pixel());
    }
    let mut turn = 0;
    let states = loop {
        for _ in 0..LOOK {
            work.run(&advance, each_job);
            work.run(&carried.measure[turn], front.per_chunk());
            work.run(&control, each_job);
            work.run(&carried.steer[turn], front.per_pixel());
            for pass in 0..PASSES {
                work.run(&carried.line[pass % 2], front.per_pixel());
            }
            front.step(&mut work, &stages);
            work.run(&copy, Size::Indirect(&reached, 0));
            front.rebuild(&mut work);
            work.run(&carried.carry[turn], front.per_pixel());
            turn = 1 - turn;
            work.run(&find, front.per_pixel());
            for pass in 0..PASSES {
                work.run(&carried.courses[(turn + pass) % 2], front.per_pixel());
            }
        }
        work.submit()?;
        let states = front.states()?;
        if let Some(wanted) = front.overflow()? {
            return Ok(Room::Short(wanted));
        }
        work = Recorder::new(device, &gpu.profiler);
        if states.iter().all(|s| s.phase != RUNNING) {
            break states;
        }
        if let Some(stuck) = states.iter().find(|s| s.steps > MOST_STEPS && s.phase == RUNNING) {
            return Err(failure(format!("a sweep does not end: t = {} after {} steps", stuck.now, stuck.steps)));
        }
    };
    drop(work);
    let pixels = states.iter().map(|s| s.pixels as usize).sum();
    gpu.profiler
        .count(&["hj_step", "hj_step", "hj_step", "reinit", "sweep_steer", "extend_find", "extend_carry"], pixels);
    gpu.profiler.count(&["extend_line", "extend_courses"], PASSES * pixels);
    if copies.overflow(gpu)? {
        return Ok(Room::Short(room + 1));
    }
    Ok(Room::Enough((states.iter().map(swept).collect(), copies.finished(states))))
}

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

/// Seeds of all jobs sorted into bins of RADIUS px, and where each bin begins.
pub fn place_seeds(atlas: &mut Atlas, jobs: &[&SweepJob<'_>], h: [f64; 2]) -> (Vec<Seed>, Vec<u32>) {
    let (mut seeds, mut bins) = (Vec::new(), Vec::new());
    for (slot, job) in atlas.jobs.iter_mut().zip(jobs) {
        let cells: [usize; 2] = std::array::from_fn(|a| (job.source.dims[a] as f64 * h[a] / RADIUS) as usize + 1);
        (slot.first_bin, slot.bins_x, slot.bins_y) = (bins.len() as u32, cells[0] as u32, cells[1] as u32);
        let bin = |x: &[f64; 2]| {
            let cell = |a: usize| ((x[a] * h[a] / RADIUS).max(0.0) as usize).min(cells[a] - 1);
            cell(1) * cells[0] + cell(0)
        };
        let mut order: Vec<(usize, usize)> = job.seeds.iter().enumerate().map(|(k, x)| (bin(x), k)).collect();
        order.sort_unstable();
        let mut next = 0;
        for b in 0..=cells[0] * cells[1] {
            while next < order.len() && order[next].0 < b {
                next += 1;
            }
            bins.push((seeds.len() + next) as u32);
        }
        seeds.extend(order.iter().map(|&(_, k)| Seed {
            course: job.courses[k].map(|v| v as f32),
            x: job.seeds[k].map(|v| v as f32),
            padding: [0.0; 2],
        }));
    }
    if seeds.is_empty() {
        seeds.push(Seed::default());
    }
    (seeds, bins)
}
