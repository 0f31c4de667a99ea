//! The frame in which the two contours of an interval are compared and morphed: the mid frame of the moving field.

use std::borrow::Cow;

use glam::DVec2;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::contour::Contour;
use crate::contour::seeds::Seed;
use crate::grid::field::{Field, READ_AT_ONCE, sample_smooth_lanes};
use crate::grid::tile::samples;
use crate::registration::displacement::Displacement;
use crate::registration::motion_field::{MotionField, PASSES, Paths};

/// Distance to each side in which a moved seed looks for its contour, px.
const SEARCH: usize = 2;

/// A map between the mid frame of an interval and its two slices.
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// Paths through the mid frame; `None` where contours stay in the image's own frame.
    middle: Option<Paths>,
}

impl Frame {
    /// The mid frame of interval `i`.
    pub fn middle_of(moving: &MotionField, i: usize) -> Self {
        Frame { middle: Some(moving.paths(i, 0.5)) }
    }

    /// Place on the upper slice of a position of the mid frame.
    pub fn up(&self, x: DVec2) -> DVec2 {
        self.middle.as_ref().map_or(x, |m| x + m.go.at(x))
    }

    /// Place on the lower slice of a position of the mid frame.
    pub fn down(&self, x: DVec2) -> DVec2 {
        self.middle.as_ref().map_or(x, |m| x - m.come.at(x))
    }

    /// Place in the mid frame of a position of the lower slice.
    pub fn of_low(&self, x: DVec2) -> DVec2 {
        self.middle.as_ref().map_or(x, |m| m.off_low(x, x, PASSES))
    }

    /// Place in the mid frame of a position of the upper slice.
    pub fn of_high(&self, x: DVec2) -> DVec2 {
        self.middle.as_ref().map_or(x, |m| m.off_high(x, x, PASSES))
    }

    /// The interval's contours as the mid frame sees them, seeds under their own numbers.
    pub fn contours<'c>(&self, low: &'c Contour, high: &'c Contour, h: [f64; 2]) -> [Cow<'c, Contour>; 2] {
        let Some(Paths { come, go }) = &self.middle else {
            return [Cow::Borrowed(low), Cow::Borrowed(high)];
        };
        let search = samples(SEARCH, h);
        [moved(low, (come, -1.0), search, |x| self.of_low(x)), moved(high, (go, 1.0), search, |x| self.of_high(x))]
    }
}

/// A contour in another frame: from a position there to that on its own slice it is `back` with its sign, the other way `forth`.
fn moved<'c>(
    contour: &'c Contour,
    back: (&Displacement, f64),
    search: [usize; 2],
    forth: impl Fn(DVec2) -> DVec2,
) -> Cow<'c, Contour> {
    if contour.solids.count == 0 {
        return Cow::Borrowed(contour);
    }
    let [nx, _] = contour.phi.dims;
    let mut phi = Field::filled(contour.phi.dims, 0.0);
    let row = |ways: &mut Vec<DVec2>, (j, row): (usize, &mut [f64])| {
        ways.resize(nx, DVec2::ZERO);
        back.0.read_row(j, 0, ways);
        moved_row(&contour.phi, (ways, back.1), j, row);
    };
    phi.data.par_chunks_mut(nx).enumerate().for_each_init(Vec::new, row);
    let seeds = contour.seeds.iter().map(|s| seed_at(&phi, search, forth(s.x))).collect();
    Cow::Owned(Contour::with_seeds(contour.z, phi, seeds))
}

/// Row `j` of a field, each pixel read from where its way with this sign leads; never 0.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn moved_row(phi: &Field, (ways, sign): (&[DVec2], f64), j: usize, row: &mut [f64]) {
    for (part, (out, ways)) in row.chunks_mut(READ_AT_ONCE).zip(ways.chunks(READ_AT_ONCE)).enumerate() {
        let mut some = [DVec2::ZERO; READ_AT_ONCE];
        some[..ways.len()].copy_from_slice(ways);
        let mut x = [[0.0; READ_AT_ONCE]; 2];
        for k in 0..READ_AT_ONCE {
            x[0][k] = (part * READ_AT_ONCE + k) as f64 + sign * some[k].x;
            x[1][k] = j as f64 + sign * some[k].y;
        }
        let mut read = sample_smooth_lanes(phi, &x);
        for v in &mut read {
            *v = if *v == 0.0 { f64::MIN_POSITIVE } else { *v };
        }
        out.copy_from_slice(&read[..out.len()]);
    }
}

/// A seed at `x` with the deepest and the farthest pixel around it.
fn seed_at(phi: &Field, search: [usize; 2], x: DVec2) -> Seed {
    let [nx, ny] = phi.dims;
    let around = |[across, along]: [usize; 2]| {
        let range = |at: f64, n: usize, reach: usize| {
            let low = (at.max(0.0) as usize).min(n - 1);
            low.saturating_sub(reach)..=(low + 1 + reach).min(n - 1)
        };
        let nodes = range(x.y, ny, along).flat_map(move |j| range(x.x, nx, across).map(move |i| j * nx + i));
        nodes.fold((usize::MAX, usize::MAX), |(low, high), n| {
            let less = |a: usize, b: usize| b == usize::MAX || phi.data[a] < phi.data[b];
            let more = |a: usize, b: usize| b == usize::MAX || phi.data[a] > phi.data[b];
            (if less(n, low) { n } else { low }, if more(n, high) { n } else { high })
        })
    };
    let near = around([0; 2]);
    let crosses = |(low, high): (usize, usize)| phi.data[low] < 0.0 && phi.data[high] >= 0.0;
    let (inside, outside) = if crosses(near) { near } else { around(search) };
    Seed { x, inside, outside }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moved_field_is_nowhere_0() {
        let (still, mut row) = ([DVec2::ZERO; 8], [1.0; 8]);
        moved_row(&Field::filled([8; 2], 0.0), (&still, 1.0), 3, &mut row);
        assert_eq!(row, [f64::MIN_POSITIVE; 8]);
        moved_row(&Field::from_fn([8; 2], |i, _| i as f64 - 3.5), (&[DVec2::X; 8], -1.0), 3, &mut row);
        assert_eq!(row[2..6], [-2.5, -1.5, -0.5, 0.5]);
    }
}
