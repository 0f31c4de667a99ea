//! Displacements of all intervals on the GPU: rounds of moments, window means and a solve joint over the intervals.
//!
//! The vectors and the evidence by which intervals know each other stay on the device. Their slices are sent once, or, where they do not fit
//! together, batch by batch in every round.

use std::ops::Range;
use std::sync::Arc;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::batches;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::{Axis, CHANGES, EVIDENCE, Image, Interval, Iteration, MOMENTS};
use super::moving::{self, image, per_pixel, send_vectors};
use super::recorder::{Recorder, Size};
use super::work;
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::reference::displacement::{COUPLING, HALF_EVIDENCE, NO_CHANGE, ROUNDS, Round};
use crate::registration::displacement::{Displacement, DisplacementJob, weights};

shader! {
    displacement = "common/job.wgsl" + "common/moving.wgsl" + twin "src/reference/displacement.rs";

    /// Both slices of every interval where `vectors` bring them together.
    BringTogether for bring_together, "displacement_pairs" {
        image: Uniform Image,
        iteration: Uniform Iteration,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        pairs: Write [[f32; 2]],
    }

    /// Moments of every node.
    SumMoments for sum_moments, "displacement_moments" {
        image: Uniform Image,
        iteration: Uniform Iteration,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        pairs: Write [[f32; 2]],
        numbers: Write [f32],
    }

    /// Difference of the slices at every node.
    SumChanges for sum_changes, "displacement_changes" {
        image: Uniform Image,
        iteration: Uniform Iteration,
        pairs: Write [[f32; 2]],
        numbers: Write [f32],
    }

    /// Its window means beside the evidence.
    KeepChanges for keep_changes, "displacement_keep" {
        image: Uniform Image,
        rough: Read [f32],
        evidence: Write [f32],
    }

    /// Gaussian means along an axis.
    WindowMean for window_mean, "displacement_mean" {
        image: Uniform Image,
        axis: Uniform Axis,
        weights: Read [f32],
        rough: Read [f32],
        smoothed: Write [f32],
    }

    /// Evidence of every node from its moments.
    Weigh for weigh, "displacement_weigh" {
        image: Uniform Image,
        iteration: Uniform Iteration,
        vectors: Read [[f32; 2]],
        rough: Read [f32],
        evidence: Write [f32],
        guess: Read [[f32; 2]],
    }

    /// Differences to the guess, joint over the intervals.
    Solve for solve, "displacement_solve" {
        image: Uniform Image,
        iteration: Uniform Iteration,
        numbers: Write [f32],
        evidence: Write [f32],
        intervals: Read [Interval],
    }

    /// The guess and these differences.
    AddGuess for add_guess, "displacement_guess" {
        image: Uniform Image,
        rough: Read [f32],
        guess: Read [[f32; 2]],
        vectors_mut: Write [[f32; 2]],
    }
}

/// Bytes of a node that stay from round to round: vectors, guess, evidence.
const KEPT_BYTES: usize = 8 + 8 + 4 * EVIDENCE;

/// Displacements of neighbouring intervals after some rounds.
pub fn displacements(gpu: &Gpu, job: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
    let mut most = job.gaps.len();
    loop {
        match displacements_at_once(gpu, job, most) {
            Err(Error::GpuMemory(_)) if most > 1 => {
                gpu.release()?;
                most = most.div_ceil(2);
            }
            done => return done,
        }
    }
}

/// Displacements with at most so many intervals in a batch.
fn displacements_at_once(gpu: &Gpu, job: &DisplacementJob<'_>, most: usize) -> Result<Vec<Displacement>> {
    let mut solver = Solver::new(gpu, job, most)?;
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    for round in &ROUNDS[job.rounds.clone()] {
        recorder = solver.round(recorder, *round)?;
    }
    solver.read(recorder)
}

/// Neighbouring intervals whose moments are computed together.
struct Batch {
    intervals: Range<usize>,
    image: Buffer<Image>,
    vectors: Buffer<[[f32; 2]]>,
    guess: Buffer<[[f32; 2]]>,
    /// Evidence of the batch and of one interval on either side.
    evidence: Buffer<[f32]>,
}

/// All intervals between two rounds.
pub struct Solver<'a> {
    gpu: &'a Gpu,
    slices: &'a [Arc<Field>],
    gaps: &'a [f64],
    h: [f64; 2],
    nodes: &'a Displacement,
    batches: Vec<Batch>,
    fields: Buffer<[f32]>,
    /// Both slices brought together, pixel by pixel.
    pairs: Buffer<[[f32; 2]]>,
    /// Numbers of nodes before and after smoothing.
    numbers: [Buffer<[f32]>; 2],
    /// Whether the slices of the only batch are there.
    sent: bool,
    /// The last round, for which it is known what the slices differ by.
    last: Option<Round>,
}

impl<'a> Solver<'a> {
    /// Before the first round; at most so many intervals in a batch.
    pub fn new(gpu: &'a Gpu, job: &DisplacementJob<'a>, most: usize) -> Result<Self> {
        let &DisplacementJob { fields: slices, gaps, guess, begin, h, .. } = job;
        let device = &gpu.device;
        let (dims, grid) = (slices[0].dims, guess[0].grid);
        let (pixels, nodes) = (dims[0] * dims[1], guess[0].vectors.len());
        let share = |_| {
            // Fields lie there twice when they are new.
            let bytes = 16 * pixels + 8 * MOMENTS * nodes;
            let share = gpu.share_beside(KEPT_BYTES * nodes * gaps.len() + 8 * pixels, bytes, 8 * pixels);
            share.max(gpu.share_of_work(work::DISPLACEMENT_PIXEL * pixels)).max(0.999 / most as f64)
        };
        let ranges = batches((0..gaps.len()).map(share));
        let most = ranges.iter().map(Range::len).max().unwrap_or(0);
        let batch = |intervals: Range<usize>| -> Result<Batch> {
            let guess_of = send_vectors(device, "guess", &guess[intervals.clone()])?;
            // Most searches begin with their guess.
            let bits = |v: &'a Displacement| bytemuck::cast_slice::<_, u64>(&v.vectors);
            let alike = intervals.clone().all(|i| bits(&begin[i]) == bits(&guess[i]));
            let vectors = if alike {
                let vectors = device.storage("vectors", intervals.len() * nodes)?;
                device.copy_before((&guess_of, 0), (&vectors, 0), intervals.len() * nodes);
                vectors
            } else {
                send_vectors(device, "vectors", &begin[intervals.clone()])?
            };
            Ok(Batch {
                image: device.uniform("image", image(dims, grid, h, intervals.len())),
                vectors,
                guess: guess_of,
                evidence: device.storage("evidence", (intervals.len() + 2) * nodes * EVIDENCE)?,
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
            fields: device.storage("slices", (most + 1) * pixels)?,
            pairs: device.storage("pairs", most * pixels)?,
            numbers: [
                device.storage("moments", most * nodes * MOMENTS)?,
                device.storage("moments", most * nodes * MOMENTS)?,
            ],
            sent: false,
            last: None,
        })
    }

    fn node_count(&self) -> usize {
        self.nodes.vectors.len()
    }

    /// One round of all intervals, behind what is recorded.
    pub fn round(&mut self, mut recorder: Recorder<'a>, round: Round) -> Result<Recorder<'a>> {
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
                for (k, slice) in slices.iter().enumerate() {
                    self.gpu.place(&mut recorder, (slice, 1.0, 1.0), (&self.fields, k * slice.data.len()))?;
                }
            }
            if !known {
                self.see_changes(&mut recorder, batch, &iteration, &changes);
            }
            self.weigh(&mut recorder, batch, &iteration, &window);
            // Images that do not stay wait until they are copied.
            if self.batches.len() > 1 {
                recorder.submit()?;
                recorder = Recorder::new(device, &self.gpu.profiler);
            }
        }
        self.sent = true;
        self.last = Some(round);
        for batch in &self.batches {
            self.solve(&mut recorder, batch, &iteration, &smoothing, round)?;
        }
        Ok(recorder)
    }

    /// Records the difference of the slices of a batch, which are in `fields`, where the guess brings them together.
    fn see_changes(
        &self,
        recorder: &mut Recorder<'_>,
        batch: &Batch,
        iteration: &Buffer<Iteration>,
        window: &Smoothing,
    ) {
        let Solver { gpu, fields, pairs, numbers: [numbers, means], .. } = self;
        let Batch { intervals, image, guess, evidence, .. } = batch;
        let together = BringTogether { image, iteration, fields, vectors: guess, pairs }.bind(gpu);
        let sum = SumChanges { image, iteration, pairs, numbers }.bind(gpu);
        let keep = KeepChanges { image, rough: numbers, evidence }.bind(gpu);
        let per_node = Size::List(intervals.len() * self.node_count());
        recorder.run(&together, per_pixel(self.slices[0].dims, intervals.len()));
        recorder.run(&sum, per_node);
        self.smooth(recorder, batch, window, [numbers, means, numbers]);
        recorder.run(&keep, per_node);
    }

    /// Records the evidence of a batch, whose slices are in `fields`.
    fn weigh(&self, recorder: &mut Recorder<'_>, batch: &Batch, iteration: &Buffer<Iteration>, window: &Smoothing) {
        let Solver { gpu, fields, pairs, numbers: [numbers, means], .. } = self;
        let Batch { intervals, image, vectors, guess, evidence } = batch;
        let together = BringTogether { image, iteration, fields, vectors, pairs }.bind(gpu);
        let sum = SumMoments { image, iteration, fields, vectors, pairs, numbers }.bind(gpu);
        let weigh = Weigh { image, iteration, vectors, rough: numbers, evidence, guess }.bind(gpu);
        let per_node = Size::List(intervals.len() * self.node_count());
        recorder.run(&together, per_pixel(self.slices[0].dims, intervals.len()));
        recorder.run(&sum, per_node);
        self.smooth(recorder, batch, window, [numbers, means, numbers]);
        recorder.run(&weigh, per_node);
    }

    /// Records new vectors of a batch from everybody's evidence.
    fn solve(
        &self,
        recorder: &mut Recorder<'_>,
        batch: &Batch,
        iteration: &Buffer<Iteration>,
        smoothing: &Smoothing,
        round: Round,
    ) -> Result<()> {
        let Solver { gpu, numbers: [numbers, means], .. } = self;
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
        let table = &gpu.device.upload("intervals", &table)?;
        let solve = Solve { image, iteration, numbers, evidence, intervals: table }.bind(gpu);
        let lead = AddGuess { image, rough: numbers, guess, vectors_mut: vectors }.bind(gpu);
        let per_node = Size::List(intervals.len() * self.node_count());
        self.bring_neighbours(recorder, batch);
        recorder.run(&solve, per_node);
        self.smooth(recorder, batch, smoothing, [numbers, means, numbers]);
        recorder.run(&lead, per_node);
        Ok(())
    }

    /// Copies the evidence next to a batch from the batches next to it.
    fn bring_neighbours(&self, recorder: &mut Recorder<'_>, batch: &Batch) {
        let bytes = (4 * EVIDENCE * self.node_count()) as u64;
        for other in &self.batches {
            let (own, beside) = (&batch.intervals, &other.intervals);
            if beside.end == own.start {
                recorder.copy_part((&other.evidence, bytes * beside.len() as u64), (&batch.evidence, 0), bytes);
            } else if beside.start == own.end {
                recorder.copy_part((&other.evidence, bytes), (&batch.evidence, bytes * (own.len() + 1) as u64), bytes);
            }
        }
    }

    /// Gaussian means along rows, then along columns of nodes.
    fn smooth(&self, recorder: &mut Recorder<'_>, batch: &Batch, smoothing: &Smoothing, places: [&Buffer<[f32]>; 3]) {
        let count = batch.intervals.len() * self.node_count() * smoothing.width;
        let (gpu, image, weights) = (self.gpu, &batch.image, &smoothing.weights);
        for (axis, ends) in smoothing.axes.iter().zip(places.windows(2)) {
            let mean = WindowMean { image, axis, weights, rough: ends[0], smoothed: ends[1] }.bind(gpu);
            recorder.run(&mean, Size::List(count));
        }
    }

    /// Vectors of all intervals after what is recorded.
    pub fn read(&self, mut recorder: Recorder<'_>) -> Result<Vec<Displacement>> {
        let ask = |batch: &Batch| recorder.read(&batch.vectors, 0, batch.intervals.len() * self.node_count());
        let wanted: Vec<Wanted<[f32; 2]>> = self.batches.iter().map(ask).collect();
        let landed = recorder.submit()?.wait()?;
        let mut out = Vec::with_capacity(self.gaps.len());
        for wanted in &wanted {
            out.extend(moving::displacements(self.nodes, &landed.values(wanted)?));
        }
        Ok(out)
    }
}

/// Gaussian means along both axes.
struct Smoothing {
    weights: Buffer<[f32]>,
    axes: [Buffer<Axis>; 2],
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
