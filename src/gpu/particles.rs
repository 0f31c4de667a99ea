//! Tracker particles on the GPU.

use glam::DVec2;

use super::answers::Wanted;
use super::band::Front;
use super::buffer::Buffer;
use super::kernels::{Bound, shader};
use super::layout::{Job, Params, Particle};
use super::recorder::{Recorder, Size};
use crate::backend::jobs::{Track, full_distance};
use crate::error::Result;

shader! {
    particles = "common/job.wgsl" + "common/field.wgsl" + "common/goal.wgsl" + twin "src/reference/particles.rs";

    /// Particles where they start.
    Begin for begin, "particles_begin" {
        params: Uniform Params,
        particles: Write [Particle],
        starts: Read [[f32; 2]],
        firsts: Read [u32],
    }

    /// An Euler step before the front moves.
    Predict for predict, "particles_predict" {
        params: Uniform Params,
        jobs: Read [Job],
        phi: Read [f32],
        goal: Read [f32],
        particles: Write [Particle],
    }

    /// Heun's mean after it has moved, and back onto the front.
    Correct for correct, "particles_correct" {
        params: Uniform Params,
        jobs: Read [Job],
        phi: Read [f32],
        goal: Read [f32],
        particles: Write [Particle],
    }

    /// Last step of particles, from the front as it ends onto the goal.
    Land for land, "particles_land" {
        params: Uniform Params,
        jobs: Read [Job],
        phi: Read [f32],
        goal: Read [f32],
        particles: Write [Particle],
    }
}

/// The particles of all jobs of a front.
pub struct Particles<'g> {
    /// Number of them.
    pub count: usize,
    buffer: Buffer<[Particle]>,
    /// Before the front moves.
    pub predict: Bound<'g>,
    /// After it has moved.
    pub correct: Bound<'g>,
    /// At the end.
    land: Bound<'g>,
}

impl<'g> Particles<'g> {
    /// Particles at these pixels of the tiles of all jobs, job by job, bound for `goal`. The host sends their places alone.
    pub fn new(
        front: &Front<'g>,
        jobs_starts: impl Iterator<Item = impl Iterator<Item = DVec2>>,
        goal: &Buffer<[f32]>,
    ) -> Result<Self> {
        let Front { gpu, params, jobs, phi, .. } = front;
        let (mut starts, mut firsts): (Vec<[f32; 2]>, Vec<u32>) = Default::default();
        for own in jobs_starts {
            firsts.push(starts.len() as u32);
            starts.extend(own.map(|x| x.as_vec2().to_array()));
        }
        let count = starts.len();
        firsts.push(count as u32);
        // An array cannot be empty; a dead particle stands for none.
        let buffer = match count {
            0 => gpu.device.zeroed("particles", 1)?,
            _ => gpu.device.storage("particles", count)?,
        };
        let particles = &buffer;
        if count > 0 {
            let (starts, firsts) = (&gpu.device.upload("starts", &starts)?, &gpu.device.upload("firsts", &firsts)?);
            gpu.device.run_before(&Begin { params, starts, firsts, particles }.bind(gpu), count)?;
        }
        Ok(Particles {
            count,
            predict: Predict { params, jobs, phi, goal, particles }.bind(gpu),
            correct: Correct { params, jobs, phi, goal, particles }.bind(gpu),
            land: Land { params, jobs, phi, goal, particles }.bind(gpu),
            buffer,
        })
    }

    /// One invocation per particle.
    pub fn each(&self) -> Size<'static> {
        Size::List(self.count.max(1))
    }

    /// The particles after their last step, in order.
    pub fn land(&self, front: &Front<'_>) -> Result<Vec<Track>> {
        let mut recorder = Recorder::new(&front.gpu.device, &front.gpu.profiler);
        recorder.run(&self.land, self.each());
        let wanted: Wanted<Particle> = recorder.read(&self.buffer, 0, self.count);
        Ok(recorder.submit()?.wait()?.values(&wanted)?.iter().map(track).collect())
    }
}

/// A particle at the end of its way.
fn track(p: &Particle) -> Track {
    let [covered, kept, own, share] = [p.covered, p.kept, p.own, p.share].map(f64::from);
    Track {
        distance: full_distance(covered, kept, [own, share]),
        arc: f64::from(p.arc),
        landing: p.x.map(f64::from).into(),
        kept,
    }
}
