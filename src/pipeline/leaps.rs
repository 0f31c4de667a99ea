//! Bodies that end beside others: where motion would join what is two, and what ends though a small part of it goes on.
//!
//! Motion may bring a part that overlaps nothing of the other slice as it is drawn over a part there though they are two bodies, one of which ends where
//! the other begins. What moves on by more than its width has come that way: its way does not begin there. So a meeting is a leap, and does not count, where
//! the empty way between both contours is more than a pixel and twice what each such part has moved, by its centroid, from or to the parts that it overlaps
//! in the gap beyond, in the time of this one. One that overlaps nothing there either has not moved, unless another part lies ahead as near, or
//! motion brings most of one over the other. Sheets and threads that lie along the slice are exempt: they move on by many times their width. On a first or
//! last slice, beyond which nothing is known, a part moves as what the other one overlaps, if it overlaps any: where that stands, it ends beside it.
//!
//! Of parts that overlap, one may be a block that ends and the other a rod at its side that goes on: far from the rod contours have nothing to go to, and
//! the block was swept towards it. Where one is four times as large as the other, and their centroids are as far apart as contours at a leap, the block ends
//! as a part without partner does, besides what goes on.
//!
//! Measured: 25 balls of 3 to 7 px radius and a large one, at least 3 px apart, 5 times, every 4th, 6th and 8th slice: of 130, 130 and 120 bodies 11, 22 and 29
//! were joined to others, 4, 10 and 15 are (0, 3 and 4 without motion). Rings, slabs, blocks and vertebrae that end in a gap, a rod of 3.2 px radius at
//! their side going on, at every height in gaps of 4, 6 and 8: .28 to .70 of their volume before, .84 to 1.02 with it; Dice .36 to .67, and .66 to .76.

use std::cell::OnceCell;
use std::collections::BTreeSet;
use std::f64::consts::{FRAC_PI_4, PI};

use glam::DVec2;
use rstar::RTree;

use crate::contour::Contour;
use crate::contour::overlap::{DecidedPairs, Group, match_components};
use crate::grid::field::position;

/// Empty way that noise of contours makes, px, and how many times a motion may grow from gap to gap.
const NOISE: f64 = 1.0;
const GROWS: f64 = 2.0;
/// Angle at which what goes on lies ahead.
const AHEAD: f64 = FRAC_PI_4;
/// Area of a part, in discs of its inradius, up to which it is no sheet: sheets move on by many times their width.
const COMPACT: f64 = 3.0;
/// How many times as small, by area, what goes on at the side of what ends is at least.
const SMALLER: f64 = 4.0;

/// Two neighbouring slices, what lies beyond each of them, and the gaps.
pub(super) struct Surroundings<'c> {
    /// The slices.
    pub contours: [&'c Contour; 2],
    /// Pixel sides, px of the larger.
    pub h: [f64; 2],
    /// The slice below the lower and that above the upper one.
    beyond: [Option<&'c Contour>; 2],
    /// Gaps between them over that between the two.
    gaps: [f64; 2],
    /// Pixels and outlines of the slices' parts, and of those beyond, once they are asked for.
    masses: [OnceCell<Vec<Mass>>; 4],
    outlines: [OnceCell<Vec<Outline>>; 4],
}

/// Sum of a part's pixels' places, px, and how many they are; those of a slice are kept by number.
#[derive(Debug, Clone, Copy, Default)]
struct Mass {
    sum: DVec2,
    count: usize,
}

/// Places along a part's contour, px; those of a slice are kept by number.
type Outline = RTree<[f64; 2]>;

impl<'c> Surroundings<'c> {
    /// Of two slices, with those beyond them, and the gaps to those over the gap between the two.
    pub fn new(
        contours: [&'c Contour; 2],
        beyond: [Option<&'c Contour>; 2],
        gaps: [f64; 2],
        h: [f64; 2],
    ) -> Surroundings<'c> {
        Surroundings { contours, h, beyond, gaps, masses: Default::default(), outlines: Default::default() }
    }
}

impl Surroundings<'_> {
    /// Whether the way from a part of the lower slice to one of the upper is a leap. Of these `alone` overlap nothing; `whole` is whether motion brings
    /// most of one over the other: then what has not moved as far as is known may move.
    pub fn leaps(&self, [low, high]: [u32; 2], alone: [bool; 2], whole: bool) -> bool {
        let Some(way) = way(&self.outlines(0)[low as usize], &self.outlines(1)[high as usize]) else { return false };
        let length = way.length();
        if length <= NOISE {
            return false;
        }
        let moved = |side: usize| {
            let (part, other, outward) = if side == 0 { (low, high, -way) } else { (high, low, way) };
            let own = || if self.is_compact(side, part) { self.moved(side, &[part]) } else { Some(f64::INFINITY) };
            let stands = || if whole { None } else { self.has_come(side, part, outward) };
            self.partners_moved(side, other).or_else(own).or_else(stands)
        };
        let moved: Vec<f64> = (0..2).filter(|side| alone[*side]).filter_map(moved).collect();
        !moved.is_empty() && moved.iter().all(|moved| length > NOISE + GROWS * moved)
    }

    /// Pixels of the parts of the lower or the upper slice.
    fn masses(&self, side: usize) -> &[Mass] {
        self.masses[side].get_or_init(|| masses(self.contours[side], self.h))
    }

    /// Those of the slice beyond it, if there is one.
    fn masses_beyond(&self, side: usize) -> Option<&[Mass]> {
        let contour = self.beyond[side]?;
        Some(self.masses[2 + side].get_or_init(|| masses(contour, self.h)))
    }

    /// Outlines of the parts of the lower or the upper slice.
    fn outlines(&self, side: usize) -> &[Outline] {
        self.outlines[side].get_or_init(|| outlines(self.contours[side], self.h))
    }

    /// Those of the slice beyond it, if there is one.
    fn outlines_beyond(&self, side: usize) -> Option<&[Outline]> {
        let contour = self.beyond[side]?;
        Some(self.outlines[2 + side].get_or_init(|| outlines(contour, self.h)))
    }

    /// Whether a part is no sheet or thread that lies along the slice.
    fn is_compact(&self, side: usize, part: u32) -> bool {
        is_compact(self.masses(side)[part as usize].count, self.contours[side].solid_depth[part as usize], self.h)
    }

    /// Parts of either slice that end beside a small one which goes on, unless a pair of theirs is `joined`.
    pub fn ending(&self, joined: &[(u32, u32)]) -> [Vec<u32>; 2] {
        let [low, high] = self.contours;
        let decided = DecidedPairs::joining(joined);
        let groups = match_components((&low.solids, &low.phi), (&high.solids, &high.phi), &decided).groups;
        let mut ending: [Vec<u32>; 2] = Default::default();
        for group in groups.into_iter().filter(|group| joined.iter().all(|pair| !group.low.contains(&pair.0))) {
            if let Some(side) = self.ends(&group) {
                ending[side].extend([group.low, group.high][side].iter());
            }
        }
        ending
    }

    /// On which slice the parts of a group are larger, if they end there.
    fn ends(&self, group: &Group) -> Option<usize> {
        let parts = [&group.low, &group.high];
        let [low, high] = [0, 1].map(|side| whole(self.masses(side), parts[side]));
        let larger = usize::from(high.count > low.count);
        let [few, many] = if larger == 1 { [low.count, high.count] } else { [high.count, low.count] };
        if (many as f64) < SMALLER * few as f64 {
            return None;
        }
        let shift = (high.centre()? - low.centre()?).length();
        let leaps = |moved: f64| shift > NOISE + GROWS * moved;
        let ends = self.moved(larger, parts[larger]).is_some_and(leaps)
            && self.moved(1 - larger, parts[1 - larger]).is_none_or(leaps);
        ends.then_some(larger)
    }

    /// What a part that overlaps nothing beyond its slice has moved there: nothing, unless another one lies as near in that direction, `outward`, as it
    /// has come, px.
    fn has_come(&self, side: usize, part: u32, outward: DVec2) -> Option<f64> {
        let (own, beyond) = (self.contours[side], self.beyond[side]?);
        let nx = own.phi.dims[0];
        let reach = GROWS * outward.length() * self.gaps[side] + NOISE;
        let around = own.tile_of(&[part], self.h.map(|h| (reach / h).ceil() as usize));
        let near: BTreeSet<u32> = around.nodes(nx).map(|n| beyond.solids.labels[n]).filter(|l| *l > 0).collect();
        let (here, there) = (&self.outlines(side)[part as usize], self.outlines_beyond(side)?);
        let goes_on = |other: &u32| {
            let ahead = way(here, &there[*other as usize]).filter(|way| way.length() <= reach);
            ahead.is_some_and(|way| way.angle_to(outward).abs() < AHEAD)
        };
        Some(if near.iter().any(goes_on) { f64::INFINITY } else { 0.0 })
    }

    /// On the first or last slice, beyond which nothing tells, how far the centroid of what part `other` of the slice opposite overlaps has moved, px;
    /// `None` where it overlaps nothing.
    fn partners_moved(&self, side: usize, other: u32) -> Option<f64> {
        if self.beyond[side].is_some() {
            return None;
        }
        let (own, opposite) = (self.contours[side], self.contours[1 - side]);
        let partners = overlapped(opposite, &[other], own);
        let there = self.masses(1 - side)[other as usize].centre()?;
        Some((there - whole(self.masses(side), &partners).centre()?).length())
    }

    /// Way of the centroid of some parts to that of the parts beyond which they overlap, px in the time of the gap; `None` where they overlap none.
    fn moved(&self, side: usize, parts: &[u32]) -> Option<f64> {
        let (own, beyond) = (self.contours[side], self.beyond[side]?);
        let there = whole(self.masses_beyond(side)?, &overlapped(own, parts, beyond)).centre()?;
        let here = whole(self.masses(side), parts).centre()?;
        Some((there - here).length() / self.gaps[side])
    }
}

/// Whether a part of so many pixels and of this depth, px, is no sheet or thread that lies along the slice.
pub(super) fn is_compact(pixels: usize, depth: f64, h: [f64; 2]) -> bool {
    // Depths are those of pixels' centres.
    pixels as f64 * h[0] * h[1] <= COMPACT * PI * (depth + 0.5).powi(2)
}

impl Mass {
    /// The centroid.
    fn centre(&self) -> Option<DVec2> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// Pixels of all parts of a slice.
fn masses(contour: &Contour, h: [f64; 2]) -> Vec<Mass> {
    let mut masses = vec![Mass::default(); contour.solids.count + 1];
    let labels = contour.solids.labels.iter().enumerate().filter(|(_, label)| **label > 0);
    for (n, &label) in labels {
        let mass = &mut masses[label as usize];
        mass.sum += position(n, contour.phi.dims[0]) * DVec2::from(h);
        mass.count += 1;
    }
    masses
}

/// Outlines of all parts of a slice.
fn outlines(contour: &Contour, h: [f64; 2]) -> Vec<Outline> {
    let mut places = vec![Vec::new(); contour.solids.count + 1];
    for seed in &contour.seeds {
        places[contour.solids.labels[seed.inside] as usize].push((seed.x * DVec2::from(h)).to_array());
    }
    places.into_iter().map(RTree::bulk_load).collect()
}

/// Pixels of some parts together.
fn whole(all: &[Mass], some: &[u32]) -> Mass {
    let each = some.iter().map(|part| all[*part as usize]);
    each.fold(Mass::default(), |a, b| Mass { sum: a.sum + b.sum, count: a.count + b.count })
}

/// Shortest way from one contour to another, px.
fn way(from: &Outline, to: &Outline) -> Option<DVec2> {
    let nearest = |[some, all]: [&Outline; 2]| {
        let of = |x: &[f64; 2]| Some(DVec2::from(*all.nearest_neighbor(*x)?) - DVec2::from(*x));
        some.iter().filter_map(of).min_by(|a, b| a.length().total_cmp(&b.length()))
    };
    match from.size() <= to.size() {
        true => nearest([from, to]),
        false => nearest([to, from]).map(|way| -way),
    }
}

/// Parts of another slice that some parts overlap as they are drawn, by increasing number.
fn overlapped(own: &Contour, parts: &[u32], other: &Contour) -> Vec<u32> {
    let mut met: Vec<u32> = pixels(own, parts).map(|n| other.solids.labels[n]).filter(|l| *l > 0).collect();
    met.sort_unstable();
    met.dedup();
    met
}

/// Pixels of some parts, by increasing number.
fn pixels(contour: &Contour, parts: &[u32]) -> impl Iterator<Item = usize> {
    let nx = contour.phi.dims[0];
    let of = move |part: u32| {
        let tile = contour.tile_of(&[part], [0; 2]);
        tile.nodes(nx).filter(move |n| contour.solids.labels[*n] == part).collect::<Vec<usize>>()
    };
    parts.iter().copied().flat_map(of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [100, 60];

    /// Discs about these places, radii last.
    fn discs(all: &[[f64; 3]]) -> Contour {
        let away = |i: usize, j: usize| {
            let from = |[x, y, r]: &[f64; 3]| libm::hypot(i as f64 - x, j as f64 - y) - r;
            all.iter().map(from).fold(1e3, f64::min)
        };
        Contour::new(0.0, Field::from_fn(DIMS, away), [1.0; 2], 1.0)
    }

    /// Whether the way from the first part of the second of four slices to the first of the third is a leap.
    fn leap(slices: [&[[f64; 3]]; 4], gaps: [f64; 2]) -> bool {
        let [below, low, high, above] = slices.map(discs);
        Surroundings::new([&low, &high], [Some(&below), Some(&above)], gaps, [1.0; 2]).leaps([1, 1], [true; 2], false)
    }

    #[test]
    fn what_stands_and_ends_beside_what_begins_and_stands_is_a_leap_and_what_keeps_moving_is_none() {
        let disc = |x: f64| [[x, 30.0, 5.0]];
        let [a, b] = [disc(40.0), disc(53.0)];
        assert!(leap([&a, &a, &b, &b], [1.0; 2]));
        assert!(leap([&[], &a, &b, &b], [1.0; 2]), "a body on one slice has not moved");
        assert!(leap([&[], &a, &b, &[]], [1.0; 2]));
        let [before, after] = [disc(27.0), disc(66.0)];
        assert!(!leap([&before, &a, &b, &after], [1.0; 2]), "13 px a gap all along");
        assert!(!leap([&before, &a, &b, &b], [1.0; 2]), "it has come that way");
        assert!(leap([&disc(14.0), &a, &b, &b], [1.0; 2]), "what lies farther off says nothing");
        // As much as it has moved before in a gap as wide; in one eight times as wide it has hardly moved.
        let slow = disc(35.0);
        assert!(!leap([&slow, &a, &b, &disc(58.0)], [1.0; 2]));
        assert!(leap([&slow, &a, &b, &disc(58.0)], [8.0; 2]));
        // Contours that all but touch.
        assert!(!leap([&a, &a, &disc(50.8), &disc(50.8)], [1.0; 2]));
    }

    #[test]
    fn a_sheet_moves_on_by_many_times_its_width() {
        let sheet = |x: f64| {
            let away = move |i: usize, j: usize| ((i as f64 - x).abs() - 1.2).max((j as f64 - 30.0).abs() - 20.0);
            Contour::new(0.0, Field::from_fn(DIMS, away), [1.0; 2], 1.0)
        };
        let [low, high] = [sheet(40.0), sheet(46.0)];
        let slices = Surroundings::new([&low, &high], [Some(&low), Some(&high)], [1.0; 2], [1.0; 2]);
        assert!(!slices.leaps([1, 1], [true; 2], false));
    }

    #[test]
    fn at_the_ends_of_a_stack_nothing_is_known() {
        let [low, high] = [discs(&[[40.0, 30.0, 5.0]]), discs(&[[53.0, 30.0, 5.0]])];
        let with = |above| Surroundings::new([&low, &high], [None, above], [1.0; 2], [1.0; 2]);
        assert!(!with(None).leaps([1, 1], [true; 2], false));
        assert!(with(Some(&high)).leaps([1, 1], [true; 2], false));
    }

    #[test]
    fn on_a_first_slice_a_part_moves_as_what_the_other_one_overlaps() {
        let bars = |all: &[f64]| {
            let bar = |i: usize, j: usize, x: f64| ((i as f64 - x).abs() - 3.0).max((j as f64 - 30.0).abs() - 20.0);
            let away = |i: usize, j: usize| all.iter().map(|x| bar(i, j, *x)).fold(1e3, f64::min);
            Contour::new(0.0, Field::from_fn(DIMS, away), [1.0; 2], 1.0)
        };
        // The left one is on the lower slice alone, 4 px beside the right one.
        let leap = |right: f64, below: Option<&Contour>, alone: bool| {
            let [low, high] = [bars(&[40.0, 50.0]), bars(&[right])];
            let slices = Surroundings::new([&low, &high], [below, None], [1.0; 2], [1.0; 2]);
            slices.leaps([1, 1], [alone, false], true)
        };
        assert!(leap(50.0, None, true), "the right one stands");
        assert!(!leap(47.0, None, true), "the right one comes");
        assert!(!leap(50.0, Some(&bars(&[40.0])), true), "slices beyond say how it moves, and sheets may move far");
        assert!(!leap(50.0, None, false), "what overlaps as drawn is not asked");
    }

    #[test]
    fn a_block_ends_where_a_small_part_at_its_side_goes_on() {
        let (block, rod) = (discs(&[[40.0, 30.0, 16.0]]), discs(&[[52.0, 30.0, 3.0]]));
        let neither: [Vec<u32>; 2] = Default::default();
        let ending = |below: Option<&Contour>, low, high, above: Option<&Contour>| {
            Surroundings::new([low, high], [below, above], [1.0; 2], [1.0; 2]).ending(&[])
        };
        assert_eq!(ending(Some(&block), &block, &rod, Some(&rod)), [vec![1], vec![]]);
        assert_eq!(ending(Some(&rod), &rod, &block, Some(&block)), [vec![], vec![1]], "upside down");
        let linked = Surroundings::new([&block, &rod], [Some(&block), Some(&rod)], [1.0; 2], [1.0; 2]);
        assert_eq!(linked.ending(&[(1, 1)]), neither, "a link says that it goes on");
        assert_eq!(ending(None, &block, &rod, Some(&rod)), neither, "it may be the end of something that tapers");
        let [middle, half] = [[40.0, 30.0, 3.0], [52.0, 30.0, 9.0]].map(|disc| discs(&[disc]));
        assert_eq!(ending(Some(&block), &block, &middle, Some(&middle)), neither, "a shaft in its middle");
        assert_eq!(ending(Some(&block), &block, &half, Some(&half)), neither, "a third of it goes on");
        let tilted = discs(&[[28.0, 30.0, 16.0]]);
        assert_eq!(ending(Some(&tilted), &block, &rod, Some(&rod)), neither, "it moves that way");
    }
}
