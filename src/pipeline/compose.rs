//! Caps of an interval's parts that end, and what layers at contours differ by from the input.

use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::contour::unmatched::{HALF_WAY, LonePart};
use crate::grid::sparse_image::SparseImage;
use crate::pipeline::fit::Fitted;
use crate::pipeline::matching::Interval;
use crate::stack::SliceContent;

/// Caps of an interval's holes, group by group, and of its lone solid parts.
#[derive(Debug, Clone, Default)]
pub struct IntervalCaps {
    /// Per group.
    pub holes: Vec<Vec<(Cap, Direction)>>,
    /// Solid parts.
    pub solids: Vec<(Cap, Direction)>,
}

impl IntervalCaps {
    /// Profiles from the slopes of each part's own contour; `gap` is the interval's height; solid parts close by
    /// themselves, or at `latest`; distances count up to `farthest`.
    pub fn new(interval: &Interval, [low, high]: [&Fitted; 2], gap: f64, latest: f64, farthest: f64) -> Self {
        let cap = |part: &LonePart, outward: f64, height: f64| {
            let (fitted, sign) = match part.direction {
                Direction::Up => (low, 1.0),
                Direction::Down => (high, -1.0),
            };
            let mean = mean_slope(fitted, &part.seeds) * sign * outward * gap;
            (Cap::new(part, mean, height, farthest), part.direction)
        };
        IntervalCaps {
            holes: interval.groups.iter().map(|g| g.holes.iter().map(|h| cap(h, -1.0, HALF_WAY)).collect()).collect(),
            solids: interval.lone.iter().map(|p| cap(p, 1.0, p.closes.min(latest))).collect(),
        }
    }
}

/// Mean slope of some seeds, 0 where there are none.
pub fn mean_slope(fitted: &Fitted, seeds: &[u32]) -> f64 {
    let sum: f64 = seeds.iter().map(|&k| fitted.slopes[k as usize]).sum();
    sum / seeds.len().max(1) as f64
}

/// Pixels of a layer whose side differs from what the slice says.
pub fn differing_pixels(phi: &SparseImage<f32>, slice: &SliceContent) -> usize {
    let [nx, ny] = phi.dims();
    let (mut inside, mut values) = (vec![false; nx], vec![0.0; nx]);
    let differing = |j: usize| {
        slice.read(j * nx, &mut inside);
        phi.read(0, j, &mut values);
        values.iter().zip(&inside).filter(|(v, inside)| (**v < 0.0) != **inside).count()
    };
    (0..ny).map(differing).sum()
}
