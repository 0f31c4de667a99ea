//! Sections of hollow tubes.
//!
//! Of a hollow tube that lies nearly in the slices a section is a ring whose wall at either end lies amid the hole of the next section. No part of it is a tail
//! beyond what both have in common; but filled it is a section that slides, and so is its hole. Where both do the layer is the one less the other.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec2;

use super::super::hollow::slice::HollowSlice;
use super::candidates::{Candidates, Found};
use super::tail::{AROUND, RIM, Tail, read};
use crate::backend::jobs::PartJob;
use crate::contour::Contour;
use crate::grid::components::Components;
use crate::grid::field::{FAR, Field, cell, position};
use crate::grid::tile::{Tile, samples};
use crate::reference::part::part_field;
use crate::registration::displacement::Displacement;

/// The filled parts of slice `contour` as a contour.
fn filled(contour: &Contour, slice: &HollowSlice, h: [f64; 2]) -> Contour {
    let inside = slice.filled.labels.iter().map(|part| *part > 0).collect();
    let phi = part_field(&PartJob { whole: contour.phi.clone(), inside }, h);
    let (solids, solid_box) = (slice.filled.clone(), contour.solid_box.clone());
    Contour { z: contour.z, phi, solids, solid_box, ..Contour::default() }
}

/// The holes of slice `contour` as a contour, by its `filled` parts.
fn holes(contour: &Contour, slice: &HollowSlice, filled: &Contour) -> Contour {
    let data = filled.phi.data.iter().zip(&contour.phi.data).map(|(filled, own)| filled.max(-own)).collect();
    let phi = Field { dims: contour.phi.dims, data };
    let (solids, solid_box) = (slice.holes.clone(), slice.hole_box.clone());
    Contour { z: contour.z, phi, solids, solid_box, ..Contour::default() }
}

/// Distances of one of the `holes` on a tile around it.
fn hole(holes: &Contour, hole: u32, h: [f64; 2]) -> (Tile, Field) {
    let Contour { phi, solids, .. } = holes;
    let tile = holes.tile_of(&[hole], samples(AROUND, h).map(|n| n.max(AROUND)));
    let value = |n: usize| if solids.labels[n] == hole { phi.data[n] } else { phi.data[n].abs() };
    (tile, Field { dims: tile.dims, data: tile.nodes(phi.dims[0]).map(value).collect() })
}

/// Filled parts of slices, which two intervals ask for: those of the slice that was asked for last stay where memory is not bounded.
#[derive(Default)]
pub(super) struct FilledSlices {
    last: Option<(usize, Arc<Contour>)>,
    forgets: bool,
}

impl FilledSlices {
    pub fn new(forgets: bool) -> Self {
        FilledSlices { last: None, forgets }
    }

    /// Those of two slices, of which `first` is the number of the lower one.
    fn both(
        &mut self,
        first: usize,
        contours: [&Contour; 2],
        slices: [&HollowSlice; 2],
        h: [f64; 2],
    ) -> [Arc<Contour>; 2] {
        let known = self.last.take().filter(|(number, _)| *number == first).map(|(_, known)| known);
        let low = known.unwrap_or_else(|| Arc::new(filled(contours[0], slices[0], h)));
        let high = Arc::new(filled(contours[1], slices[1], h));
        self.last = (!self.forgets).then(|| (first + 1, high.clone()));
        [low, high]
    }
}

/// Tails of an interval's parts without their holes, and of the holes.
pub(super) struct Tubes {
    filled: Candidates,
    holes: Candidates,
    /// For each hole of the lower slice and of the upper one the outermost part around it.
    around: [Vec<u32>; 2],
    /// What pairs of holes with a tail have in common: tiles, as whole slices of several intervals would take more memory than all else.
    held: BTreeMap<[u32; 2], Held>,
}

impl Tubes {
    /// Those of interval `i`, whose contours have holes, if a hole of one of them goes on where the other one has none.
    #[expect(clippy::too_many_arguments, reason = "the facts of one interval, known to one caller")]
    pub fn new(
        i: usize,
        contours: [&Contour; 2],
        slices: [&HollowSlice; 2],
        known: &mut FilledSlices,
        at_slices: &[Displacement; 2],
        gap: f64,
        apart: &[(u32, u32)],
        h: [f64; 2],
    ) -> Option<Self> {
        let [low, high] = slices;
        let goes_on = |own: &HollowSlice, (contour, other): (&Contour, &HollowSlice), way: (&Displacement, f64)| {
            goes_on(&own.holes, (contour, &other.holes), way)
        };
        if !goes_on(low, (contours[1], high), (&at_slices[0], 1.0))
            && !goes_on(high, (contours[0], low), (&at_slices[1], -1.0))
        {
            return None;
        }
        let whole = known.both(i, contours, slices, h);
        let filled = Candidates::new(whole.each_ref().map(|whole| &**whole), at_slices, gap, apart, h);
        if filled.is_empty() {
            return None;
        }
        let hollow = [0, 1].map(|k| self::holes(contours[k], slices[k], &whole[k]));
        let holes = Candidates::new(hollow.each_ref(), at_slices, gap, &[], h);
        if holes.is_empty() {
            return None;
        }
        let held = |pair: [u32; 2]| (pair, Held([0, 1].map(|side| hole(&hollow[side], pair[side], h))));
        let pairs: BTreeSet<[u32; 2]> = holes.tails.iter().flatten().map(|found| found.pair).collect();
        let around = slices.map(|slice| slice.around.clone());
        Some(Tubes { filled, holes, around, held: pairs.into_iter().map(held).collect() })
    }

    /// What slides, as the tubes `beyond` either slice say, the nearest first.
    pub fn sliding(&self, beyond: [&[&Tubes]; 2]) -> SlidingTubes {
        let of = |part: fn(&Tubes) -> &Candidates, side: usize| -> Vec<&Found> {
            let beyond: Vec<&Candidates> = beyond[side].iter().map(|tubes| part(tubes)).collect();
            part(self).sliding(side, &beyond)
        };
        let (filled, holes) =
            ([0, 1].map(|side| of(|tubes| &tubes.filled, side)), [0, 1].map(|side| of(|tubes| &tubes.holes, side)));
        let around = |hole: &Found| [0, 1].map(|side| self.around[side][hole.pair[side] as usize]);
        let hollow: BTreeSet<[u32; 2]> = holes.iter().flatten().map(|hole| around(hole)).collect();
        let pairs: BTreeSet<[u32; 2]> =
            filled.iter().flatten().map(|found| found.pair).filter(|pair| hollow.contains(pair)).collect();
        let common: BTreeSet<[u32; 2]> =
            holes.iter().flatten().filter(|hole| pairs.contains(&around(hole))).map(|hole| hole.pair).collect();
        let tails = |found: [Vec<&Found>; 2], those: &BTreeSet<[u32; 2]>| {
            found.map(|some| {
                some.into_iter().filter(|one| those.contains(&one.pair)).map(|one| one.tail.clone()).collect::<Vec<_>>()
            })
        };
        SlidingTubes {
            filled: tails(filled, &pairs),
            holes: tails(holes, &common),
            held: common.iter().filter_map(|pair| self.held.get(pair).cloned()).collect(),
            pairs,
        }
    }
}

/// Whether a hole of a slice lies farther than [`RIM`] from the holes of the other one, where motion brings it.
fn goes_on(own: &Components, (other, holes): (&Contour, &Components), (to, sign): (&Displacement, f64)) -> bool {
    let nx = other.phi.dims[0];
    let goes_on = |n: usize| {
        let x = position(n, nx);
        let x: DVec2 = x + sign * to.at(x);
        let ([i, j], _) = cell(other.phi.dims, x, 0);
        holes.labels[j * nx + i] == 0 && other.phi.sample(x).abs() > RIM
    };
    (0..own.labels.len()).any(|n| own.labels[n] > 0 && goes_on(n))
}

/// What slides of an interval's hollow tubes.
#[derive(Debug, Clone, Default)]
pub(super) struct SlidingTubes {
    /// Tails without holes, of the lower slice and of the upper one.
    pub filled: [Vec<Tail>; 2],
    /// Tails of the holes.
    pub holes: [Vec<Tail>; 2],
    /// What the holes have in common.
    pub held: Vec<Held>,
    /// Parts of both slices that these are.
    pub pairs: BTreeSet<[u32; 2]>,
}

/// A hole of the lower slice, and one of the upper one, each on a tile of its own.
#[derive(Debug, Clone)]
pub(super) struct Held([(Tile, Field); 2]);

impl Held {
    pub fn tile(&self, side: usize) -> Tile {
        self.0[side].0
    }

    /// The distance to what both have in common, at what lies in the lower and in the upper slice at these pixels of the image; [`FAR`] beside it.
    pub fn at(&self, x: [DVec2; 2]) -> f64 {
        let of = |side: usize| read(&self.0[side].1, self.0[side].0.to_local(x[side]));
        of(0).max(of(1)).min(FAR)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 2] = [70, 30];

    /// A bar between these columns, 14 px wide, whose wall is 3 px thick.
    fn hollow_bar(from: f64, to: f64) -> Contour {
        let bar = |i: usize, j: usize, drawn_in: f64| {
            let half = 0.5 * (to - from) - drawn_in;
            let d = DVec2::new((i as f64 - 0.5 * (from + to)).abs() - half, (j as f64 - 14.5).abs() - 7.0 + drawn_in);
            d.max(DVec2::ZERO).length() + d.max_element().min(0.0)
        };
        let value = |i: usize, j: usize| bar(i, j, 0.0).max(-bar(i, j, 3.0));
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    fn tubes(low: &Contour, high: &Contour, apart: &[(u32, u32)]) -> Option<Tubes> {
        let still = [Displacement::zero(DIMS), Displacement::zero(DIMS)];
        let slices = [low, high].map(HollowSlice::new);
        let known = &mut FilledSlices::default();
        Tubes::new(0, [low, high], slices.each_ref(), known, &still, 1.0, apart, [1.0; 2])
    }

    #[test]
    fn a_hollow_bar_slides_with_its_hole() {
        let (low, high) = (hollow_bar(9.5, 39.5), hollow_bar(29.5, 59.5));
        let lengths = |tails: &[Vec<Tail>; 2]| tails.each_ref().map(|t| t.iter().map(|t| t.length).collect::<Vec<_>>());
        let sliding = tubes(&low, &high, &[]).expect("holes that go on").sliding([&[], &[]]);
        for lengths in [lengths(&sliding.filled), lengths(&sliding.holes)] {
            assert!(lengths.iter().all(|l| l.len() == 1 && (l[0] - 20.0).abs() < 0.6), "{lengths:?}");
        }
        assert_eq!((sliding.held.len(), sliding.pairs.len()), (1, 1));
        let at = |x: f64| sliding.held[0].at([DVec2::new(x, 14.5); 2]);
        assert!(at(34.5) < -1.0 && at(28.0) > 0.0 && at(41.0) > 0.0 && at(60.0) >= FAR, "{}", at(34.5));
        assert!(tubes(&low, &high, &[(1, 1)]).is_none(), "kept apart");
    }

    #[test]
    fn a_hole_that_stays_or_ends_does_not_slide() {
        let low = hollow_bar(9.5, 39.5);
        assert!(tubes(&low, &hollow_bar(11.0, 41.0), &[]).is_none(), "within what is common");
        assert!(tubes(&low, &hollow_bar(9.5, 59.5), &[]).is_none_or(|t| t.sliding([&[], &[]]).pairs.is_empty()));
        let filled = filled(&low, &HollowSlice::new(&low), [1.0; 2]);
        assert!(tubes(&low, &filled, &[]).is_none());
    }
}
