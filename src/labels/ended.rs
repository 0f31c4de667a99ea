//! Labels that end in the midst of others: between the last slice of a label and the next one, where others are painted in its place.
//!
//! Alone a label ends flat at its last slice, or in a tip before the next one, and one that begins in its place does so likewise: between them lay a gap
//! through solid tissue. But the union of both goes on, and says where there is any. Between slice k, on which label a is painted, and slice k + 1, on which
//! it is not, as far as is known, and others of its union are painted on a fifth of its pixels at least ([`SHARE`]), it goes on as
//!
//! ```text
//! phi_a(t) = min(phi_a, max(phi_a(k) + w t (depth_a + 2 px), u(t))),   w = 1 - m / R between 0 and 1
//! ```
//!
//! with phi_a what it is alone (nothing of labels that face each other), t the share of the gap that lies below, depth_a the largest distance inside on
//! slice k, of labels that face each other that of the deeper one, u the union, and m the least distance of the others but those that end with it, of those
//! that begin as they are on slice k + 1, R that beyond which fields say nothing. So it draws back from the others, has its contour at t = 0 and nothing of
//! theirs at t = 1, and never leaves the union. Upside down it is the same.

use std::collections::{BTreeMap, BTreeSet};

use super::facing::{Facing, facing};
use super::kept::{KeptBody, LayerPatch};
use super::stack::{LabelPair, LabelStack};
use crate::error::Result;
use crate::grid::tile::Tile;

/// Share of a contour, by area, that has to lie on others to end amid them. With half of it a wall that closed over what it encloses left a ring of
/// background where it lay on two fifths of that; with none a thread that leans out of a ball takes its own area once more from what the ball leaves.
const SHARE: f64 = 0.2;
/// Pixels, of the larger side, by which a label has drawn back beyond its innermost point at the slice on which it is not: thin labels end sooner. Of 0, 1,
/// 2 and 4 px, 2 was best for two brain atlases with every fourth slice given.
const BEYOND: f32 = 2.0;

/// What ends between two slices.
#[derive(Debug, Clone, Default)]
pub(super) struct EndingLabels {
    /// The slices.
    pub slices: [usize; 2],
    /// Labels, and whether the lower slice is that on which they are painted.
    pub labels: BTreeSet<(usize, bool)>,
    /// The pairs that are painted on the same pixels, one below and one above.
    pub across: BTreeSet<LabelPair>,
    /// Those of them that face each other.
    pub facing: BTreeSet<LabelPair>,
}

impl EndingLabels {
    /// Those between each slice of `stack` and the next, and those that face each other farther apart, of labels with a union; `groups` are the labels
    /// of each.
    pub fn of(stack: &LabelStack, groups: &[Vec<usize>]) -> Vec<EndingLabels> {
        let painted = stack.painted();
        // Whether both are in a union that is known on these slices.
        let united = |labels: [usize; 2], slices: [usize; 2]| {
            let of_both = groups.iter().filter(|members| labels.iter().all(|a| members.contains(a)));
            of_both.into_iter().any(|members| slices.iter().all(|&k| stack.settled(members, k)))
        };
        let between = |k: usize| {
            let mut pairs: BTreeMap<LabelPair, u64> = BTreeMap::new();
            let mut pixels = [0, 1].map(|_| vec![0u64; painted[k].len()]);
            for (&low, &high) in stack.drawn[k].iter().zip(&stack.drawn[k + 1]) {
                let labels = [low, high].map(|l| (l as usize).checked_sub(1));
                labels.iter().zip(&mut pixels).for_each(|(label, pixels)| label.iter().for_each(|a| pixels[*a] += 1));
                if let [Some(low), Some(high)] = labels
                    && low != high
                {
                    *pairs.entry((low, high)).or_default() += 1;
                }
            }
            pairs.retain(|&(low, high), _| united([low, high], [k, k + 1]));
            let mut covered = pixels.each_ref().map(|pixels| vec![0; pixels.len()]);
            for (&(low, high), shared) in &pairs {
                covered[0][low] += shared;
                covered[1][high] += shared;
            }
            let amid = |side: usize, a: usize| covered[side][a] as f64 >= SHARE * pixels[side][a] as f64;
            let mut ending = EndingLabels { slices: [k, k + 1], ..EndingLabels::default() };
            for (low, high) in pairs.into_keys() {
                let ends = !painted[k + 1][low] && stack.given[low].settles(k + 1) && amid(0, low);
                let begins = !painted[k][high] && stack.given[high].settles(k) && amid(1, high);
                if ends {
                    ending.labels.insert((low, true));
                }
                if begins {
                    ending.labels.insert((high, false));
                }
                if ends || begins {
                    ending.across.insert((low.min(high), low.max(high)));
                }
            }
            ending
        };
        let mut all: Vec<EndingLabels> = (1..stack.drawn.len()).map(|above| between(above - 1)).collect();
        // What ends towards a slice of others does not end beyond it as well.
        let near = all.len();
        for Facing { slices: [low, high], labels: [a, b] } in facing(stack, &painted) {
            let ended = |ending: &EndingLabels| {
                let within = ending.slices[0] >= low && ending.slices[1] <= high;
                within && (ending.labels.contains(&(a, true)) || ending.labels.contains(&(b, false)))
            };
            let known = united([a, b], [low, high]);
            let pair = (a.min(b), a.max(b));
            if high == low + 1 && all[low].across.contains(&pair) {
                all[low].facing.insert(pair);
            }
            if high == low + 1 || !known || all[..near].iter().any(ended) {
                continue;
            }
            let at = all[near..].iter().position(|ending| ending.slices == [low, high]).unwrap_or(all.len() - near);
            all.resize(all.len().max(near + at + 1), EndingLabels { slices: [low, high], ..EndingLabels::default() });
            all[near + at].labels.extend([(a, true), (b, false)]);
            all[near + at].across.insert(pair);
            all[near + at].facing.insert(pair);
        }
        all
    }

    /// The labels that go on at a height. `bodies` are the labels without the others, `alone` what they are at this height, `union` that of a label with
    /// one that it faces.
    ///
    /// # Errors
    /// Those of reading the bodies.
    pub fn goes_on<'u>(
        &self,
        at: &HeightBetween,
        bodies: &mut [KeptBody],
        alone: &[LayerPatch],
        union: impl Fn(usize, &dyn Fn(usize) -> bool) -> Option<&'u LayerPatch>,
    ) -> Result<Vec<GoesOn>> {
        let mut contours = Vec::new();
        for &(a, below) in &self.labels {
            contours.push((a, bodies[a].at(at.slices[usize::from(!below)], at.same)?.unwrap_or_default()));
        }
        let depths: Vec<f32> = contours.iter().map(|(_, contour)| depth(contour)).collect();
        let mut patches = Vec::new();
        for ((a, contour), (_, below)) in contours.iter().zip(&self.labels) {
            // One that faces another draws back as fast as that does, so that their border is in the middle.
            let faces = |b: usize| self.across.contains(&((*a).min(b), (*a).max(b)));
            let facing = self.labels.iter().zip(&depths).filter(|((b, other), _)| other != below && faces(*b));
            let depth = facing.map(|(_, depth)| *depth).fold(depth(contour), f32::max);
            let Some(union) = union(*a, &faces) else {
                patches.push(None);
                continue;
            };
            // Those that end with it draw back from others, not from each other.
            let other = |b: usize| match self.labels.contains(&(b, !below)) {
                true => contours.iter().find(|(c, _)| *c == b).map(|(_, contour)| contour),
                false => Some(&alone[b]).filter(|_| !self.labels.contains(&(b, *below))),
            };
            let others = (0..alone.len()).filter(|b| b != a).filter_map(other).collect();
            let [painted, not] = if *below { at.slices } else { [at.slices[1], at.slices[0]] };
            let t = ((at.z - painted) / (not - painted)) as f32;
            // Of two that face each other each would end alone in its own way, and their border lie where these say.
            let nothing = LayerPatch::default();
            let is_facing = self.facing.iter().any(|(b, c)| [b, c].contains(&a));
            let own = if is_facing { &nothing } else { &alone[*a] };
            let on = Continued { alone: own, contour, union, others, t, depth, far: at.far, px: at.px };
            patches.push(Some(on.patch()));
        }
        let of = |((label, contour), patch): ((usize, LayerPatch), Option<LayerPatch>)| {
            Some(GoesOn { label, patch: patch?, contour })
        };
        Ok(contours.into_iter().zip(patches).filter_map(of).collect())
    }
}

/// A label that goes on between its last contour and the slice on which it is not.
pub(super) struct GoesOn {
    /// Its place.
    pub label: usize,
    /// It with what goes on.
    pub patch: LayerPatch,
    /// Its last contour.
    pub contour: LayerPatch,
}

/// A height between two neighbouring slices.
pub(super) struct HeightBetween {
    /// It.
    pub z: f64,
    /// Heights of the slices below and above.
    pub slices: [f64; 2],
    /// Heights within this are one.
    pub same: f64,
    /// Value far outside.
    pub far: f32,
    /// Length of a pixel's larger side.
    pub px: f32,
}

/// Largest distance inside.
pub(super) fn depth(contour: &LayerPatch) -> f32 {
    -contour.phi.iter().copied().fold(0.0, f32::min)
}

/// A label that ends, at a height between its last contour and the slice on which it is not.
struct Continued<'c> {
    /// As it is without the others, and its last contour.
    alone: &'c LayerPatch,
    contour: &'c LayerPatch,
    /// What goes on.
    union: &'c LayerPatch,
    /// The others but those that end with it; of those that begin their first contours.
    others: Vec<&'c LayerPatch>,
    /// 0 at the contour, 1 at the slice on which it is not.
    t: f32,
    /// Distance by which it has drawn back there, less BEYOND.
    depth: f32,
    far: f32,
    px: f32,
}

impl Continued<'_> {
    /// The label with what goes on.
    fn patch(&self) -> LayerPatch {
        let Continued { alone, contour, union, ref others, t, depth, far, px } = *self;
        let back = t * (depth + BEYOND * px);
        let tile_of = |patch: &LayerPatch| Tile { origin: patch.origin, dims: patch.dims };
        let (of_alone, of_contour) = (tile_of(alone), tile_of(contour));
        let tile = if of_alone.is_empty() { of_contour } else { of_alone.joined(of_contour) };
        let meets = |patch: &&&LayerPatch| {
            let other = tile_of(patch);
            (0..2).all(|a| {
                other.origin[a] < tile.origin[a] + tile.dims[a] && tile.origin[a] < other.origin[a] + other.dims[a]
            })
        };
        let near: Vec<&LayerPatch> = others.iter().filter(meets).copied().collect();
        let value = |n: usize| {
            let pixel = [tile.origin[0] + n % tile.dims[0], tile.origin[1] + n / tile.dims[0]];
            let at = |patch: &LayerPatch| patch.at(pixel).unwrap_or(far);
            let least = near.iter().map(|patch| at(patch)).fold(far, f32::min);
            let w = (1.0 - least / far).clamp(0.0, 1.0);
            at(alone).min((at(contour) + w * back).max(at(union))).min(far)
        };
        LayerPatch { origin: tile.origin, dims: tile.dims, phi: (0..tile.len()).map(value).collect() }
    }
}
