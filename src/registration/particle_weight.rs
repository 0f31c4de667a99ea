//! Weight of the morph beside the field method: the share of tracker particles nearby that have arrived.
//!
//! Particles die where a piece of contour has no counterpart, and with them what the morph knows about its way. There the layers of the field
//! method, which has a slope at every pixel, take its place; and where contours are far apart, as particles travel far there and die at every bend.
//! Far from any particle the distance of the contours alone says which: in a saddle dozens of pixels wide the sweeps would make a plateau with cliffs.

use glam::DVec2;
use rayon::prelude::*;

use crate::grid::spline::smoothstep;
use crate::registration::displacement::{BLOCK, Displacement, NODES_OF_A_THREAD, smooth};
use crate::registration::motion_field::MotionField;

/// Sigma of the mean over particles, px.
const REACH: f64 = 8.0;
/// Distances of contours, px a gap: beyond the first a particle's way says less of the pixels beside it, beyond the second nothing. So
/// there is no unit of height in it. Of contours that are deeper than [`SHALLOW`] in proportion to their depth: the same body on finer pixels is the same.
///
/// Mean Dice, unfaired, of helix and gyroid every 8th slice, vertebra, thorax and pelvis medium and hard: from 2 to 6 px 0.9168, 5 to 12 0.9176,
/// 8 to 20 0.9194, no limit 0.9193; of the real ones alone 0.9221, 0.9221, 0.9216, 0.9212. Relief has its slopes from the field: Jacksboro at 8 levels,
/// RMSE in m, from 0 to 1 px 14.61, 1 to 3 14.61, 2 to 6 14.98, 4 to 12 15.51, no limit 15.58.
const LEAPS: [f64; 2] = [8.0, 20.0];
const LEAPS_OF_RELIEF: [f64; 2] = [1.0, 3.0];
/// Depth of the deeper one of two contours up to which [`LEAPS`] hold as they are, px.
///
/// Radii of balls, waves and necks on 8 gaps of 20 to 50 px, RMS in % of a gap: without proportion 0.5 to 2.1, with it 0.2 to 0.8, with no limit the same;
/// but with no limit balls of 101 bodies lose 0.0004 of Dice and have 0.07 % more volume.
const SHALLOW: f64 = 20.0;
/// Below this share of arrived particles the morph has no say, above the other it has all of it.
pub const NONE: f64 = 0.75;
/// See [`NONE`].
pub const ALL: f64 = 1.0;
/// Particles that a node has at least, all of which arrived: without any there is no doubt but that of distance.
const FEW: f64 = 1e-6;

/// Trust lacks this much of 1 where it counts as whole.
const WHOLE: f64 = 1e-6;

/// Shares of arrived particles in the frame of an interval.
#[derive(Debug, Clone)]
pub struct Trust {
    /// `(arrived, all)` per node.
    particles: Displacement,
    /// Whether the trust may be less than whole between a node and the next, column and row.
    doubtful: Vec<bool>,
}

impl Trust {
    /// The trust of interval `i` of a stack that is relief to this degree, from positions (px of the padded image) in its mid frame and whether
    /// what share of each particle has arrived.
    pub fn new(
        moving: &MotionField,
        i: usize,
        h: [f64; 2],
        relief: f64,
        particles: impl Iterator<Item = (DVec2, f64)>,
    ) -> Self {
        let (low, high) = (&moving.fields[i], &moving.fields[i + 1]);
        let mut map = Displacement::zero(low.dims);
        for (x, kept) in particles {
            for (node, share) in map.around(x) {
                map.vectors[node] += share * DVec2::new(kept, 1.0);
            }
        }
        smooth::<2>(bytemuck::cast_slice_mut(&mut map.vectors), map.grid, h.map(|side| REACH / (BLOCK as f64 * side)));
        let v = &moving.displacements[i];
        let depth = low.data.par_iter().chain(&high.data).map(|d| -d).reduce(|| SHALLOW, f64::max);
        let leaps = LEAPS.map(|px| px * depth / SHALLOW);
        let [near, far] = [0, 1].map(|k| (1.0 - relief) * leaps[k] + relief * LEAPS_OF_RELIEF[k]);
        let particles = map.map(|_, x, DVec2 { x: arrived, y: all }| {
            let half = 0.5 * v.at(x);
            let apart = low.sample(x - half) - high.sample(x + half);
            DVec2::new((arrived + FEW) * (1.0 - smoothstep((apart.abs() - near) / (far - near))), all + FEW)
        });
        let grid = particles.grid;
        let less = |k: usize| share(particles.vectors[k]) < 1.0 - WHOLE;
        let doubt = |k: usize| {
            let (right, up) =
                (usize::from(k % grid[0] + 1 < grid[0]), if k / grid[0] + 1 < grid[1] { grid[0] } else { 0 });
            [k, k + right, k + up, k + right + up].into_iter().any(less)
        };
        let doubtful = (0..grid[0] * grid[1]).into_par_iter().with_min_len(NODES_OF_A_THREAD).map(doubt).collect();
        Trust { particles, doubtful }
    }

    /// Whether there is less than whole trust anywhere from `low` to `high`. Between nodes it is at least the least of theirs.
    pub fn doubts(&self, low: DVec2, high: DVec2) -> bool {
        let grid = self.particles.grid;
        let [columns, rows] = [0, 1].map(|a| {
            let before = |x: f64| self.particles.place(a, x).0;
            before(low[a])..=before(high[a])
        });
        rows.into_iter().any(|row| columns.clone().any(|column| self.doubtful[row * grid[0] + column]))
    }

    /// Particles `(arrived, all)` per node.
    pub fn particles(&self) -> &Displacement {
        &self.particles
    }

    /// The morph's weight at `x`.
    pub fn at(&self, x: DVec2) -> f64 {
        share(self.particles.at(x))
    }
}

/// The weight for `(arrived, all)` particles.
fn share(DVec2 { x: arrived, y: all }: DVec2) -> f64 {
    smoothstep((arrived / all - NONE) / (ALL - NONE))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [80, 60];

    /// Two slices that are `apart` px from each other everywhere and do not move.
    fn slices(apart: f64) -> MotionField {
        let fields = [0.0, apart].map(|v| Arc::new(Field::filled(DIMS, v))).to_vec();
        MotionField::new(vec![0.0, 1.0], 1.0, fields, vec![Displacement::zero(DIMS)])
    }

    /// Particles on all pixels, of which `kept` have arrived.
    fn particles(kept: impl Fn(DVec2) -> f64) -> impl Iterator<Item = (DVec2, f64)> {
        let pixels = (0..DIMS[0] * DIMS[1]).map(|n| DVec2::new((n % DIMS[0]) as f64, (n / DIMS[0]) as f64));
        pixels.map(move |x| (x, kept(x)))
    }

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-4, "{a}, not {b}");
    }

    #[test]
    fn the_morph_has_the_say_that_the_arrived_particles_give_it() {
        let moving = slices(0.0);
        let middle = DVec2::new(40.3, 29.8);
        // 3 t^2 - 2 t^3 from three quarters to all.
        for (kept, weight) in [(1.0, 1.0), (0.9375, 0.84375), (0.875, 0.5), (0.8125, 0.15625), (0.75, 0.0), (0.2, 0.0)]
        {
            near(Trust::new(&moving, 0, [1.0, 1.0], 0.0, particles(|_| kept)).at(middle), weight);
        }
        // No particles, no doubt.
        let none = Trust::new(&moving, 0, [1.0, 1.0], 0.0, std::iter::empty());
        near(none.at(middle), 1.0);
        assert!(!none.doubts(DVec2::ZERO, DVec2::new(79.0, 59.0)));
        // None either where contours are far apart: there the field has all of the say.
        for apart in [-40.0, 20.0] {
            let none = Trust::new(&slices(apart), 0, [1.0, 1.0], 0.0, std::iter::empty());
            assert!(none.at(middle) == 0.0 && none.doubts(middle, middle), "{apart} px apart");
        }
        // Doubt where they die, none far from there.
        let left = Trust::new(&moving, 0, [1.0, 1.0], 0.0, particles(|x| f64::from(x.x > 8.0)));
        assert!(left.doubts(DVec2::new(0.0, 20.0), DVec2::new(6.0, 30.0)) && left.at(DVec2::new(2.0, 30.0)) < 0.1);
        assert!(
            !left.doubts(DVec2::new(70.0, 20.0), DVec2::new(76.0, 30.0)) && left.at(DVec2::new(78.0, 30.0)) > 0.999
        );
    }

    #[test]
    fn contours_far_apart_take_its_say_sooner_where_they_are_relief() {
        let middle = DVec2::new(40.0, 30.0);
        let at =
            |apart: f64, relief: f64| Trust::new(&slices(apart), 0, [1.0, 1.0], relief, particles(|_| 1.0)).at(middle);
        let wanted = |apart: f64, [first, last]: [f64; 2]| {
            share(DVec2::new(1.0 - smoothstep((apart - first) / (last - first)), 1.0))
        };
        for (apart, relief, leaps) in [
            (7.0, 0.0, LEAPS),
            (10.0, 0.0, LEAPS),
            (12.0, 0.0, LEAPS),
            (0.9, 1.0, LEAPS_OF_RELIEF),
            (1.3, 1.0, LEAPS_OF_RELIEF),
        ] {
            near(at(apart, relief), wanted(apart, leaps));
            near(at(-apart, relief), wanted(apart, leaps));
        }
        // Ten times as fine pixels.
        let (deep, shallow) = ([-200.0, -100.0], [-20.0, -10.0]);
        let of = |[low, high]: [f64; 2]| {
            let fields = [low, high].map(|v| Arc::new(Field::filled(DIMS, v))).to_vec();
            let moving = MotionField::new(vec![0.0, 1.0], 1.0, fields, vec![Displacement::zero(DIMS)]);
            Trust::new(&moving, 0, [1.0, 1.0], 0.0, particles(|_| 1.0)).at(middle)
        };
        near(of(deep), of(shallow));
        assert!(of(shallow) > 0.0 && of(shallow) < 1.0);
        assert!(at(7.0, 0.0) > 0.999 && at(12.0, 0.0) < 0.1 && at(7.0, 1.0) == 0.0);
        near(at(5.5, 0.5), wanted(5.5, [4.5, 11.5]));
    }
}
