//! Morphs with tracker particles on the GPU.

use super::Gpu;
use super::atlas::{Atlas, batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::kernels::{Recorder, Size};
use super::layout::{Params, Particle, RUNNING, Sums};
use crate::backend::MorphOptions;
use crate::backend::jobs::{TraceJob, Traced, Track, full_distance};
use crate::error::Result;
use crate::grid::stencil::step_share;
use crate::progress::Progress;
use crate::report::Residual;

/// Steps between two looks at the jobs.
const LOOK: usize = 16;

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
    let rooms: Vec<usize> = jobs.iter().map(room_of).collect();
    let share = |(job, room): (&TraceJob<'_>, &usize)| {
        let (nodes, particles) = (padded(job.source.data.len()), job.seeds.len());
        let bytes = nodes * (NODE_BYTES + 4) + room * PLACE_BYTES + particles * size_of::<Particle>();
        gpu.share(bytes, (4 * nodes).max(8 * room).max(particles * size_of::<Particle>()))
    };
    let mut out = Vec::with_capacity(jobs.len());
    for batch in batches(jobs.iter().zip(&rooms).map(share)) {
        let room = rooms[batch.clone()].iter().sum::<usize>() + SPARE_PLACES;
        let batch = &jobs[batch];
        let nodes: usize = batch.iter().map(|j| j.source.data.len()).sum();
        out.extend(with_room(room, nodes.max(room), |room| run(gpu, batch, h, options, room))?);
        progress.advance(batch.len());
    }
    Ok(out)
}

fn run(
    gpu: &Gpu,
    jobs: &[TraceJob<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    room: usize,
) -> Result<Room<Vec<Traced>>> {
    let (device, k) = (&gpu.device, &gpu.kernels);
    let atlas = Atlas::new(jobs.iter().map(|j| j.source.dims));
    let phi = atlas.pack(jobs.iter().map(|j| &*j.source), 1.0);
    let goal = device.upload("goal", &atlas.pack(jobs.iter().map(|j| &*j.goal), 1.0))?;
    let front = Front::new(gpu, atlas, morph_params(h, options), Some(&phi), room)?;
    let sums = device.zeroed::<Sums>("sums", jobs.len())?;
    let seeds: Vec<Particle> = jobs
        .iter()
        .enumerate()
        .flat_map(|(q, job)| {
            job.seeds.iter().map(move |s| Particle {
                x: s.x.map(|v| v as f32),
                died: -1.0,
                job: q as u32,
                ..Particle::default()
            })
        })
        .collect();
    // An array cannot be empty; a dead particle stands for none.
    let none = [Particle { died: 0.0, ..Particle::default() }];
    let particles = device.upload("particles", if seeds.is_empty() { &none[..] } else { &seeds })?;
    let Front { params, jobs: table, band, work: lists, phi, .. } = &front;
    let measure = k.trace_measure.bind(
        device,
        &[("jobs", table), ("band", band), ("work", lists), ("phi", phi), ("goal", &goal), ("sums", &sums)],
    );
    let control = k.trace_control.bind(device, &[("params", params), ("sums", &sums), ("states", table)]);
    let follow = [&k.particles_predict, &k.particles_correct, &k.particles_land].map(|kernel| {
        kernel.bind(
            device,
            &[("params", params), ("jobs", table), ("phi", phi), ("goal", &goal), ("particles", &particles)],
        )
    });
    let stages = front.bind_step(&goal, true);
    let each_job = Size::List(jobs.len());
    let each_particle = Size::List(seeds.len().max(1));
    let mut work = Recorder::new(device, &gpu.profiler);
    front.begin(&mut work);
    let states = loop {
        for _ in 0..LOOK {
            work.run(&measure, front.per_chunk());
            work.run(&control, each_job);
            work.run(&follow[0], each_particle);
            front.step(&mut work, &stages);
            front.rebuild(&mut work);
            work.run(&follow[1], each_particle);
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
    };
    work.run(&follow[2], each_particle);
    work.submit()?;
    gpu.profiler.count(&["hj_step", "hj_step", "hj_step", "reinit"], states.iter().map(|s| s.pixels as usize).sum());
    let landed: Vec<Particle> = device.read(&particles, 0, seeds.len())?;
    let mut landed = landed.iter();
    Ok(Room::Enough(
        jobs.iter()
            .zip(&states)
            .map(|(job, s)| Traced {
                tracks: landed.by_ref().take(job.seeds.len()).map(track).collect(),
                steps: s.steps as usize,
                pixels: s.pixels as usize,
                residual: Residual { mean: f64::from(s.residual_mean), max: f64::from(s.residual_max) },
            })
            .collect(),
    ))
}

/// A particle at the end of its way.
pub fn track(p: &Particle) -> Track {
    let died = (p.died >= 0.0).then_some(f64::from(p.died));
    Track {
        distance: full_distance(f64::from(p.covered), died),
        arc: f64::from(p.arc),
        landing: p.x.map(f64::from),
        arrived: died.is_none(),
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
