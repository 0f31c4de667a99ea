//! Ruggedness: how much longer the contours of a stack are than smooth ones of their size.
//!
//! Along pixels' sides a convex line is as long as its bounding box is around, whatever its size and its pixels. Lines that wind in and out are longer:
//! `q = sum P / sum 2 (w + h)`, P the sides between a pixel inside and one outside, w and h the columns and rows of each part and of each hole. It is
//! 1 for discs and ellipses, 1.04 to 1.29 in anatomy, 1.06 to 1.17 for maps of smooth hills and cones with gullies, 1.2 to 1.7 for
//! made terrain with noise of all lengths, and 1.9 for a real one.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::mask::Mask;
use crate::grid::components::parts_of_runs;
use crate::grid::spline::smoothstep;
use crate::stack::{ContourStack, Slice};

/// Below this lines are smooth, above the other rugged.
const SMOOTH: f64 = 1.1;
const RUGGED: f64 = 1.25;

/// Degree to which the contours of a stack are rugged, 0 to 1.
pub fn ruggedness(stack: &ContourStack) -> f64 {
    let of = |slice: &Slice| winding(slice.content.mask(), stack.dims);
    let (sides, around) = stack.slices.par_iter().map(of).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    smoothstep((sides as f64 / around.max(1) as f64 - SMOOTH) / (RUGGED - SMOOTH))
}

/// Sides of pixels along the lines of a mask, but not along the image's border, and those around the boxes of all parts and holes.
fn winding(mask: &Mask, dims: [usize; 2]) -> (usize, usize) {
    let parts: usize = boxes(mask.rows(dims[0]).collect(), dims[0], false).iter().map(around).sum();
    let holes = boxes(mask.rows_outside(dims[0]).collect(), dims[0], true);
    let open = |[columns, rows]: &&[Range<usize>; 2]| {
        columns.start > 0 && rows.start > 0 && columns.end < dims[0] && rows.end < dims[1]
    };
    (mask.inner_sides(dims[0]), parts + holes.iter().filter(open).map(around).sum::<usize>())
}

fn around([columns, rows]: &[Range<usize>; 2]) -> usize {
    2 * (columns.len() + rows.len())
}

/// Columns and rows of the parts of these runs.
fn boxes(runs: Vec<Range<usize>>, nx: usize, corners: bool) -> Vec<[Range<usize>; 2]> {
    let mut boxes: BTreeMap<usize, [Range<usize>; 2]> = BTreeMap::new();
    for (part, run) in parts_of_runs(runs.iter().cloned(), nx, corners).into_iter().zip(runs) {
        let (first, row) = (run.start % nx, run.start / nx);
        let here = [first..first + run.len(), row..row + 1];
        let whole = boxes.entry(part).or_insert_with(|| here.clone());
        whole.iter_mut().zip(here).for_each(|(whole, here)| {
            *whole = whole.start.min(here.start)..whole.end.max(here.end);
        });
    }
    boxes.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 96;

    fn winding_of(inside: impl Fn(f64, f64) -> bool) -> f64 {
        let mask: Mask = (0..N * N).map(|n| inside((n % N) as f64 - 47.3, (n / N) as f64 - 48.1)).collect();
        let (sides, around) = winding(&mask, [N; 2]);
        sides as f64 / around as f64
    }

    #[test]
    fn convex_lines_are_as_long_as_their_boxes_are_around() {
        for scale in [1.0, 3.0, 8.0] {
            assert_eq!(winding_of(|x, y| x.hypot(0.9 * y) < 5.0 * scale), 1.0);
            assert_eq!(winding_of(|x, y| (3.0..5.0).contains(&(x.hypot(y) / scale))), 1.0, "a ring");
        }
        assert_eq!(winding_of(|x, y| (x.abs() - 20.0).hypot(y) < 9.0), 1.0, "two discs");
    }

    #[test]
    fn lines_that_wind_are_longer_whatever_their_pixels() {
        let star = |scale: f64| winding_of(|x, y| x.hypot(y) < scale * (1.0 + 0.3 * (9.0 * y.atan2(x)).cos()));
        let (small, large) = (star(12.0), star(34.0));
        assert!(small > 1.4 && (large / small - 1.0).abs() < 0.1, "{small} {large}");
    }

    #[test]
    fn what_the_images_border_cuts_is_not_along_a_line() {
        let half: Mask = (0..N * N).map(|n| n % N < 40).collect();
        assert_eq!(winding(&half, [N; 2]), (N, 2 * (40 + N)));
        let all: Mask = (0..N * N).map(|_| true).collect();
        assert_eq!(winding(&all, [N; 2]), (0, 4 * N));
        assert_eq!(winding(&Mask::default(), [N; 2]), (0, 0));
    }
}
