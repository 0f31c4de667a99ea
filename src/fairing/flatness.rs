//! Flatness of a layer's surface: relief between contour lines, which shows no creases and whose shape a mean along z would wash away.
//!
//! A pixel near the surface stands by itself, `1 - smoothstep((s - 3) / 5)` for a surface that goes `s` sideways per height, and among its
//! neighbours: by the mean of [`upright`] in a Gaussian window, each pixel by how near the surface it is, from 0.35 on, wholly from 0.65 on. A flat
//! place between walls, the end of a bone, shows its creases as a wall does; a plain has relief. What smoothing adds to relief lies within 2 px of
//! the contours, where their own pixels are not known better.
//!
//! Measured with strength 1.5: creases of pelvis_ts and vertebra_l3 medium over the truth's, and RMSE of Jacksboro at 12 and 8 levels.
//!
//! | means count as flat below, as upright above | creases | RMSE, m |
//! |---|---|---|
//! | 0.2, 0.6 | 1.094, 1.041 | 9.89, 15.96 |
//! | 0.3, 0.6 | | 9.87, 15.93 |
//! | 0.35, 0.65 (here) | 1.096, 1.045 | 9.83, 15.89 |
//! | 0.4, 0.7 | 1.102, 1.046 | 9.81, 15.86 |
//! | no fairing | | 9.78, 15.82 |
//!
//! [`upright`] of each pixel alone, its mean alone, and both have the creases 1.17, 1.04; 1.12, 1.06; 1.09, 1.04 and the RMSE 10.2, 16.4; 10.1, 16.2;
//! 10.1, 16.3 (with parts without partner closed in another way, so these three compare with each other only).

use glam::DVec2;
use rayon::prelude::*;

use super::near::{NearSquares, SATURATED, nearness};
use crate::grid::sparse_image::SparseImage;
use crate::grid::spline::smoothstep;
use crate::registration::displacement::{BLOCK, Displacement, smooth};
use crate::registration::value_curve::upright;

/// A pixel that goes sideways by more than this per height stands less by itself, one that goes by more than FLAT not at all.
const STEEP: f64 = 3.0;
const FLAT: f64 = 8.0;
/// Sigma of the window, px of the larger side.
const REACH: f64 = 8.0;
/// Means below this count as flat, above the other as upright.
const NONE: f64 = 0.35;
const ALL: f64 = 0.65;

/// Uprightness of a surface by itself, pixel by pixel.
pub fn alone(sideways: f64) -> f64 {
    1.0 - smoothstep((sideways - STEEP) / (FLAT - STEEP))
}

/// Uprightness of the surface of a layer around each pixel.
pub struct Around {
    /// Sums of what is upright and of all, each pixel by how near the surface it is, per block.
    sums: Displacement,
}

impl Around {
    /// Uprightness from what its surface goes sideways per height at each pixel, and its v with the squares that may be near, and its bound.
    pub fn new([sideways, v]: [&SparseImage<f32>; 2], near: &NearSquares, bound: f32, spacing: [f64; 2]) -> Self {
        let [nx, ny] = v.dims();
        let nodes = Displacement::zero([nx, ny]);
        let mut sums = nodes.clone();
        let columns = sums.grid[0];
        let add = |(row, blocks): (usize, &mut [DVec2])| {
            let [mut steep, mut own] = [vec![0.0; nx], vec![0.0; nx]];
            // Of the nodes by tents.
            let middle = nodes.centre(row * columns).y;
            let first = (middle - BLOCK as f64).max(0.0).floor() as usize;
            for j in first..((middle + BLOCK as f64).ceil() as usize).min(ny) {
                let share = (1.0 - (j as f64 - middle).abs() / BLOCK as f64).max(0.0);
                for pixels in near.of_row(v, j, SATURATED * bound, &mut own) {
                    sideways.read(pixels.start, j, &mut steep[pixels.clone()]);
                    for i in pixels {
                        let weight = nearness(own[i].abs() / bound);
                        let (before, place) = nodes.place(0, i as f64);
                        for (sums, along) in blocks[before..before + 2].iter_mut().zip([1.0 - place, place]) {
                            *sums += share * along * weight * DVec2::new(upright(f64::from(steep[i])), 1.0);
                        }
                    }
                }
            }
        };
        sums.vectors.par_chunks_mut(columns).enumerate().for_each(add);
        let side = spacing[0].max(spacing[1]);
        smooth::<2>(
            bytemuck::cast_slice_mut(&mut sums.vectors),
            sums.grid,
            spacing.map(|s| REACH * side / s / BLOCK as f64),
        );
        Around { sums }
    }

    /// Scales the values of a stretch of row `j` that begins at pixel `first`.
    pub fn scale(&self, j: usize, first: usize, values: &mut [f32]) {
        let mut some = [DVec2::ZERO; 4 * BLOCK];
        for (first, values) in (first..).step_by(some.len()).zip(values.chunks_mut(some.len())) {
            let some = &mut some[..values.len()];
            self.sums.read_row(j, first, some);
            for (value, DVec2 { x: upright, y: all }) in values.iter_mut().zip(some) {
                *value *= smoothstep((*upright / all.max(f64::MIN_POSITIVE) - NONE) / (ALL - NONE)) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 2] = [120, 100];

    fn around(layers: [&SparseImage<f32>; 2], spacing: [f64; 2]) -> Around {
        Around::new(layers, &NearSquares::new(layers[1], SATURATED), 1.0, spacing)
    }

    /// Rest of 1 at pixels of row 50 of a layer that goes sideways by `of` at each column.
    fn left(of: impl Fn(usize) -> f32, spacing: [f64; 2]) -> Vec<f32> {
        left_of([&of, &|_| 0.0], spacing)
    }

    /// Rest of 1 where v, whose bound is 1, is not 0.
    fn left_of(columns: [&dyn Fn(usize) -> f32; 2], spacing: [f64; 2]) -> Vec<f32> {
        let [sideways, v] = columns
            .map(|of| SparseImage::of(DIMS, &(0..DIMS[0] * DIMS[1]).map(|n| of(n % DIMS[0])).collect::<Vec<_>>()));
        let mut row = vec![1.0; DIMS[0] - 7];
        around([&sideways, &v], spacing).scale(50, 7, &mut row);
        row
    }

    #[test]
    fn walls_stand_and_plains_lie() {
        assert!(left(|_| 1.0, [1.0; 2]).iter().all(|v| *v == 1.0));
        assert!(left(|_| 4.5, [1.0; 2]).iter().all(|v| *v == 0.0));
        assert_eq!([2.9, 8.1].map(alone), [1.0, 0.0]);
    }

    #[test]
    fn what_is_farther_from_the_surface_counts_less_and_what_is_not_near_not_at_all() {
        // Every second column is a wall, the others a plain; v tells how near the walls are.
        let walls = |i: usize| if i.is_multiple_of(2) { 1.0 } else { 6.0 };
        let left = |v: f32| left_of([&walls, &|i| if i.is_multiple_of(2) { v } else { 0.0 }], [1.0; 2])[40];
        let values = [0.0, 0.5, 0.6, 0.7, 0.849, 0.9].map(left);
        assert!(values.is_sorted_by(|a, b| a >= b) && (0.45..0.55).contains(&values[0]), "{values:?}");
        assert!(values[3] < 0.2 && values[4] < 1e-3 && values[5] == 0.0, "{values:?}");
        assert!(left_of([&|_| 1.0, &|_| 0.9], [1.0; 2]).iter().all(|v| *v == 0.0), "nothing is near");
    }

    #[test]
    fn a_flat_place_between_walls_stands_and_a_wall_in_a_plain_lies() {
        let narrow = |i: usize| if i.abs_diff(60) < 4 { 6.0 } else { 0.5 };
        assert!(left(narrow, [1.0; 2]).iter().all(|v| *v > 0.95), "{:?}", left(narrow, [1.0; 2]));
        let opposite = |i: usize| if i.abs_diff(60) < 2 { 0.5 } else { 6.0 };
        assert!(left(opposite, [1.0; 2]).iter().all(|v| *v < 0.05), "{:?}", left(opposite, [1.0; 2]));
    }

    #[test]
    fn the_window_is_measured_in_pixels_of_the_larger_side() {
        // Half as wide pixels: the same stretch is twice as many.
        let step = |at: usize| move |i: usize| if i < at { 0.5 } else { 6.0 };
        let (square, narrow) = (left(step(40), [1.0; 2]), left(step(80), [0.5, 1.0]));
        let half = |row: &[f32]| row.iter().position(|v| *v < 0.5).expect("it falls") + 7;
        let width = |row: &[f32]| row.iter().filter(|v| **v > 0.01 && **v < 0.99).count();
        assert!(half(&square).abs_diff(half(&narrow) / 2) <= 2, "{} {}", half(&square), half(&narrow));
        assert!((1.6..2.4).contains(&(width(&narrow) as f64 / width(&square) as f64)));
    }

    #[test]
    fn a_window_reaches_along_columns_as_along_rows() {
        let left = |axis: usize| {
            let image = |of: fn(usize) -> f32| {
                let at = |n: usize| of([n % DIMS[0], n / DIMS[0]][axis]);
                SparseImage::of(DIMS, &(0..DIMS[0] * DIMS[1]).map(at).collect::<Vec<_>>())
            };
            let around = around([&image(|at| if at < 42 { 6.0 } else { 0.5 }), &image(|_| 0.0)], [1.0; 2]);
            (20..64).map(move |at| {
                let mut one = [1.0];
                let place = [[at, 50], [50, at]][axis];
                around.scale(place[1], place[0], &mut one);
                one[0]
            })
        };
        let pairs: Vec<(f32, f32)> = left(0).zip(left(1)).collect();
        assert!(pairs[0] == (0.0, 0.0) && pairs[43] == (1.0, 1.0), "{pairs:?}");
        assert!(pairs.iter().all(|(a, b)| (a - b).abs() < 1e-3), "{pairs:?}");
    }
}
