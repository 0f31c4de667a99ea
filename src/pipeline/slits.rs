//! Slits that move: parts that overlap across one as they are drawn, and that motion takes apart.
//!
//! Where a slit between two parts moves by more than its width from slice to slice, what lies to its left on one slice overlaps what lies to its right on the
//! other by a sliver. Held together like all that overlaps ([`cores`](crate::connectivity::cores)), both sides would be one all along the slit. So
//! a part below and one above are kept apart where what they have in common as drawn is long and thin, and less than what each has in common with
//! another one, where motion brings most of each over that one, and leaves less than half of the sliver, half as deep or of the depth of noise.
//!
//! Measured: discs cut through by a slit of 2 px that moves by 4 px a gap; Dice of the slit between slices 0.54 before, 0.99 with it, as it has in a body
//! that goes around it.

use std::collections::BTreeMap;
use std::mem::replace;

use glam::DVec2;

use super::leaps::is_compact;
use crate::contour::Contour;
use crate::grid::field::position;
use crate::registration::displacement::Displacement;

/// Depth in both parts that noise of contours makes, px.
const NOISE: f64 = 1.0;
/// Most of a part is more than this share of it, and what motion leaves of a sliver is less.
const HALF: f64 = 0.5;

/// Pairs of overlapping parts that motion takes apart; `at_slices` is the displacement read at both slices.
pub(super) fn taken_apart([low, high]: [&Contour; 2], at_slices: &[Displacement; 2], h: [f64; 2]) -> Vec<(u32, u32)> {
    let drawn = Brought::new(low, high, |x| x);
    // Where little overlaps, and as wide as long, it does not matter that it is held together.
    let is_long = |pair: &(u32, u32)| {
        let Meeting { pixels, depth } = drawn.meeting(*pair);
        !is_compact(pixels, depth, h)
    };
    let crossed: Vec<(u32, u32)> = drawn.crossed().filter(is_long).collect();
    if crossed.is_empty() {
        return crossed;
    }
    let up = Brought::new(low, high, |x| x + at_slices[0].at(x));
    let down = Brought::new(high, low, |x| x - at_slices[1].at(x));
    let apart = |&(a, b): &(u32, u32)| {
        let (Some(c), Some(d)) = (up.most(a), down.most(b)) else { return false };
        let common = drawn.meeting((a, b));
        let least = drawn.meeting((a, c)).pixels.min(drawn.meeting((d, b)).pixels);
        let is_sliver = common.pixels < least;
        let gone = |left: Meeting| {
            (left.pixels as f64) < HALF * common.pixels as f64 && left.depth <= (HALF * common.depth).max(NOISE)
        };
        c != b && d != a && is_sliver && gone(up.meeting((a, b))) && gone(down.meeting((b, a)))
    };
    crossed.into_iter().filter(apart).collect()
}

/// What two parts have in common.
#[derive(Debug, Clone, Copy, Default)]
struct Meeting {
    /// Pixels of one of them.
    pixels: usize,
    /// How deep in both these lie at most, px.
    depth: f64,
}

/// Meetings of the parts of a contour with those of another one, over which they are brought.
struct Brought {
    /// Pixels of each part, by number.
    pixels: Vec<usize>,
    met: BTreeMap<(u32, u32), Meeting>,
}

impl Brought {
    fn new(own: &Contour, other: &Contour, to: impl Fn(DVec2) -> DVec2) -> Self {
        let [nx, ny] = own.phi.dims;
        let mut found = Brought { pixels: vec![0; own.solids.count + 1], met: BTreeMap::new() };
        // Pixels of a row mostly belong to the pair of the one before.
        let mut last = ((0, 0), Meeting::default());
        for (n, &part) in own.solids.labels.iter().enumerate().filter(|(_, part)| **part > 0) {
            found.pixels[part as usize] += 1;
            let DVec2 { x: i, y: j } = to(position(n, nx)).round();
            if i < 0.0 || j < 0.0 || i >= nx as f64 || j >= ny as f64 {
                continue;
            }
            let there = j as usize * nx + i as usize;
            let met = other.solids.labels[there];
            if met == 0 {
                continue;
            }
            if last.0 != (part, met) {
                found.add(replace(&mut last, ((part, met), Meeting::default())));
            }
            last.1.pixels += 1;
            last.1.depth = last.1.depth.max(-own.phi.data[n].max(other.phi.data[there]));
        }
        found.add(last);
        found
    }

    fn add(&mut self, (pair, more): ((u32, u32), Meeting)) {
        if more.pixels > 0 {
            let meeting = self.met.entry(pair).or_default();
            meeting.pixels += more.pixels;
            meeting.depth = meeting.depth.max(more.depth);
        }
    }

    /// Pairs of which each part meets another one, too.
    fn crossed(&self) -> impl Iterator<Item = (u32, u32)> {
        let mut met_by: BTreeMap<u32, usize> = BTreeMap::new();
        self.met.keys().for_each(|(_, met)| *met_by.entry(*met).or_default() += 1);
        self.met.keys().copied().filter(move |(a, b)| met_by[b] > 1 && self.of(*a).nth(1).is_some())
    }

    /// Parts that this one meets.
    fn of(&self, part: u32) -> impl Iterator<Item = (u32, Meeting)> {
        self.met.range((part, 0)..=(part, u32::MAX)).map(|((_, met), meeting)| (*met, *meeting))
    }

    /// The part over which most of this one comes.
    fn most(&self, part: u32) -> Option<u32> {
        let least = HALF * self.pixels[part as usize] as f64;
        self.of(part).find(|(_, meeting)| meeting.pixels as f64 > least).map(|(met, _)| met)
    }

    fn meeting(&self, pair: (u32, u32)) -> Meeting {
        self.met.get(&pair).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [60, 50];

    /// Two bars of this height, a slit of 2 px between them that begins at x.
    fn bars(x: f64, height: f64) -> Contour {
        let value = |i: usize, j: usize| {
            let [i, j] = [i as f64 + 0.5, j as f64 + 0.5];
            let slit = 1.0 - (i - x - 1.0).abs();
            slit.max((i - 30.0).abs() - 25.0).max((j - 25.0).abs() - 0.5 * height)
        };
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    /// What motion by `v` px a gap to the right takes apart, of a slit that moves by 4 px.
    fn apart(height: f64, v: f64) -> Vec<(u32, u32)> {
        let moved = Displacement::zero(DIMS).map(|_, _, _| DVec2::new(v, 0.0));
        taken_apart([&bars(24.0, height), &bars(28.0, height)], &[moved.clone(), moved], [1.0; 2])
    }

    #[test]
    fn a_sliver_is_apart_if_motion_says_so_and_it_is_long() {
        assert_eq!(apart(40.0, 4.0), [(2, 1)], "the right one below and the left one above");
        assert_eq!(apart(40.0, 0.0), [], "nothing moves");
        assert_eq!(apart(4.0, 4.0), [], "as wide as long");
    }
}
