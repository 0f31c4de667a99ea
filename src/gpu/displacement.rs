//! Displacements of all intervals on the GPU: rounds of moments, window means and a solve joint over the intervals.
//!
//! What the intervals know of each other (vectors, evidence) stays on the device. Their slices are sent once, or, where they do not fit
//! together, batch by batch in every round.

use std::ops::Range;
use std::sync::Arc;

use super::Gpu;
use super::atlas::batches;
use super::device::Buffer;
use super::kernels::{Recorder, Size};
use super::layout::{Axis, CHANGES, EVIDENCE, Interval, Iteration, MOMENTS};
use super::moving::{self, image, pack, per_pixel, vectors};
use crate::error::Result;
use crate::grid::field::Field;
use crate::reference::displacement::{COUPLING, HALF_EVIDENCE, NO_CHANGE, ROUNDS, Round};
use crate::registration::displacement::{Displacement, DisplacementJob, weights};

/// Bytes of a node that stay from round to round: vectors, guess, evidence.
const KEPT_BYTES: usize = 8 + 8 + 4 * EVIDENCE;

/// Displacements of neighbouring intervals after some rounds.
pub fn displacements(gpu: &Gpu, job: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
    let mut solver = Solver::new(gpu, job)?;
    for round in &ROUNDS[job.rounds.clone()] {
        solver.round(*round)?;
    }
    solver.read()
}

/// Neighbouring intervals whose moments are computed together.
struct Batch {
    intervals: Range<usize>,
    image: Buffer,
    vectors: Buffer,
    guess: Buffer,
    /// Of the batch and of one interval on either side.
    evidence: Buffer,
}

/// All intervals between two rounds.
pub struct Solver<'a> {
    gpu: &'a Gpu,
    slices: &'a [Arc<Field>],
    gaps: &'a [f64],
    h: [f64; 2],
    nodes: &'a Displacement,
    batches: Vec<Batch>,
    fields: Buffer,
    /// Both slices brought together, pixel by pixel.
    pairs: Buffer,
    /// Numbers of nodes before and after smoothing.
    numbers: [Buffer; 2],
    /// Whether the slices of the only batch are there.
    sent: bool,
    /// The last round, for which it is known what the slices differ by.
    last: Option<Round>,
}

impl<'a> Solver<'a> {
    /// Before the first round.
    pub fn new(gpu: &'a Gpu, job: &DisplacementJob<'a>) -> Result<Self> {
        let &DisplacementJob { fields: slices, gaps, guess, begin, h, .. } = job;
        let device = &gpu.device;
        let (dims, grid) = (slices[0].dims, guess[0].grid);
        let (pixels, nodes) = (dims[0] * dims[1], guess[0].vectors.len());
        let share = |_| {
            let bytes = 12 * pixels + 8 * MOMENTS * nodes;
            gpu.share_beside(KEPT_BYTES * nodes * gaps.len() + 4 * pixels, bytes, 8 * pixels)
        };
        let ranges = batches((0..gaps.len()).map(share));
        let most = ranges.iter().map(Range::len).max().unwrap_or(0);
        let batch = |intervals: Range<usize>| -> Result<Batch> {
            Ok(Batch {
                image: device.uniform("image", image(dims, grid, h, intervals.len())),
                vectors: device.upload("vectors", &vectors(&begin[intervals.clone()]))?,
                guess: device.upload("guess", &vectors(&guess[intervals.clone()]))?,
                evidence: device.storage::<f32>("evidence", (intervals.len() + 2) * nodes * EVIDENCE)?,
                intervals,
            })
        };
        Ok(Solver {
            gpu,
            slices,
            gaps,
            h,
            batches: ranges.into_iter().map(batch).collect::<Result<_>>()?,
            nodes: &guess[0],
            fields: device.storage::<f32>("slices", (most + 1) * pixels)?,
            pairs: device.storage::<[f32; 2]>("pairs", most * pixels)?,
            numbers: [
                device.storage::<f32>("moments", most * nodes * MOMENTS)?,
                device.storage::<f32>("moments", most * nodes * MOMENTS)?,
            ],
            sent: false,
            last: None,
        })
    }

    fn node_count(&self) -> usize {
        self.nodes.vectors.len()
    }

    /// One round of all intervals.
    pub fn round(&mut self, round: Round) -> Result<()> {
        let device = &self.gpu.device;
        let iteration = device.uniform(
            "iteration",
            Iteration {
                clip: round.clip as f32,
                width: round.width as f32,
                reach: round.reach() as f32,
                half_evidence: HALF_EVIDENCE as f32,
                coupling: COUPLING as f32,
                no_change: NO_CHANGE as f32,
                ..Iteration::default()
            },
        );
        let window = Smoothing::new(self.gpu, round.window_sigma(self.h), MOMENTS)?;
        let known = self.last.is_some_and(|last| last.sees_as(&round));
        let changes = Smoothing::new(self.gpu, round.window_sigma(self.h), CHANGES)?;
        let smoothing = Smoothing::new(self.gpu, round.smoothing_sigma(self.h), 2)?;
        for batch in &self.batches {
            if !self.sent || self.batches.len() > 1 {
                let slices = &self.slices[batch.intervals.start..=batch.intervals.end];
                device.write(&self.fields, &pack(slices));
            }
            if !known {
                self.see_changes(batch, &iteration, &changes)?;
            }
            self.weigh(batch, &iteration, &window)?;
        }
        self.sent = true;
        self.last = Some(round);
        for batch in &self.batches {
            self.solve(batch, &iteration, &smoothing, round)?;
        }
        Ok(())
    }

    /// What the slices of a batch, which are in `fields`, differ by where the guess brings them together.
    fn see_changes(&self, batch: &Batch, iteration: &Buffer, window: &Smoothing) -> Result<()> {
        let (device, k) = (&self.gpu.device, &self.gpu.kernels);
        let Batch { intervals, image, guess, evidence, .. } = batch;
        let [sums, means] = &self.numbers;
        let together = k.displacement_pairs.bind(
            device,
            &[
                ("image", image),
                ("iteration", iteration),
                ("fields", &self.fields),
                ("vectors", guess),
                ("pairs", &self.pairs),
            ],
        );
        let sum = k
            .displacement_changes
            .bind(device, &[("image", image), ("iteration", iteration), ("pairs", &self.pairs), ("moments", sums)]);
        let keep = k.displacement_keep.bind(device, &[("image", image), ("rough", sums), ("evidence", evidence)]);
        let per_node = Size::List(intervals.len() * self.node_count());
        let mut work = Recorder::new(device, &self.gpu.profiler);
        work.run(&together, per_pixel(self.slices[0].dims, intervals.len()));
        work.run(&sum, per_node);
        self.smooth(&mut work, batch, window, [sums, means, sums]);
        work.run(&keep, per_node);
        work.submit()
    }

    /// Evidence of a batch, whose slices are in `fields`.
    fn weigh(&self, batch: &Batch, iteration: &Buffer, window: &Smoothing) -> Result<()> {
        let (device, k) = (&self.gpu.device, &self.gpu.kernels);
        let Batch { intervals, image, vectors, guess, evidence } = batch;
        let [moments, means] = &self.numbers;
        let together = [
            ("image", image),
            ("iteration", iteration),
            ("fields", &self.fields),
            ("vectors", vectors),
            ("pairs", &self.pairs),
        ];
        let together = k.displacement_pairs.bind(device, &together);
        let sums = [
            ("image", image),
            ("iteration", iteration),
            ("fields", &self.fields),
            ("vectors", vectors),
            ("pairs", &self.pairs),
            ("moments", moments),
        ];
        let sums = k.displacement_moments.bind(device, &sums);
        let weigh = k.displacement_weigh.bind(
            device,
            &[
                ("image", image),
                ("iteration", iteration),
                ("vectors", vectors),
                ("rough", moments),
                ("evidence", evidence),
                ("guess", guess),
            ],
        );
        let per_node = Size::List(intervals.len() * self.node_count());
        let mut work = Recorder::new(device, &self.gpu.profiler);
        work.run(&together, per_pixel(self.slices[0].dims, intervals.len()));
        work.run(&sums, per_node);
        self.smooth(&mut work, batch, window, [moments, means, moments]);
        work.run(&weigh, per_node);
        work.submit()
    }

    /// New vectors of a batch from everybody's evidence.
    fn solve(&self, batch: &Batch, iteration: &Buffer, smoothing: &Smoothing, round: Round) -> Result<()> {
        let (device, k) = (&self.gpu.device, &self.gpu.kernels);
        let Batch { intervals, image, vectors, guess, evidence } = batch;
        // A neighbour's displacement counts as a rate.
        let rate = |i: usize, j: Option<usize>| j.and_then(|j| self.gaps.get(j)).map_or(0.0, |gap| self.gaps[i] / gap);
        let table: Vec<Interval> = intervals
            .clone()
            .map(|i| {
                let [before, after] = [rate(i, i.checked_sub(1)), rate(i, Some(i + 1))];
                Interval { before: before as f32, after: after as f32, ridge: round.ridge as f32, padding: 0.0 }
            })
            .collect();
        let table = device.upload("intervals", &table)?;
        let [found, between] = &self.numbers;
        let solve = [
            ("image", image),
            ("iteration", iteration),
            ("evidence", evidence),
            ("intervals", &table),
            ("found", &found.viewed::<[f32; 2]>()),
        ];
        let solve = k.displacement_solve.bind(device, &solve);
        let lead = k
            .displacement_guess
            .bind(device, &[("image", image), ("rough", found), ("guess", guess), ("found", vectors)]);
        let mut work = Recorder::new(device, &self.gpu.profiler);
        self.bring_neighbours(&mut work, batch);
        work.run(&solve, Size::List(intervals.len() * self.node_count()));
        self.smooth(&mut work, batch, smoothing, [found, between, found]);
        work.run(&lead, Size::List(intervals.len() * self.node_count()));
        work.submit()
    }

    /// Copies the evidence next to a batch from the batches next to it.
    fn bring_neighbours(&self, work: &mut Recorder<'_>, batch: &Batch) {
        let bytes = (4 * EVIDENCE * self.node_count()) as u64;
        for other in &self.batches {
            let (own, beside) = (&batch.intervals, &other.intervals);
            if beside.end == own.start {
                work.copy_part((&other.evidence, bytes * beside.len() as u64), (&batch.evidence, 0), bytes);
            } else if beside.start == own.end {
                work.copy_part((&other.evidence, bytes), (&batch.evidence, bytes * (own.len() + 1) as u64), bytes);
            }
        }
    }

    /// Gaussian means along rows, then along columns of nodes.
    fn smooth(&self, work: &mut Recorder<'_>, batch: &Batch, smoothing: &Smoothing, places: [&Buffer; 3]) {
        let count = batch.intervals.len() * self.node_count() * smoothing.width;
        for (axis, ends) in smoothing.axes.iter().zip(places.windows(2)) {
            let buffers = [
                ("image", &batch.image),
                ("axis", axis),
                ("weights", &smoothing.weights),
                ("rough", ends[0]),
                ("smoothed", ends[1]),
            ];
            let mean = self.gpu.kernels.displacement_mean.bind(&self.gpu.device, &buffers);
            work.run(&mean, Size::List(count));
        }
    }

    /// Vectors of all intervals.
    pub fn read(&self) -> Result<Vec<Displacement>> {
        let mut out = Vec::with_capacity(self.gaps.len());
        for batch in &self.batches {
            let read = self.gpu.device.read(&batch.vectors, 0, batch.intervals.len() * self.node_count())?;
            out.extend(moving::displacements(self.nodes, &read));
        }
        Ok(out)
    }
}

/// Gaussian means along both axes.
struct Smoothing {
    weights: Buffer,
    axes: [Buffer; 2],
    /// Numbers of a node.
    width: usize,
}

impl Smoothing {
    /// `sigma` in nodes.
    fn new(gpu: &Gpu, sigma: [f64; 2], width: usize) -> Result<Self> {
        let both = sigma.map(weights);
        let axis = |vertical: usize| Axis {
            vertical: vertical as u32,
            first: (vertical * both[0].len()) as u32,
            reach: (both[vertical].len() / 2) as u32,
            width: width as u32,
        };
        let axes = [0, 1].map(|vertical| gpu.device.uniform("axis", axis(vertical)));
        let weights: Vec<f32> = both.iter().flatten().map(|w| *w as f32).collect();
        Ok(Smoothing { weights: gpu.device.upload("weights", &weights)?, axes, width })
    }
}
