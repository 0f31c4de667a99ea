//! Values of seeds at the pixels of a contour, on the GPU.

use std::borrow::Cow;

use glam::DVec2;
use rayon::prelude::*;

use super::band::Front;
use super::buffer::Buffer;
use super::kernels::{Bound, shader};
use super::layout::{Job, Known, NONE, Params, Seed, Work};
use super::recorder::{Recorder, Size};
use crate::backend::jobs::SweepJob;
use crate::error::Result;
use crate::reference::scatter::{FILL_ROUNDS, RADIUS};

shader! {
    scatter = "common/job.wgsl" + "common/field.wgsl" + twin "src/reference/scatter.rs";

    /// Where each bin begins.
    LayBins for lay_bins, "scatter_bins" {
        seeds: Read [Seed],
        bins_mut: Write [u32],
    }

    /// Means of the seeds near each pixel at the contour.
    Scatter for scatter, "scatter" {
        params: Uniform Params,
        jobs: Read [Job],
        work: Read Work,
        band: Read [[u32; 2]],
        phi: Read [f32],
        seeds: Read [Seed],
        bins: Read [u32],
        courses: Write [[f32; 4]],
        known: Write Known,
    }

    /// Before every round of filling.
    NextRound for next_round, "scatter_round" {
        known: Write Known,
    }

    /// Pixels at the contour that no seed reaches, from their neighbours: one round.
    Fill for fill, "scatter_fill" {
        params: Uniform Params,
        jobs: Read [Job],
        work: Read Work,
        band: Read [[u32; 2]],
        courses: Write [[f32; 4]],
        known: Write Known,
        slots: Read [u32],
    }
}

/// Seeds of the jobs of a front, on their way to its pixels.
pub struct Seeds<'g> {
    scatter: Bound<'g>,
    next_round: Bound<'g>,
    fill: Bound<'g>,
}

impl<'g> Seeds<'g> {
    /// Courses of a front from the result of [`place_seeds`].
    pub fn new(front: &Front<'g>, (seeds, count): (Vec<Seed>, usize), courses: &Buffer<[[f32; 4]]>) -> Result<Self> {
        let Front { gpu, params, jobs, work, band, phi, slots, .. } = front;
        let (seeds, bins) = (&gpu.device.upload("seeds", &seeds)?, &gpu.device.storage("bins", count)?);
        gpu.device.run_before(&LayBins { seeds, bins_mut: bins }.bind(gpu), count)?;
        let known = &gpu.device.headed("known", front.capacity)?;
        Ok(Seeds {
            scatter: Scatter { params, jobs, work, band, phi, seeds, bins, courses, known }.bind(gpu),
            next_round: NextRound { known }.bind(gpu),
            fill: Fill { params, jobs, work, band, courses, known, slots }.bind(gpu),
        })
    }

    /// Gives the pixels at the contours their courses.
    pub fn scatter(&self, recorder: &mut Recorder<'_>, front: &Front<'_>) {
        recorder.run(&self.scatter, front.per_pixel());
        for _ in 0..FILL_ROUNDS {
            recorder.run(&self.next_round, Size::One);
            recorder.run(&self.fill, front.per_pixel());
        }
    }
}

/// Seeds on a tile, px, and the values they bring to the pixels near them.
pub struct Valued<'s> {
    /// Columns and rows of the tile.
    pub dims: [usize; 2],
    /// The seeds.
    pub seeds: Cow<'s, [DVec2]>,
    /// Their values.
    pub values: Cow<'s, [[f64; 4]]>,
}

impl<'s> Valued<'s> {
    /// Seeds of a sweep with their courses.
    pub fn courses(job: &'s SweepJob<'_>) -> Self {
        Valued { dims: job.source.dims, seeds: (&job.seeds).into(), values: (&job.courses).into() }
    }
}

/// Seeds of all jobs in the order of their bins of RADIUS px, and how many bins there are. The bins of a job hang on its tile alone; behind them
/// one is empty, with which they end.
pub fn place_seeds<'s>(slots: &mut [Job], jobs: impl Iterator<Item = Valued<'s>>, h: [f64; 2]) -> (Vec<Seed>, usize) {
    let placed = |job: &Valued<'_>| {
        let cells: [usize; 2] = std::array::from_fn(|a| (job.dims[a] as f64 * h[a] / RADIUS) as usize + 1);
        let bin = |x: &DVec2| {
            let cell = |a: usize| ((x[a] * h[a] / RADIUS).max(0.0) as usize).min(cells[a] - 1);
            cell(1) * cells[0] + cell(0)
        };
        let mut order: Vec<(usize, usize)> = job.seeds.iter().enumerate().map(|(k, x)| (bin(x), k)).collect();
        order.sort_unstable();
        let seed = |&(bin, k): &(usize, usize)| {
            let ([s, m0, m1, ok], [x, y]) = (job.values[k].map(|v| v as f32), job.seeds[k].as_vec2().into());
            Seed { s, m0, m1, ok, x, y, bin: bin as u32 }
        };
        (cells, order.iter().map(seed).collect::<Vec<Seed>>())
    };
    let jobs: Vec<Valued<'s>> = jobs.collect();
    let placed: Vec<_> = jobs.par_iter().map(placed).collect();
    let (mut seeds, mut bins) = (Vec::new(), 0);
    for (slot, (cells, own)) in slots.iter_mut().zip(placed) {
        let first = bins as u32;
        (slot.first_bin, slot.bins_x, slot.bins_y) = (first, cells[0] as u32, cells[1] as u32);
        seeds.extend(own.into_iter().map(|seed| Seed { bin: first + seed.bin, ..seed }));
        bins += cells[0] * cells[1] + 1;
    }
    // An array cannot be empty; one that lies in no bin stands for none.
    if seeds.is_empty() {
        seeds.push(Seed { bin: NONE, ..Seed::default() });
    }
    (seeds, bins)
}
