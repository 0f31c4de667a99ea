//! Kernels alone, from fields on the host to fields on the host: what the tests, the self-test and the benchmarks ask. Several jobs at once,
//! each with a tile of its own.

use std::time::Instant;

use glam::DVec2;

use crate::backend::jobs::SweepJob;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::atlas::Atlas;
use crate::gpu::band::Front;
use crate::gpu::buffer::Buffer;
use crate::gpu::distance::{DistanceBuffers, settled};
use crate::gpu::extend::{Courses, Upwind};
use crate::gpu::layout::Params;
use crate::gpu::particles::Particles;
use crate::gpu::recorder::Recorder;
use crate::gpu::scatter::{Seeds, Valued, place_seeds};
use crate::gpu::{exact, hj_step, moving, trajectories};
use crate::grid::field::Field;
use crate::grid::spline::HermiteArc;
use crate::registration::motion_field::{MotionField, Paths};

/// Shape and parameters of the tubes.
#[derive(Debug, Clone, Copy)]
pub struct Tubes {
    /// Pixel size, px of the larger side.
    pub h: [f64; 2],
    /// Half width.
    pub gamma: f64,
    /// Start of the cut-off.
    pub beta: f64,
}

/// Distances that are wanted.
#[derive(Debug, Clone, Copy)]
pub enum DistanceReach {
    /// To the contours of any level set, everywhere.
    Everywhere,
    /// To the contours of any level set, as far as this many px; no more than that beyond.
    Within(f64),
    /// Continued from a field that is right near its contours, as far as this many px.
    Beyond(f64),
}

/// Speeds of a Hamilton-Jacobi step, one field per job.
#[derive(Debug, Clone, Copy)]
pub enum Speeds<'a> {
    /// `phi - goal`, anew in every stage.
    Towards(&'a [Field]),
    /// Speeds as given.
    Given(&'a [Field]),
}

impl Tubes {
    fn params(self) -> Params {
        Params {
            hx: self.h[0] as f32,
            hy: self.h[1] as f32,
            gamma: self.gamma as f32,
            beta: self.beta as f32,
            step_share: 1.0,
            ..Params::default()
        }
    }
}

/// A band as listed: `(node of the atlas, job)`.
type Listed = Vec<[u32; 2]>;

impl Gpu {
    fn front(&self, phi: &[Field], tubes: Tubes, dt: &[f64]) -> Result<Front<'_>> {
        let mut atlas = Atlas::new(phi.iter().map(|f| f.dims));
        for (job, dt) in atlas.jobs.iter_mut().zip(dt) {
            (job.dt, job.now) = (*dt as f32, *dt as f32);
        }
        let values = atlas.send(&self.device, "phi", phi, 1.0)?;
        let room = atlas.node_count();
        Front::new(self, atlas, tubes.params(), Some(values), room)
    }

    fn record(&self, actions: impl FnOnce(&mut Recorder<'_>)) -> Result<()> {
        let mut recorder = Recorder::new(&self.device, &self.profiler);
        actions(&mut recorder);
        recorder.submit().map(|_| ())
    }

    fn unpack(&self, atlas: &Atlas, buffer: &Buffer<[f32]>) -> Result<Vec<Field>> {
        Ok(atlas.unpack(&self.device.read(buffer, 0, atlas.node_count())?))
    }

    fn listed(&self, front: &Front<'_>) -> Result<Listed> {
        let head = self.device.read_head(&front.work)?;
        self.device.read(&front.band, 0, head.band_total as usize)
    }

    /// Seconds that so many copies of `bytes` from one buffer to another take, sent off together.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn copies(&self, bytes: u64, count: usize) -> Result<f64> {
        let values = || self.device.zeroed::<f32>("copied", bytes as usize / size_of::<f32>());
        let (from, to) = (values()?, values()?);
        let copied = |count: usize| {
            let mut recorder = Recorder::new(&self.device, &self.profiler);
            (0..count).for_each(|_| recorder.copy(&from, &to, bytes));
            recorder.submit()?.wait()
        };
        copied(1)?;
        let begin = Instant::now();
        copied(count)?;
        Ok(begin.elapsed().as_secs_f64())
    }

    /// Distances measured as `reach` says.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn distances(&self, u: &[Field], h: [f64; 2], reach: DistanceReach) -> Result<Vec<Field>> {
        let limit = match reach {
            DistanceReach::Everywhere => 0.0,
            DistanceReach::Within(px) | DistanceReach::Beyond(px) => px as f32,
        };
        let params = Params { hx: h[0] as f32, hy: h[1] as f32, limit, ..Params::default() };
        settled(|rounds| {
            let atlas = Atlas::new(u.iter().map(|f| f.dims));
            let values = atlas.send(&self.device, "level", u, 1.0)?;
            let tiles = DistanceBuffers::new(self, atlas, params, values)?;
            let recorder = Recorder::new(&self.device, &self.profiler);
            let recorder = tiles.solve(recorder, matches!(reach, DistanceReach::Beyond(_)), rounds)?;
            tiles.read(recorder, |values| tiles.atlas.unpack(values))
        })
    }

    /// Exact distances to the other side of the masks `u < 0`.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn exact_distances(&self, u: &[Field], h: [f64; 2]) -> Result<Vec<Field>> {
        let atlas = Atlas::new(u.iter().map(|f| f.dims));
        let sides = atlas.send(&self.device, "sides", u, 1.0)?;
        let params = Params { hx: h[0] as f32, hy: h[1] as f32, ..Params::default() };
        let mut recorder = Recorder::new(&self.device, &self.profiler);
        let exact = exact::exact_distance(self, &mut recorder, &atlas, params, &sides)?;
        recorder.submit()?;
        self.unpack(&atlas, &exact)
    }

    /// Bands around `first` after the level sets have become `second`: each job's nodes in list order, and phi as the band leaves it.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn bands(&self, first: &[Field], second: &[Field], tubes: Tubes) -> Result<(Vec<Vec<usize>>, Vec<Field>)> {
        let front = self.front(first, tubes, &[])?;
        self.record(|recorder| front.begin(recorder))?;
        front.replace_phi(&front.atlas.pack(second.iter(), 1.0));
        self.record(|recorder| front.rebuild(recorder))?;
        let mut nodes = vec![Vec::new(); first.len()];
        for [node, q] in self.listed(&front)? {
            nodes[q as usize].push((node - front.atlas.jobs[q as usize].offset) as usize);
        }
        Ok((nodes, self.unpack(&front.atlas, &front.phi)?))
    }

    /// One Hamilton-Jacobi step of `dt` per job, then one reinitialisation.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn hj_step(&self, phi: &[Field], speeds: Speeds<'_>, tubes: Tubes, dt: &[f64]) -> Result<Vec<Field>> {
        let front = self.front(phi, tubes, dt)?;
        self.record(|recorder| front.begin(recorder))?;
        let field = match speeds {
            Speeds::Towards(goal) => front.atlas.send(&self.device, "goal", goal, 1.0)?,
            Speeds::Given(speed) => {
                let speed = front.atlas.pack(speed.iter(), 0.0);
                let placed: Vec<f32> = self.listed(&front)?.iter().map(|n| speed[n[0] as usize]).collect();
                self.device.upload("speed", &placed)?
            }
        };
        let stages = hj_step::stages(&front, &field, matches!(speeds, Speeds::Towards(_)));
        self.record(|recorder| front.step(recorder, &stages))?;
        self.unpack(&front.atlas, &front.phi)
    }

    /// An even number of reinitialisation iterations.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn reinit(&self, phi: &[Field], tubes: Tubes, iterations: usize) -> Result<Vec<Field>> {
        let front = self.front(phi, tubes, &[])?;
        self.record(|recorder| {
            front.begin(recorder);
            front.reinit(recorder, iterations);
        })?;
        self.unpack(&front.atlas, &front.phi)
    }

    /// Courses brought from seeds to the pixels at the contours of `first` and off them in `passes`, carried into the band of `second`, and
    /// extended there once more: per job and node, zero off the band.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn carried(
        &self,
        sweeps: &[SweepJob<'_>],
        second: &[Field],
        tubes: Tubes,
        passes: usize,
    ) -> Result<Vec<Vec<HermiteArc>>> {
        let sweeps: Vec<&SweepJob<'_>> = sweeps.iter().collect();
        let mut atlas = Atlas::new(sweeps.iter().map(|s| s.source.dims));
        let seeds = place_seeds(&mut atlas.jobs, sweeps.iter().map(|s| Valued::courses(s)), tubes.h);
        let values = atlas.send(&self.device, "phi", sweeps.iter().map(|s| &*s.source), 1.0)?;
        let room = atlas.node_count();
        let front = Front::new(self, atlas, tubes.params(), Some(values), room)?;
        let upwind = Upwind::new(&front)?;
        let courses = Courses::new(&front, &upwind)?;
        let seeds = Seeds::new(&front, seeds, &courses.copies[0])?;
        let turn = passes % 2;
        self.record(|recorder| {
            front.begin(recorder);
            seeds.scatter(recorder, &front);
            recorder.run(&upwind.find, front.per_pixel());
            (0..passes).for_each(|n| recorder.run(&courses.pass[n % 2], front.per_pixel()));
        })?;
        front.replace_phi(&front.atlas.pack(second.iter(), 1.0));
        self.record(|recorder| {
            front.rebuild(recorder);
            recorder.run(&courses.carry[turn], front.per_pixel());
            recorder.run(&upwind.find, front.per_pixel());
            (0..passes).for_each(|n| recorder.run(&courses.pass[(turn + 1 + n) % 2], front.per_pixel()));
        })?;
        let mut out: Vec<Vec<HermiteArc>> = sweeps.iter().map(|s| vec![[0.0; 4]; s.source.data.len()]).collect();
        let listed = self.listed(&front)?;
        let values = self.device.read(&courses.copies[(turn + 1 + passes) % 2], 0, listed.len())?;
        for ([node, q], value) in listed.iter().zip(values) {
            out[*q as usize][(node - front.atlas.jobs[*q as usize].offset) as usize] = value.map(f64::from);
        }
        Ok(out)
    }

    /// Paths through the layers of interval `i` at these times.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn paths(&self, moving: &MotionField, i: usize, times: &[f64], h: [f64; 2]) -> Result<Vec<Paths>> {
        let mut recorder = Recorder::new(&self.device, &self.profiler);
        let (followed, grid) = (&trajectories::trajectories(self, moving, i)?, moving.displacements[i].grid);
        let paths = trajectories::paths(self, &mut recorder, followed, (grid, moving.fields[i].dims), times, h, None)?;
        recorder.submit()?;
        let like = &moving.displacements[i];
        let vectors = self.device.read(&paths, 0, 2 * like.vectors.len() * times.len())?;
        let mut both = moving::displacements(like, &vectors);
        Ok(std::iter::from_fn(|| Some(Paths { come: both.next()?, go: both.next()? })).collect())
    }

    /// Particles at these positions, one step of `dt` per job: predicted in `before`, corrected in `after`, landed on `goal`.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn advect(
        &self,
        starts: &[Vec<DVec2>],
        [before, after, goal]: [&[Field]; 3],
        tubes: Tubes,
        dt: &[f64],
    ) -> Result<Vec<Vec<crate::backend::jobs::Track>>> {
        let front = self.front(before, tubes, dt)?;
        let goal = front.atlas.send(&self.device, "goal", goal, 1.0)?;
        let particles = Particles::new(&front, starts.iter().map(|xs| xs.iter().copied()), &goal)?;
        self.record(|recorder| recorder.run(&particles.predict, particles.each()))?;
        front.replace_phi(&front.atlas.pack(after.iter(), 1.0));
        self.record(|recorder| recorder.run(&particles.correct, particles.each()))?;
        let mut tracks = particles.land(&front)?.into_iter();
        Ok(starts.iter().map(|xs| tracks.by_ref().take(xs.len()).collect()).collect())
    }
}
