//! Run time of a reconstruction, estimated before it starts.
//!
//! CPU seconds of the reference path grow with what stages work on: pixels of the slices (distance, motion), pixels in which neighbours differ
//! (steps of the morphs), edges of the contours times layers (what is near the surface of each), pixels of the layers. Their costs are a fit
//! to default runs of 17 stacks, 0.3 to 13 CPU seconds each, and the estimate 0.6 to 1.3 times what these took; how fast a machine is, a small
//! distance transform says. Of pixels r times as long as wide more lie near the surface, and steps are shorter: the second and the third cost
//! `max(1, (r / 4)^2)` times as much; of a tube the estimate is a half of what it took at r = 30, and a quarter at r = 50 (17 s).

use std::time::Instant;

use rayon::prelude::*;

use crate::estimate::coverage::{Drawn, differing};
use crate::grid::field::Field;
use crate::grid::tile::samples;
use crate::reference::distance::distance_of;
use crate::settings::Settings;
use crate::stack::ContourStack;

/// CPU microseconds per unit of each kind of work, where [`PROBE`] takes PROBE_SECONDS.
const COSTS: [f64; 4] = [0.5, 24.0, 17.5, 0.015];
/// Side of the image whose distance transform tells the machine's pace, px, and how often it is taken.
const PROBE: usize = 256;
const PROBES: usize = 5;
const PROBE_SECONDS: f64 = 2.77e-3;
/// Times as long as wide that pixels may be at no more cost.
const LONG: f64 = 4.0;
/// Share of a thread that each one after the first adds.
const GAIN: f64 = 0.75;

/// Work of a reconstruction with default settings.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Effort {
    /// Padded pixels of all slices; pixels in which neighbours differ; edges of the larger of both, for each layer between; pixels of all
    /// layers.
    work: [f64; 4],
}

impl Effort {
    /// The effort for layers of `stack` at `heights`.
    pub fn of(stack: &ContourStack, heights: &[f64]) -> Self {
        let px = stack.spacing[0].max(stack.spacing[1]);
        let around = samples(Settings::default().margin() + 8, stack.spacing.map(|side| side / px));
        let padded: usize = (0..2).map(|a| stack.dims[a] + 2 * around[a]).product();
        let pixels: usize = stack.dims.iter().product();
        let drawn: Vec<Drawn> = stack.slices.par_iter().map(|s| Drawn::of(&s.content, stack.dims)).collect();
        let differing = stack.slices.par_windows(2).map(|w| differing([&w[0].content, &w[1].content], stack.dims));
        let layers = |w: &[crate::stack::Slice]| heights.iter().filter(|z| **z >= w[0].z && **z < w[1].z).count();
        let ratio = px / stack.spacing[0].min(stack.spacing[1]);
        let long = (ratio / LONG).powi(2).max(1.0);
        let of_layers = |(s, d): (&[crate::stack::Slice], &[Drawn])| (layers(s) * d[0].edges.max(d[1].edges)) as f64;
        Effort {
            work: [
                (padded * stack.slices.len()) as f64,
                differing.sum::<usize>() as f64 * long,
                stack.slices.windows(2).zip(drawn.windows(2)).map(of_layers).sum::<f64>() * long,
                (pixels * heights.len()) as f64,
            ],
        }
    }

    /// That of another run too.
    pub fn and(self, other: Self) -> Self {
        Effort { work: std::array::from_fn(|k| self.work[k] + other.work[k]) }
    }

    /// Seconds on so many cores of this machine.
    pub fn seconds(&self, threads: usize) -> f64 {
        let cpu: f64 = self.work.iter().zip(COSTS).map(|(work, cost)| 1e-6 * work * cost).sum();
        cpu * pace() / (1.0 + GAIN * (threads.max(1) - 1) as f64)
    }
}

/// Factor of this machine: its time over that of the machine on which [`COSTS`] were measured.
fn pace() -> f64 {
    let middle = 0.5 * PROBE as f64;
    let disc = Field::from_fn([PROBE; 2], |i, j| (i as f64 - middle).hypot(j as f64 - middle) - 0.6 * middle);
    let taken = (0..PROBES).map(|_| {
        let start = Instant::now();
        std::hint::black_box(distance_of(&disc, [1.0; 2]));
        start.elapsed().as_secs_f64()
    });
    taken.fold(f64::INFINITY, f64::min) / PROBE_SECONDS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Geometry, LevelSlice, Slice, SliceContent};

    /// Discs that grow, 4 apart.
    fn stack(side: usize, slices: usize) -> ContourStack {
        let disc = |k: usize| {
            let (middle, radius) = (0.5 * side as f64, (0.3 + 0.01 * k as f64) * side as f64);
            let value = |n: usize| ((n % side) as f64 - middle).hypot((n / side) as f64 - middle) - radius;
            SliceContent::Level(LevelSlice::new(&(0..side * side).map(|n| value(n) as f32).collect::<Vec<_>>(), side))
        };
        let slice = |k: usize| Slice { name: k.to_string(), z: 4.0 * k as f64, extra: false, content: disc(k) };
        ContourStack {
            dims: [side; 2],
            spacing: [1.0; 2],
            unit: "mm".into(),
            slices: (0..slices).map(slice).collect(),
            z_out: None,
            geometry: Geometry::default(),
            known: None,
        }
    }

    #[test]
    fn work_grows_with_slices_and_layers() {
        let work = |slices: usize, dz: f64| {
            let heights = (0..).map(|k| k as f64 * dz).take_while(|z| *z < 4.0 * slices as f64);
            Effort::of(&stack(100, slices), &heights.collect::<Vec<f64>>()).work
        };
        let (few, many, fine) = (work(5, 1.0), work(9, 1.0), work(5, 0.5));
        assert!(few.iter().zip(many).all(|(few, many)| (1.7..2.6).contains(&(many / few))), "{few:?} {many:?}");
        assert_eq!([fine[0], fine[1]], [few[0], few[1]]);
        assert!([2, 3].iter().all(|&k| fine[k] > 1.9 * few[k]), "{few:?} {fine:?}");
    }
}
