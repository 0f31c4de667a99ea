//! Where a morph knows what it does: how many of the tracker particles nearby have arrived.
//!
//! Particles die where a piece of contour has no counterpart, and with them what the morph knows about its way. There the layers of the field
//! method, which has a slope at every pixel, take its place; and where the surface lies flat, as particles travel far there and die at every bend.

use crate::displacement::{BLOCK, Displacement, smooth};
use crate::moving_field::{MovingField, plus, upright};
use crate::spline::smoothstep;

/// Sigma of the mean over particles, px.
const REACH: f64 = 8.0;
/// Below this share of arrived particles the morph has no say, above the other it has all of it.
const NONE: f64 = 0.75;
const ALL: f64 = 1.0;
/// Particles in a block that count as none.
const FEW: f64 = 1e-6;

/// Shares of arrived particles in the frame of an interval.
pub struct Trust {
    /// `[arrived, all]` per block.
    particles: Displacement,
}

impl Trust {
    /// For interval `i` from positions (px of the padded image) in its mid frame and whether each particle has arrived.
    pub fn new(moving: &MovingField, i: usize, particles: impl Iterator<Item = ([f64; 2], bool)>) -> Self {
        let (low, high) = (&moving.fields[i], &moving.fields[i + 1]);
        let mut map = Displacement::zero(low.dims);
        for (x, arrived) in particles {
            let block: [usize; 2] = std::array::from_fn(|a| ((x[a].max(0.0) as usize) / BLOCK).min(map.grid[a] - 1));
            let [good, all] = &mut map.vectors[block[1] * map.grid[0] + block[0]];
            *good += f64::from(u8::from(arrived));
            *all += 1.0;
        }
        smooth(&mut map.vectors, map.grid, [REACH / BLOCK as f64; 2]);
        let gap = moving.gap(i) / moving.px;
        let v = &moving.displacements[i];
        let particles = map.map(|x, [good, all]| {
            let half = v.at(x).map(|c| 0.5 * c);
            let apart = low.sample(plus(x, half, -1.0)) - high.sample(plus(x, half, 1.0));
            [good * upright(apart.abs() / gap), all]
        });
        Trust { particles }
    }

    /// The morph's weight at `x`.
    pub fn at(&self, x: [f64; 2]) -> f64 {
        let [good, all] = self.particles.at(x);
        smoothstep(((good + FEW) / (all + FEW) - NONE) / (ALL - NONE))
    }
}
