//! Changes from slice to slice: whether a stack is relief, and how far its contours go sideways per height.
//!
//! **Relief.** A hill is a height over every pixel: seen from below, pixels only ever leave its slices. The share of the changes that go one way,
//! `n = max(sum |A \\ B|, sum |B \\ A|) / sum |A xor B|` with sums over the intervals of the whole stack, is 1 for a hill (and a hill upside down)
//! and about 0.5 where bodies move or, as a ball does, grow and shrink again. It has no unit: neither stretching nor turning a stack changes it.
//! It is 1.000 in all our terrain, and at most 0.877 in anatomy.
//!
//! **Rate.** Where heights are compared with widths, what a unit of height counts as must not depend on the unit: stretched along z, a stack has the
//! same body. Of a surface that faces all ways alike slices close together have `(pi / 2) sum |A xor B| = sum P dz`, P their perimeters (over the
//! sphere of normals |cos| has the mean 1/2, |sin| pi/4). So `r = (pi / 2) sum |A xor B| / sum P dz` is what a unit of height counts as for the
//! body to be as high as it is wide; a gap g counts as `r g`. Intervals of which a slice is empty count for nothing: how far into them a body goes
//! nothing says, and empty slices around a stack must change nothing. Of a ball with equal units it is 1 in the limit (0.8 on slices of a seventh of
//! its radius), of CT and terrain 0.5 to 1.7.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use rayon::prelude::*;

use crate::grid::spline::smoothstep;
use crate::stack::ruggedness::ruggedness;
use crate::stack::{ContourStack, Slice};

/// Below this share a stack is no relief, above the other nothing else.
const NONE: f64 = 0.97;
const ALL: f64 = 0.995;
/// Pixels that are read at once.
const PIXELS_READ: usize = 4096;

/// Summary of the changes between all slices of a stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Degree to which the stack is relief, 0 to 1.
    pub relief: f64,
    /// Degree to which it is relief whose contours are rugged, see `ruggedness`, 0 to 1.
    pub rugged: f64,
    /// Length that a unit of height counts as, unit of the pixel spacing; 0 where nothing changes.
    pub rate: f64,
}

impl Change {
    /// Between the slices of `stack`.
    pub fn of(stack: &ContourStack) -> Self {
        let pixels = stack.dims[0] * stack.dims[1];
        let changed: Vec<[u64; 2]> =
            stack.slices.par_windows(2).map(|pair| changed([&pair[0], &pair[1]], pixels)).collect();
        let [leaving, coming] = changed.iter().fold([0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
        let all = leaving + coming;
        let one_sided = leaving.max(coming) as f64 / all.max(1) as f64;
        let perimeters: Vec<f64> = stack.slices.par_iter().map(|slice| perimeter(slice, stack)).collect();
        let beside = stack.slices.windows(2).zip(perimeters.windows(2)).zip(&changed);
        let going_on = beside.filter(|((_, p), _)| p.iter().all(|p| *p > 0.0));
        let (walls, pixels) = going_on.fold((0.0, 0), |(walls, pixels), ((pair, p), [leaving, coming])| {
            (walls + 0.5 * (p[0] + p[1]) * (pair[1].z - pair[0].z), pixels + leaving + coming)
        });
        let area = pixels as f64 * stack.spacing[0] * stack.spacing[1];
        let relief = smoothstep((one_sided - NONE) / (ALL - NONE));
        Change {
            relief,
            rugged: if relief > 0.0 { relief * ruggedness(stack) } else { 0.0 },
            rate: if walls > 0.0 { FRAC_PI_2 * area / walls } else { 0.0 },
        }
    }
}

/// `|A \\ B|` and `|B \\ A|`.
fn changed(slices: [&Slice; 2], pixels: usize) -> [u64; 2] {
    let mut inside = [[false; PIXELS_READ]; 2];
    let mut only = [0; 2];
    for first in (0..pixels).step_by(PIXELS_READ) {
        let count = PIXELS_READ.min(pixels - first);
        inside.iter_mut().zip(slices).for_each(|(inside, slice)| slice.content.read(first, &mut inside[..count]));
        for (&a, &b) in inside[0].iter().zip(&inside[1]).take(count) {
            only[0] += u64::from(a & !b);
            only[1] += u64::from(b & !a);
        }
    }
    only
}

/// Length of a slice's contour by what its pixels' sides sum up to, which is `4 / pi` times as much for contours that run all ways alike.
fn perimeter(slice: &Slice, stack: &ContourStack) -> f64 {
    let ([nx, ny], [dx, dy]) = (stack.dims, stack.spacing);
    let (mut row, mut below) = (vec![false; nx], vec![false; nx]);
    let (mut across, mut along) = (0u64, 0u64);
    let mut step = |row: &[bool], below: &[bool]| {
        let ends = u64::from(row[0]) + u64::from(row[nx - 1]);
        across += ends + row.windows(2).filter(|pair| pair[0] != pair[1]).count() as u64;
        along += row.iter().zip(below).filter(|(a, b)| a != b).count() as u64;
    };
    for y in 0..ny {
        slice.content.read(y * nx, &mut row);
        step(&row, &below);
        std::mem::swap(&mut row, &mut below);
    }
    step(&vec![false; nx], &below);
    FRAC_PI_4 * (across as f64 * dy + along as f64 * dx)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Geometry, SliceContent};

    const N: usize = 64;

    fn balls(centres: &[[f64; 3]], spacing: [f64; 2], rise: f64) -> ContourStack {
        let slice = |k: usize| {
            let inside = |n: usize| {
                let x = [(n % N) as f64 * spacing[0], (n / N) as f64 * spacing[1], 4.0 * k as f64];
                centres.iter().any(|c| x.iter().zip(c).map(|(x, c)| (x - c).powi(2)).sum::<f64>() < 28.0 * 28.0)
            };
            let content = SliceContent::Mask((0..N * N).map(inside).collect());
            Slice { name: format!("k={k}"), z: rise * 4.0 * k as f64, extra: false, content }
        };
        ContourStack {
            dims: [N; 2],
            spacing,
            unit: "mm".into(),
            slices: (0..17).map(slice).collect(),
            z_out: None,
            geometry: Geometry::default(),
            known: None,
        }
    }

    #[test]
    fn a_balls_height_counts_as_its_width() {
        for spacing in [[1.0, 1.0], [1.0, 2.0], [2.0, 1.0]] {
            let stack = balls(&[[32.0, 32.0, 32.0]], spacing, 1.0);
            let ball = Change::of(&stack);
            assert!((0.75..0.95).contains(&ball.rate) && ball.relief == 0.0, "{spacing:?}: {ball:?}");
            let painted = |slice: &&Slice| (0..N * N).any(|n| slice.content.inside(n));
            let slices: Vec<Slice> = stack.slices.iter().filter(painted).cloned().collect();
            assert!(slices.len() < stack.slices.len());
            assert_eq!(Change::of(&ContourStack { slices, ..stack }).rate, ball.rate, "without the empty slices");
            let high = Change::of(&balls(&[[32.0, 32.0, 32.0]], spacing, 10.0));
            assert!((10.0 * high.rate - ball.rate).abs() < 1e-12, "{spacing:?}: {high:?}");
        }
    }

    #[test]
    fn half_a_ball_is_relief_and_a_cylinder_or_a_single_slice_has_no_rate() {
        let half = Change::of(&balls(&[[32.0, 32.0, 0.0]], [1.0; 2], 1.0));
        assert_eq!([half.relief, half.rugged], [1.0, 0.0]);
        let mut stack = balls(&[[32.0, 32.0, 32.0]], [1.0; 2], 1.0);
        let middle = stack.slices[8].content.clone();
        stack.slices.iter_mut().for_each(|slice| slice.content = middle.clone());
        assert_eq!(Change::of(&stack), Change { relief: 0.0, rugged: 0.0, rate: 0.0 });
        let empty = SliceContent::Mask((0..N * N).map(|_| false).collect());
        stack.slices.iter_mut().step_by(2).for_each(|slice| slice.content = empty.clone());
        assert_eq!(Change::of(&stack).rate, 0.0);
    }
}
