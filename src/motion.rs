//! The frame in which the two contours of an interval are compared and morphed: the mid frame of the moving field.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::contour::Seed;
use crate::contours::Contour;
use crate::field::Field;
use crate::moving_field::{MovingField, Paths, plus};

/// Pixels to each side in which a moved seed looks for its contour.
const SEARCH: usize = 2;

/// A map between the mid frame of an interval and its two slices.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// Paths through the mid frame; `None` where contours stay in the image's own frame.
    middle: Option<Paths>,
}

impl Frame {
    /// The mid frame of interval `i`.
    pub fn middle_of(moving: &MovingField, i: usize) -> Self {
        Frame { middle: Some(moving.paths(i, 0.5)) }
    }

    /// Where a position of the mid frame lies on the upper slice.
    pub fn up(&self, x: [f64; 2]) -> [f64; 2] {
        self.middle.as_ref().map_or(x, |m| plus(x, m.go.at(x), 1.0))
    }

    /// Where a position of the mid frame lies on the lower slice.
    pub fn down(&self, x: [f64; 2]) -> [f64; 2] {
        self.middle.as_ref().map_or(x, |m| plus(x, m.come.at(x), -1.0))
    }

    /// Where a position of the lower slice lies in the mid frame.
    pub fn of_low(&self, x: [f64; 2]) -> [f64; 2] {
        self.middle.as_ref().map_or(x, |m| m.off_low(x, x))
    }

    /// Where a position of the upper slice lies in the mid frame.
    pub fn of_high(&self, x: [f64; 2]) -> [f64; 2] {
        self.middle.as_ref().map_or(x, |m| m.off_high(x, x))
    }

    /// The interval's contours as the mid frame sees them, seeds under their own numbers.
    pub fn contours<'c>(&self, low: &'c Contour, high: &'c Contour) -> [Cow<'c, Contour>; 2] {
        if self.middle.is_none() {
            return [Cow::Borrowed(low), Cow::Borrowed(high)];
        }
        [moved(low, |x| self.down(x), |x| self.of_low(x)), moved(high, |x| self.up(x), |x| self.of_high(x))]
    }
}

/// A contour in another frame: `back` from there to its own slice, `forth` the other way.
fn moved(
    contour: &Contour,
    back: impl Fn([f64; 2]) -> [f64; 2] + Sync,
    forth: impl Fn([f64; 2]) -> [f64; 2] + Sync,
) -> Cow<'_, Contour> {
    if contour.solids.count == 0 {
        return Cow::Borrowed(contour);
    }
    let [nx, ny] = contour.phi.dims;
    let value = |n: usize| {
        let v = contour.phi.sample_smooth(back([(n % nx) as f64, (n / nx) as f64]));
        if v == 0.0 { f64::MIN_POSITIVE } else { v }
    };
    let phi = Field { dims: [nx, ny], data: (0..nx * ny).into_par_iter().map(value).collect() };
    let seeds = contour.seeds.iter().map(|s| seed_at(&phi, forth(s.x))).collect();
    Cow::Owned(Contour::with_seeds(contour.z, phi, seeds))
}

/// A seed at `x` with the deepest and the farthest pixel around it.
fn seed_at(phi: &Field, x: [f64; 2]) -> Seed {
    let [nx, ny] = phi.dims;
    let around = |reach: usize| {
        let range = |at: f64, n: usize| {
            let low = (at.max(0.0) as usize).min(n - 1);
            low.saturating_sub(reach)..=(low + 1 + reach).min(n - 1)
        };
        let nodes = range(x[1], ny).flat_map(move |j| range(x[0], nx).map(move |i| j * nx + i));
        nodes.fold((usize::MAX, usize::MAX), |(low, high), n| {
            let less = |a: usize, b: usize| b == usize::MAX || phi.data[a] < phi.data[b];
            let more = |a: usize, b: usize| b == usize::MAX || phi.data[a] > phi.data[b];
            (if less(n, low) { n } else { low }, if more(n, high) { n } else { high })
        })
    };
    let near = around(0);
    let crosses = |(low, high): (usize, usize)| phi.data[low] < 0.0 && phi.data[high] >= 0.0;
    let (inside, outside) = if crosses(near) { near } else { around(SEARCH) };
    Seed { x, inside, outside }
}
