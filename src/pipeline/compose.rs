//! Caps of an interval's parts that end, and what layers at contours differ by from the input.

use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::contour::unmatched::LonePart;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::pipeline::fit::Fitted;
use crate::pipeline::matching::Interval;
use crate::stack::SliceContent;

/// Caps of an interval's holes, group by group, and of its lone solid parts.
#[derive(Debug, Clone, Default)]
pub struct IntervalCaps {
    /// Per group, on tiles in pixels of its own.
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
            let mean = mean_slope(fitted, part.counted()) * sign * outward * gap;
            (Cap::new(part, mean, height, farthest), part.direction)
        };
        let hole = |hole: &LonePart, tile: Tile| {
            let (cap, direction) = cap(hole, -1.0, hole.closes);
            (Cap { tile: cap.tile.within(tile), hole: true, ..cap }, direction)
        };
        IntervalCaps {
            holes: interval.groups.iter().map(|g| g.holes.iter().map(|h| hole(h, g.tile)).collect()).collect(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn a_part_that_shrinks_towards_its_end_begins_to_close_with_its_own_slope() {
        let tile = Tile { origin: [0; 2], dims: [3; 2] };
        let part = |direction| LonePart::new(tile, Field::filled(tile.dims, -4.0), vec![0, 2], direction);
        let interval = Interval { lone: [Direction::Up, Direction::Down].map(part).into(), ..Interval::default() };
        // 2 px per gap in the mean of the part's own seeds; half a gap of that over 4 px are 0.25.
        let fitted = |sign: f64| {
            let mut fitted = Fitted::default();
            fitted.slopes.extend([0.1, 9.0, 0.3].map(|m| sign * m));
            fitted
        };
        let shrinking = |low: f64, high: f64| {
            let caps = IntervalCaps::new(&interval, [&fitted(low), &fitted(high)], 10.0, 1.0, 9.0);
            caps.solids.iter().map(|(cap, _)| cap.profile.shrinking()).collect::<Vec<_>>()
        };
        // Upward one shrinks whose contour goes inward on the way up, downward one whose contour goes outward.
        for (found, expected) in [(shrinking(-1.0, 1.0), [0.25; 2]), (shrinking(1.0, -1.0), [0.0; 2])] {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}, not {expected:?}");
            assert_eq!(found.len(), 2);
        }
    }
}
