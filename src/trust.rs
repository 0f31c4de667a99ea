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

/// Trust lacks this much of 1 where it counts as whole.
const WHOLE: f64 = 1e-6;

/// Shares of arrived particles in the frame of an interval.
pub struct Trust {
    /// `[arrived, all]` per block.
    particles: Displacement,
    /// Whether the trust may be less than whole between a block and the next, column and row.
    doubtful: Vec<bool>,
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
        let particles = map.map(|_, x, [good, all]| {
            let half = v.at(x).map(|c| 0.5 * c);
            let apart = low.sample(plus(x, half, -1.0)) - high.sample(plus(x, half, 1.0));
            [good * upright(apart.abs() / gap), all]
        });
        let grid = particles.grid;
        let less = |k: usize| share(particles.vectors[k]) < 1.0 - WHOLE;
        let doubt = |k: usize| {
            let (right, up) =
                (usize::from(k % grid[0] + 1 < grid[0]), if k / grid[0] + 1 < grid[1] { grid[0] } else { 0 });
            [k, k + right, k + up, k + right + up].into_iter().any(less)
        };
        let doubtful = (0..grid[0] * grid[1]).map(doubt).collect();
        Trust { particles, doubtful }
    }

    /// Whether there is less than whole trust anywhere from `low` to `high`. Between blocks it is at least the least of theirs.
    pub fn doubts(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        let grid = self.particles.grid;
        let [columns, rows] = [0, 1].map(|a| {
            let block = |x: f64| (((x - 0.5 * (BLOCK - 1) as f64) / BLOCK as f64).max(0.0) as usize).min(grid[a] - 1);
            block(low[a])..=block(high[a])
        });
        rows.into_iter().any(|row| columns.clone().any(|column| self.doubtful[row * grid[0] + column]))
    }

    /// The morph's weight at `x`.
    pub fn at(&self, x: [f64; 2]) -> f64 {
        share(self.particles.at(x))
    }
}

/// The weight for `[arrived, all]` particles.
fn share([good, all]: [f64; 2]) -> f64 {
    smoothstep(((good + FEW) / (all + FEW) - NONE) / (ALL - NONE))
}
