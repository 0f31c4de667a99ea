//! Trajectories from node to node on the GPU: places of nodes in the moving frame, and the ways between them.

use std::cmp::Ordering;

use super::device::Buffer;
use super::fairing::{GpuFairing, GpuPlace};
use super::fairing_transform::per_square;
use super::kernels::shader;
use super::layout::{
    FROM_LOWER, FROM_UPPER, FairingOrigin, FairingPair, FairingShape, FairingStep, FairingWay, Image, NONE, OVER_BOTH,
    TABLE,
};
use super::moving::{image, vectors};
use super::recorder::{Recorder, Size};
use crate::backend::fairing::TransformRequest;
use crate::error::Result;
use crate::grid::spline::smoothstep;

shader! {
    fairing_paths = "common/job.wgsl" + "common/fairing.wgsl" + "common/moving.wgsl" + "common/through.wgsl"
        + twin "src/registration/motion_field.rs";

    /// Displacements of intervals at their slices.
    AtSlices for at_slices, "fairing_at_slices" {
        image: Uniform Image,
        vectors: Write [[f32; 2]],
        ways: Read [FairingWay],
    }

    /// Ways through nodes.
    Follow for follow, "fairing_follow" {
        image: Uniform Image,
        vectors: Write [[f32; 2]],
        ways: Read [FairingWay],
    }

    /// Ways back to nodes.
    Back for back, "fairing_back" {
        image: Uniform Image,
        vectors: Write [[f32; 2]],
        ways: Read [FairingWay],
    }

    /// Offsets from nodes to nodes.
    Carry for carry, "fairing_carry" {
        image: Uniform Image,
        shape: Uniform FairingShape,
        vectors: Write [[f32; 2]],
        origins: Read [FairingOrigin],
        pairs: Read [FairingPair],
        steps: Read [FairingStep],
        tasks: Read [[u32; 2]],
        places: Read [u32],
        marks: Read [u32],
        offsets: Write [[f32; 2]],
    }
}

/// Fields of an interval in `vectors`, and of a node; which of them are the displacements at the slices, and the ways back.
const OF_INTERVAL: usize = 5;
const OF_NODE: usize = 4;
const AT_LOWER: usize = 3;
const AT_UPPER: usize = 4;
const OFF_LOWER: usize = 2;
const OFF_UPPER: usize = 3;

/// Ways from some nodes to others.
#[derive(Debug, Default)]
pub struct Ways {
    pub origins: Vec<FairingOrigin>,
    pub pairs: Vec<FairingPair>,
    pub steps: Vec<FairingStep>,
    /// Offsets in all.
    pub offsets: usize,
}

/// Makes the places of transformed nodes in the moving frame, if there is one.
pub fn place(state: &mut GpuFairing<'_>, requests: &[TransformRequest], recorder: &mut Recorder<'_>) -> Result<()> {
    let Some((moving, pad)) = state.frame.moving else { return Ok(()) };
    let gpu = state.gpu;
    let device = &gpu.device;
    let (mut intervals, mut ways, mut grid) = (Vec::new(), Vec::new(), [0; 2]);
    for request in requests {
        if state.made(request.node).is_none() {
            continue;
        }
        let (interval, t) = moving.time_of(request.z);
        let frame = moving.frame(interval..interval + 2)?;
        let v = &frame.displacements[0];
        let count = v.vectors.len();
        grid = v.grid;
        if !state.intervals.contains_key(&interval) {
            let rates = [0, 1].map(|s| frame.rates[s].map(|_, _, k| k.map(|c| c * frame.gap(0))));
            let segment = state.vectors.take(gpu, OF_INTERVAL * count)?;
            let own = vectors([&**v, &rates[0], &rates[1]]);
            device.write_at(state.vectors.buffer(gpu)?, segment.first, &own);
            state.intervals.insert(interval, segment);
            intervals.push(FairingWay { interval: segment.begin(), ..FairingWay::default() });
        }
        let segment = state.vectors.take(gpu, OF_NODE * count)?;
        ways.push(FairingWay {
            interval: state.intervals[&interval].begin(),
            node: segment.begin(),
            t: t as f32,
            tau: (t - 0.5) as f32,
            first: (t * (t - 1.0) * (t - 1.0)) as f32,
            second: (t * t * (t - 1.0)) as f32,
        });
        if let Some(made) = state.made_mut(request.node) {
            made.place = Some(GpuPlace { interval, t, vectors: segment });
        }
    }
    let dims = [0, 1].map(|a| state.frame.dims[a] + 2 * pad[a]);
    let of = |count: usize| device.uniform("image", image(dims, grid, [1.0; 2], count));
    let vectors = state.vectors.buffer(gpu)?;
    let count = grid[0] * grid[1];
    if !intervals.is_empty() {
        let (image, table) = (&of(intervals.len()), &device.upload("fairing intervals", &intervals)?);
        recorder.run(&AtSlices { image, vectors, ways: table }.bind(gpu), Size::List(count * intervals.len()));
    }
    if !ways.is_empty() {
        let (image, table) = (&of(ways.len()), &device.upload("fairing ways", &ways)?);
        recorder.run(&Follow { image, vectors, ways: table }.bind(gpu), Size::List(count * ways.len()));
        recorder.run(&Back { image, vectors, ways: table }.bind(gpu), Size::List(count * ways.len()));
    }
    Ok(())
}

impl Ways {
    /// Adds node `from` and the ways from it to others, at most once each. The pair to each of them, `NONE` where it is read straight.
    pub fn add(&mut self, state: &GpuFairing<'_>, from: usize, to: &[Option<usize>]) -> (FairingOrigin, Vec<u32>) {
        let first_pair = self.pairs.len();
        let mut known: Vec<(usize, u32)> = Vec::new();
        let mut numbers = Vec::with_capacity(to.len());
        for to in to {
            let way = to.and_then(|to| {
                if let Some((_, number)) = known.iter().find(|(k, _)| *k == to) {
                    return Some(*number);
                }
                let pair = self.way(state, from, to)?;
                let number = (self.pairs.len() - first_pair) as u32;
                self.pairs.push(pair);
                known.push((to, number));
                Some(number)
            });
            numbers.push(way.unwrap_or(NONE));
        }
        let pair_count = self.pairs.len() - first_pair;
        let mut origin = FairingOrigin {
            first_pair: first_pair as u32,
            pair_count: pair_count as u32,
            offsets: self.offsets as u32,
            ..FairingOrigin::default()
        };
        if let Some(made) = state.made(from) {
            origin.node = made.place.map_or(0, |place| place.vectors.begin());
            (origin.squares, origin.marks) = (made.list.begin(), made.marks.begin());
            self.offsets += made.squares.len() * pair_count * TABLE;
        }
        self.origins.push(origin);
        (origin, numbers)
    }

    /// The way from a node to another, `Place::carry`.
    fn way(&mut self, state: &GpuFairing<'_>, from: usize, to: usize) -> Option<FairingPair> {
        if from == to {
            return None;
        }
        let [own, other] = [state.made(from)?.place?, state.made(to)?.place?];
        let count = (other.vectors.len / OF_NODE) as u32;
        let first_step = self.steps.len() as u32;
        let mut step = |first: u32, field: usize, sign: f32| {
            self.steps.push(FairingStep { vectors: first + field as u32 * count, sign });
        };
        let interval = |i: &usize| state.intervals.get(i).map(|segment| segment.begin());
        let there = other.vectors.begin();
        let start = match own.interval.cmp(&other.interval) {
            Ordering::Equal if other.t == 0.0 => FROM_LOWER,
            Ordering::Equal if other.t == 1.0 => FROM_UPPER,
            Ordering::Equal => {
                step(there, OFF_LOWER, 1.0);
                step(there, OFF_UPPER, 1.0);
                OVER_BOTH
            }
            Ordering::Less => {
                let between = (own.interval + 1..other.interval).filter_map(|i| interval(&i));
                between.for_each(|first| step(first, AT_LOWER, 1.0));
                match interval(&other.interval) {
                    Some(first) if other.t == 1.0 => step(first, AT_LOWER, 1.0),
                    _ => step(there, OFF_LOWER, 1.0),
                }
                FROM_UPPER
            }
            Ordering::Greater => {
                let between = (other.interval + 1..own.interval).rev().filter_map(|i| interval(&i));
                between.for_each(|first| step(first, AT_UPPER, -1.0));
                match interval(&other.interval) {
                    Some(first) if other.t == 0.0 => step(first, AT_UPPER, -1.0),
                    _ => step(there, OFF_UPPER, 1.0),
                }
                FROM_LOWER
            }
        };
        let last_step = self.steps.len() as u32;
        let [lower, upper] = [smoothstep(1.0 - own.t) as f32, smoothstep(own.t) as f32];
        Some(FairingPair { start, first_step, last_step, lower, upper })
    }

    /// The offsets of all ways, for squares of the nodes by these tasks.
    pub fn offsets(
        &self,
        state: &mut GpuFairing<'_>,
        tasks: &Buffer<[[u32; 2]]>,
        count: usize,
        recorder: &mut Recorder<'_>,
    ) -> Result<Buffer<[[f32; 2]]>> {
        let gpu = state.gpu;
        let device = &gpu.device;
        let offsets = device.storage("fairing offsets", self.offsets)?;
        let Some((moving, pad)) = state.frame.moving.filter(|_| !self.pairs.is_empty()) else { return Ok(offsets) };
        let dims = [0, 1].map(|a| state.frame.dims[a] + 2 * pad[a]);
        let grid = moving.grid()?;
        let (image, shape) =
            (&device.uniform("image", image(dims, grid, [1.0; 2], 1)), &device.uniform("fairing shape", state.shape));
        let (origins, pairs) =
            (&device.upload("fairing origins", &self.origins)?, &device.upload("fairing pairs", &self.pairs)?);
        // A binding must not be empty.
        let steps = if self.steps.is_empty() { &[FairingStep::default()][..] } else { &self.steps };
        let steps = &device.upload("fairing steps", steps)?;
        let (vectors, places) = (state.vectors.buffer(gpu)?, state.places.buffer(gpu)?);
        let marks = state.marks.buffer(gpu)?;
        let carry =
            Carry { image, shape, vectors, origins, pairs, steps, tasks, places, marks, offsets: &offsets }.bind(gpu);
        recorder.run(&carry, per_square(count));
        Ok(offsets)
    }
}
