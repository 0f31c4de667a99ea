//! Tails of an interval, and which of them slide.

use rayon::prelude::*;

use super::tail::{AROUND, Beside, RIM, Tail};
use crate::contour::Contour;
use crate::grid::field::{FAR, cell, position};
use crate::grid::tile::samples;
use crate::registration::displacement::Displacement;

/// How many times as long as the other one of two tails may be. Coils of pitch 12 and 16, every 5th and 6th slice: Dice .922 and .913 with 1.5,
/// .931 and .925 with 2, .934 and .925 with 4.
const ALIKE: f64 = 2.0;
/// Share of a part that its tail and what is common have at least: with half of a part a gyroid that changes too fast for its slices loses .005.
const WHOLE: f64 = 0.8;

/// A tail, and the parts of the lower and upper slice that have it in common.
pub(super) struct Found {
    pub pair: [u32; 2],
    pub tail: Tail,
}

/// Tails of the lower slice of an interval and of its upper one, that slide if others say so.
#[derive(Default)]
pub(super) struct Candidates {
    pub tails: [Vec<Found>; 2],
    /// Height of the interval.
    gap: f64,
    /// Pixel sides.
    pub h: [f64; 2],
}

impl Candidates {
    /// Those of two slices, but of the pairs of parts that are kept `apart`; `at_slices` is the displacement read at both.
    pub fn new(
        [low, high]: [&Contour; 2],
        at_slices: &[Displacement; 2],
        gap: f64,
        apart: &[(u32, u32)],
        h: [f64; 2],
    ) -> Self {
        let (lower, mut upper) =
            rayon::join(|| found(low, high, (&at_slices[0], 1.0), h), || found(high, low, (&at_slices[1], -1.0), h));
        upper.iter_mut().for_each(|found| found.pair.reverse());
        let mut tails = [lower, upper];
        tails.iter_mut().for_each(|tails| tails.retain(|found| !apart.contains(&found.pair.into())));
        Candidates { tails, gap, h }
    }

    pub fn is_empty(&self) -> bool {
        self.tails.iter().all(Vec::is_empty)
    }

    /// Those of the lower or upper slice that slide, as the intervals `beyond` it say, the nearest first.
    pub fn sliding(&self, side: usize, beyond: &[&Candidates]) -> Vec<&Found> {
        self.tails[side].iter().filter(|one| self.goes(side, one, beyond)).collect()
    }

    /// Whether the part of a tail of the lower or upper slice loses, or gains, one about as long at its other end.
    fn slides(&self, side: usize, one: &Found) -> bool {
        let alike = |other: &Found| other.pair == one.pair && alike(one.tail.length, other.tail.length);
        self.tails[1 - side].iter().any(alike)
    }

    /// Whether `one`, a tail of the lower or upper slice, slides: by itself, or because what it becomes does in the intervals `beyond` that slice, the
    /// nearest first.
    fn goes(&self, side: usize, one: &Found, beyond: &[&Candidates]) -> bool {
        self.slides(side, one)
            || beyond.split_first().is_some_and(|(next, beyond)| {
                let mut on = next.tails[side].iter().filter(|on| {
                    on.pair[1 - side] == one.pair[side]
                        && alike(on.tail.length / next.gap, one.tail.length / self.gap)
                        && self.apart(on.tail.root, one.tail.tip) < self.apart(on.tail.root, one.tail.root)
                });
                on.any(|on| next.goes(side, on, beyond))
            })
    }

    /// Distance of two pixels, px.
    fn apart(&self, a: [usize; 2], b: [usize; 2]) -> f64 {
        let [x, y] = [0, 1].map(|k| self.h[k] * a[k].abs_diff(b[k]) as f64);
        libm::hypot(x, y)
    }
}

/// Whether of two lengths neither is more than [`ALIKE`] times as large as the other.
fn alike(a: f64, b: f64) -> bool {
    a.max(b) <= ALIKE * a.min(b)
}

/// Tails of the parts of a slice beside another one, to which motion brings it, with the numbers of its own part and of that over which it begins.
fn found(own: &Contour, other: &Contour, (to, sign): (&Displacement, f64), h: [f64; 2]) -> Vec<Found> {
    let nx = own.phi.dims[0];
    let there = |n: usize| {
        let x = position(n, nx);
        x + sign * to.at(x)
    };
    let mut far = vec![false; own.solids.count + 1];
    let reach = to.largest() * std::f64::consts::SQRT_2;
    for (n, part) in own.solids.labels.iter().enumerate().filter(|(_, part)| **part > 0) {
        if !far[*part as usize] && other.phi.data[n] > RIM - reach {
            far[*part as usize] = other.phi.sample(there(n)) > RIM;
        }
    }
    let margin = samples(AROUND, h).map(|n| n.max(AROUND) + 1);
    let parts: Vec<u32> = (1..=own.solids.count as u32).filter(|part| far[*part as usize]).collect();
    let by_depth = |a: &usize, b: &usize| other.phi.data[*a].total_cmp(&other.phi.data[*b]);
    let of_part = |part: u32| {
        let tile = own.tile_of(&[part], margin);
        let other_at = |n: usize| other.phi.sample(there(n));
        let mine = tile.map(&own.solids.labels, nx, |label| *label == part);
        let on_part = tile.nodes(nx).zip(&mine).map(|(n, mine)| if *mine { other_at(n) } else { FAR });
        let beside = Beside { tile, h, own: tile.cut(&own.phi), other: on_part.collect(), part: mine };
        let around = |n: usize| {
            let [i, j] = [n % tile.dims[0], n / tile.dims[0]];
            other_at((tile.origin[1] + j) * nx + tile.origin[0] + i)
        };
        let over = |tail: Tail| {
            // What is common lies inside, so that at least one of the pixels around it does.
            let ([i, j], _) = cell(other.phi.dims, there(tail.root[1] * nx + tail.root[0]), 0);
            let n = j * nx + i;
            let deepest = [n, n + 1, n + nx, n + nx + 1].into_iter().min_by(by_depth)?;
            Some(Found { pair: [part, other.solids.labels[deepest]], tail })
        };
        beside.tails(WHOLE, around).into_iter().filter_map(over).collect::<Vec<_>>()
    };
    // Whoever makes the layers waits for this.
    parts.into_par_iter().flat_map_iter(of_part).collect()
}
