//! Flatness of a layer's surface: relief between contour lines, which shows no creases and whose shape a mean along z would wash away.
//!
//! A pixel near the surface stands by itself, `1 - smoothstep((s - 3) / 5)` for a surface that goes `s` sideways per height, and among its
//! neighbours: by the mean of [`upright`] in a Gaussian window, each pixel by how near the surface it is, from .35 on, wholly from .65 on. A flat
//! place between walls, the end of a bone, shows its creases as a wall does; a plain has relief. Measured with strength 1.5 (crease of
//! pelvis_ts and vertebra_l3 medium over the truth's; RMSE of Jacksboro at 12 and 8 levels, m): [`upright`] of each pixel alone 1.17, 1.04;
//! 10.2, 16.4. Its mean alone 1.12, 1.06; 10.1, 16.2. Both as here 1.09, 1.04; 10.1, 16.3. Each pixel alone from 3 to 8: 1.09, .99; at
//! strength 1 10.4, 16.7. These before parts without partner closed as they do and near pixels counted more, with means from .2 to .6: with them
//! since then 1.094, 1.041; 9.89, 15.96; from .3 to .6 9.87, 15.93; as here 1.096, 1.045; 9.83, 15.89; from .4 to .7 1.102, 1.046; 9.81, 15.86
//! (without fairing 9.78, 15.82). What smoothing adds there lies within 2 px of the contours, where their own pixels are not known better.

use rayon::prelude::*;

use super::fairing_near::{SATURATED, nearer, nearness};
use crate::grid::spline::smoothstep;
use crate::grid::tiled::Packed;
use crate::registration::displacement::{BLOCK, Displacement, smooth};
use crate::registration::motion_field::upright;

/// A pixel that goes sideways by more than this per height stands less by itself, one that goes by more than FLAT not at all.
pub const STEEP: f64 = 3.0;
pub const FLAT: f64 = 8.0;
/// Sigma of the window, px of the larger side.
pub const REACH: f64 = 8.0;
/// Means below this count as flat, above the other as upright.
pub const NONE: f64 = 0.35;
pub const ALL: f64 = 0.65;

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
    /// Uprightness from what its surface goes sideways per height at each pixel, and its v with its bound.
    pub fn new([sideways, v]: [&Packed<f32>; 2], bound: f32, spacing: [f64; 2]) -> Self {
        let [nx, ny] = v.dims();
        let nodes = Displacement::zero([nx, ny]);
        let mut sums = nodes.clone();
        let columns = sums.grid[0];
        let add = |(row, blocks): (usize, &mut [[f64; 2]])| {
            let [mut steep, mut own] = [vec![0.0; nx], vec![0.0; nx]];
            // Of the nodes by tents.
            let middle = nodes.centre(row * columns)[1];
            let first = (middle - BLOCK as f64).max(0.0).floor() as usize;
            for j in first..((middle + BLOCK as f64).ceil() as usize).min(ny) {
                let share = (1.0 - (j as f64 - middle).abs() / BLOCK as f64).max(0.0);
                v.read(0, j, &mut own);
                for pixels in nearer(&own, SATURATED * bound) {
                    sideways.read(pixels.start, j, &mut steep[pixels.clone()]);
                    for i in pixels {
                        let weight = nearness(own[i].abs() / bound);
                        let (before, place) = nodes.place(0, i as f64);
                        for ([stands, all], along) in blocks[before..before + 2].iter_mut().zip([1.0 - place, place]) {
                            *stands += share * along * weight * upright(f64::from(steep[i]));
                            *all += share * along * weight;
                        }
                    }
                }
            }
        };
        sums.vectors.par_chunks_mut(columns).enumerate().for_each(add);
        let side = spacing[0].max(spacing[1]);
        smooth(&mut sums.vectors, sums.grid, spacing.map(|s| REACH * side / s / BLOCK as f64));
        Around { sums }
    }

    /// Scales the values of a stretch of row `j` that begins at pixel `first`.
    pub fn scale(&self, j: usize, first: usize, values: &mut [f32]) {
        let mut some = [[0.0; 2]; 4 * BLOCK];
        for (first, values) in (first..).step_by(some.len()).zip(values.chunks_mut(some.len())) {
            let some = &mut some[..values.len()];
            self.sums.read_row(j, first, some);
            for (value, [stands, all]) in values.iter_mut().zip(some) {
                *value *= smoothstep((*stands / all.max(f64::MIN_POSITIVE) - NONE) / (ALL - NONE)) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 2] = [120, 100];

    /// Rest of 1 at pixels of row 50 of a layer that goes sideways by `of` at each column.
    fn left(of: impl Fn(usize) -> f32, spacing: [f64; 2]) -> Vec<f32> {
        left_of([&of, &|_| 0.0], spacing)
    }

    /// Rest of 1 where v, whose bound is 1, is not 0.
    fn left_of(columns: [&dyn Fn(usize) -> f32; 2], spacing: [f64; 2]) -> Vec<f32> {
        let [sideways, v] =
            columns.map(|of| Packed::of(DIMS, &(0..DIMS[0] * DIMS[1]).map(|n| of(n % DIMS[0])).collect::<Vec<_>>()));
        let mut row = vec![1.0; DIMS[0] - 7];
        Around::new([&sideways, &v], 1.0, spacing).scale(50, 7, &mut row);
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
}
