//! Distances to slopes to courses: what each seed of each contour does in both of its intervals.
//!
//! For a seed of contour i, `s(z)` is how far outward its piece of contour lies at height z: 0 at z_i, S+ at z_{i+1}, and farther along
//! the chain of correspondences. One slope m = s'(z_i) per seed, used on both sides, makes the surface C1 across the contour.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec2;
use rayon::prelude::*;

use crate::backend::jobs::Track;
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::near_knots::{UNLIKE, settled_slope};
use crate::grid::spline::{HermiteArc, monotone};
use crate::pipeline::near_seeds::NearSeeds;
use crate::pipeline::tracks::{SideTracks, Sides};
use crate::registration::displacement::Displacement;
use crate::settings::{Settings, SlopeRule};
use crate::storage::spill::{Array, Budget, Large, SpillVec, stored_as_they_are};

/// Seeds looked at around a landing point, with weights `1 / (d + SOFT)^2` less that of the farthest: none comes or goes with a jump.
const NEIGHBOURS: usize = 5;
const SOFT: f64 = 0.25;
/// Contours a chain reaches to each side: farther ones change the slope of a cubic spline by less than 0.27^12 = 2e-7 of a secant.
pub const CHAIN_REACH: usize = 12;
/// Slope at the far end, over S, of a piece of contour whose particle died: the steepest that a monotone course can have. What has no
/// counterpart keeps its place long and leaves fast. Measured (mean Dice over 10 runs with such parts): 0 0.8783, 1 0.8833, 2 0.8847,
/// 3 0.8857.
const DEAD_PARTICLE_END_SLOPE: f64 = 3.0;

/// A seed with its weight in a mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Weighted {
    seed: u64,
    weight: f64,
}

/// A contour that a chain reaches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Hop {
    /// Distance to it, px, outward positive.
    distance: f64,
    /// Share to which the particles on the way there arrived; no hop has more than the one before it.
    sure: f64,
}

stored_as_they_are!(Weighted, Hop);

/// Steepest slope of a rule that may overshoot, in ways to the farther neighbour per wider gap: where gaps are unlike, a hundredth of a pixel in the
/// narrow one would be a pixel in the other, and a sweep be led out of its tube and back.
const STEEPEST: f64 = 3.0;
/// Hops that are less sure do not count.
const UNSURE: f64 = 1e-6;

/// A list per seed, end to end.
#[derive(Debug, Clone, Default)]
struct Lists<T> {
    ends: Vec<u32>,
    values: Vec<T>,
}

impl<T: Copy> Lists<T> {
    fn empty(count: usize) -> Self {
        Lists { ends: vec![0; count], values: Vec::new() }
    }

    fn new(lists: &[Vec<T>]) -> Self {
        let mut out = Lists {
            ends: Vec::with_capacity(lists.len()),
            values: Vec::with_capacity(lists.iter().map(Vec::len).sum()),
        };
        for list in lists {
            out.values.extend_from_slice(list);
            out.ends.push(out.values.len() as u32);
        }
        out
    }

    fn of(&self, seed: usize) -> &[T] {
        let start = seed.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.values[start as usize..self.ends[seed] as usize]
    }
}

impl Large for Lists<Hop> {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        vec![&mut self.ends, &mut self.values]
    }
}

/// Slopes of a contour's seeds and where their chains go on.
#[derive(Debug, Clone, Default)]
pub struct Fitted {
    /// m = ds/dz per seed, px per unit of z.
    pub slopes: Vec<f64>,
    down: Neighbours,
    up: Neighbours,
}

impl Large for Fitted {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        let Fitted { slopes, down, up } = self;
        vec![slopes, &mut down.ends, &mut down.values, &mut up.ends, &mut up.values]
    }
}

impl Fitted {
    /// Slopes where a field with these slopes per height has its contour: it moves outward where the field falls.
    pub fn of_field(contour: &Contour, slopes: &Field) -> Self {
        let slopes = contour.seeds.iter().map(|s| -slopes.sample(s.x)).collect();
        Fitted { slopes, ..Fitted::default() }
    }

    /// The fit with slopes moved by `sign` times the outward speed at which the frame carries each seed: growth that the frame's motion
    /// explains is not in the slopes, although it moves the contour.
    pub fn with_motion(&self, contour: &Contour, rates: &Displacement, h: [f64; 2], sign: f64) -> Self {
        let outward = |x: DVec2| (rates.at(x) * DVec2::from(h)).dot(contour.phi.normal(x, h));
        let slopes = self.slopes.iter().zip(&contour.seeds).map(|(m, s)| m + sign * outward(s.x)).collect();
        Fitted { slopes, ..self.clone() }
    }
}

/// Seeds of the next contour at each landing point; none where the particle died.
type Neighbours = Lists<Weighted>;
/// Contours along the chains of a contour's seeds in one direction.
type Chains = Lists<Hop>;

/// Input of the fit.
pub struct Measured<'s, 'b> {
    /// The contours.
    pub contours: &'s SpillVec<'b, Contour>,
    /// Distances that their morphs have measured, interval by interval.
    pub sides: &'s SpillVec<'b, Sides>,
    /// Pixel sides.
    pub h: [f64; 2],
    /// Length of a pixel's larger side, for the clamped end slopes.
    pub px: f64,
    /// What contours may be off by, px, see [`crate::grid::near_knots`].
    pub doubt: f64,
}

/// Slopes for all contours, which `finish` may change, one by one.
///
/// # Errors
/// The errors of the temporary file and of `finish`.
pub fn fit<'b>(
    measured: &Measured<'_, 'b>,
    settings: &Settings,
    budget: &'b Budget,
    finish: impl Fn(usize, Fitted) -> Result<Fitted>,
) -> Result<SpillVec<'b, Fitted>> {
    let links = measured.links(budget)?;
    let mut up = SpillVec::new(budget);
    let mut beyond: Option<Chains> = None;
    for i in (0..links.len()).rev() {
        let sides = measured.sides_above(i)?;
        let chains = chains(sides.as_ref().and_then(|s| s.up.as_ref()), &links.get(i)?.up, beyond.as_ref());
        up.push(chains.clone())?;
        beyond = Some(chains);
    }
    let z: Vec<f64> = (0..links.len()).map(|i| measured.contours.light(i).z).collect();
    let mut fitted = SpillVec::new(budget);
    let (mut beyond, mut below): (Option<Chains>, Option<Arc<Sides>>) = (None, None);
    for i in 0..links.len() {
        let above = measured.sides_above(i)?;
        let mut own = links.get(i)?.as_ref().clone();
        let sides = [below.as_ref().and_then(|s| s.down.as_ref()), above.as_ref().and_then(|s| s.up.as_ref())];
        let down = chains(sides[0], &own.down, beyond.as_ref());
        own.slopes =
            slopes_of(i, &z, sides, [&down, &*up.get(links.len() - 1 - i)?], [measured.px, measured.doubt], settings);
        fitted.push(finish(i, own)?)?;
        (beyond, below) = (Some(down), above);
    }
    Ok(fitted)
}

impl<'b> Measured<'_, 'b> {
    /// Measurements in the interval above a contour.
    fn sides_above(&self, i: usize) -> Result<Option<Arc<Sides>>> {
        if i < self.sides.len() { self.sides.get(i).map(Some) } else { Ok(None) }
    }

    /// Chains of all contours; slopes are still to come.
    fn links(&self, budget: &'b Budget) -> Result<SpillVec<'b, Fitted>> {
        let count = self.contours.len();
        let seeds_of = |i: usize| Ok(NearSeeds::new(&self.contours.some(i, Contour::SEEDS)?.seeds, self.h));
        let mut links = SpillVec::new(budget);
        let (mut before, mut own): (Option<NearSeeds>, NearSeeds) = (None, seeds_of(0)?);
        let mut below: Option<Arc<Sides>> = None;
        for i in 0..count {
            let next: Option<NearSeeds> = if i + 1 < count { Some(seeds_of(i + 1)?) } else { None };
            let above = self.sides_above(i)?;
            let seeds = own.len();
            let neighbours = |side: Option<&SideTracks>, next: Option<&NearSeeds>| match (side, next) {
                (Some(side), Some(next)) => {
                    let of = |t: &Track| if t.kept > 0.0 { nearest(next, t.landing, self.h) } else { Vec::new() };
                    Lists::new(&side.tracks.par_iter().map(of).collect::<Vec<_>>())
                }
                _ => Lists::empty(seeds),
            };
            links.push(Fitted {
                slopes: Vec::new(),
                down: neighbours(below.as_ref().and_then(|s| s.down.as_ref()), before.as_ref()),
                up: neighbours(above.as_ref().and_then(|s| s.up.as_ref()), next.as_ref()),
            })?;
            below = above;
            if let Some(next) = next {
                before = Some(std::mem::replace(&mut own, next));
            }
        }
        Ok(links)
    }
}

fn nearest(seeds: &NearSeeds, x: DVec2, h: [f64; 2]) -> Vec<Weighted> {
    let near = seeds.nearest::<NEIGHBOURS>(x * DVec2::from(h)).into_iter();
    let mut found: Vec<Weighted> =
        near.map(|(seed, d2)| Weighted { seed: seed.into(), weight: (d2.sqrt() + SOFT).powi(-2) }).collect();
    let farthest = if found.len() == NEIGHBOURS { found[NEIGHBOURS - 1].weight } else { 0.0 };
    // Of seeds that are equally far all count alike.
    let least = 1e-9 * farthest.max(f64::MIN_POSITIVE);
    found.iter_mut().for_each(|near| near.weight += least - farthest);
    let sum: f64 = found.iter().map(|near| near.weight).sum();
    found.iter_mut().for_each(|near| near.weight /= sum);
    found
}

/// Accumulated distances along the chains: first the way to the next contour, then, averaged over the seeds at the landing point, what
/// their own chains, `beyond`, say.
fn chains(side: Option<&SideTracks>, neighbours: &Neighbours, beyond: Option<&Chains>) -> Chains {
    let (Some(side), Some(beyond)) = (side, beyond) else { return Lists::empty(neighbours.ends.len()) };
    let chain = |(seed, track): (usize, &Track)| {
        let mut chain = Vec::with_capacity(CHAIN_REACH);
        chain.push(Hop { distance: track.distance, sure: 1.0 });
        let near = neighbours.of(seed);
        let onward: [(&[Hop], f64); NEIGHBOURS] = std::array::from_fn(|k| {
            near.get(k).map_or((&[][..], 0.0), |near| (beyond.of(near.seed as usize), near.weight))
        });
        for hop in 0..CHAIN_REACH - 1 {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (chain, near) in &onward {
                if let Some(next) = chain.get(hop) {
                    sum += near * next.sure * next.distance;
                    weight += near * next.sure;
                }
            }
            let sure = track.kept * weight;
            if sure < UNSURE {
                break;
            }
            chain.push(Hop { distance: track.distance + sum / weight, sure });
        }
        chain
    };
    Lists::new(&side.tracks.par_iter().enumerate().map(chain).collect::<Vec<_>>())
}

/// The slope of `natural` or `catmull` at a knot around which gaps are [`UNLIKE`], no steeper than a course that goes [`STEEPEST`] times the way to the
/// farther neighbour in the wider gap beside it. A natural spline's slope at an end is made from its neighbour's, so that what is beside that one counts,
/// too. Elsewhere the spline is the spline.
fn bounded(m: f64, [z, s]: [&[f64]; 2], center: usize, rule: SlopeRule) -> f64 {
    if !matches!(rule, SlopeRule::Natural | SlopeRule::Catmull) {
        return m;
    }
    let told_by = if rule == SlopeRule::Natural { center.clamp(1, z.len().max(3) - 2) } else { center };
    let (first, end) = (center.min(told_by).saturating_sub(2), (center.max(told_by) + 3).min(z.len()));
    let gaps = z[first..end].windows(2).map(|pair| pair[1] - pair[0]);
    let (narrowest, widest) = gaps.fold((f64::INFINITY, 0.0f64), |(low, high), gap| (low.min(gap), high.max(gap)));
    if widest <= UNLIKE * narrowest {
        return m;
    }
    let beside = [center.checked_sub(1), (center + 1 < z.len()).then_some(center + 1)];
    let reach = |(far, wide): (f64, f64), k: usize| (far.max(s[k].abs()), wide.max((z[k] - z[center]).abs()));
    let (far, wide) = beside.into_iter().flatten().fold((0.0, 0.0), reach);
    let most = if wide > 0.0 { STEEPEST * far / wide } else { 0.0 };
    m.clamp(-most, most)
}

/// How many hops of a chain count, each number with the share to which it is so many.
fn lengths(chain: &[Hop]) -> impl Iterator<Item = (usize, f64)> {
    let sure = |n: usize| chain.get(n).map_or(0.0, |hop| hop.sure);
    let shares = (0..=chain.len()).map(move |n| (n, if n == 0 { 1.0 } else { sure(n - 1) } - sure(n)));
    shares.filter(|(_, share)| *share > UNSURE)
}

fn slopes_of(
    i: usize,
    heights: &[f64],
    [below, above]: [Option<&SideTracks>; 2],
    [down, up]: [&Chains; 2],
    [px, doubt]: [f64; 2],
    settings: &Settings,
) -> Vec<f64> {
    let clamped = match i {
        0 => settings.clamp_bottom,
        _ if i + 1 == heights.len() => settings.clamp_top,
        _ => None,
    };
    let lone = |side: Option<&SideTracks>, k: usize| side.is_none_or(|s| s.lone[k]);
    let slope = |(z, s): &mut (Vec<f64>, Vec<f64>), k: usize| {
        if let Some(m) = clamped {
            return m / px;
        }
        if lone(below, k) && lone(above, k) {
            return 0.0; // nothing to go by: a round cap on both sides
        }
        z.clear();
        s.clear();
        for (hop, v) in down.of(k).iter().enumerate().rev() {
            z.push(heights[i - 1 - hop] - heights[i]);
            s.push(v.distance);
        }
        let center = z.len();
        z.push(0.0);
        s.push(0.0);
        for (hop, v) in up.of(k).iter().enumerate() {
            z.push(heights[i + 1 + hop] - heights[i]);
            s.push(v.distance);
        }
        // The mean of the slopes of all chains that end somewhere on the way, by how likely it is that they do.
        let (mut sum, mut weight) = (0.0, 0.0);
        for (below, unlike) in lengths(down.of(k)) {
            for (above, like) in lengths(up.of(k)) {
                let knots = center - below..center + above + 1;
                let (rule, end) = (settings.slope, settings.spline_end());
                let m = settled_slope(&z[knots.clone()], &s[knots], below, rule, end, doubt);
                sum += unlike * like * m;
                weight += unlike * like;
            }
        }
        bounded(sum / weight, [z, s], center, settings.slope)
    };
    (0..down.ends.len()).into_par_iter().map_init(Default::default, slope).collect()
}

/// The course of seed `k` of a contour towards its neighbour `next`, `gap` away.
pub fn course(
    own: &Fitted,
    track: &Track,
    next: &Fitted,
    k: usize,
    direction: Direction,
    gap: f64,
    rule: SlopeRule,
) -> HermiteArc {
    let (neighbours, sign) = match direction {
        Direction::Down => (own.down.of(k), -1.0),
        Direction::Up => (own.up.of(k), 1.0),
    };
    let s = track.distance;
    let ok = track.kept;
    if rule == SlopeRule::Linear {
        return [s, s, s, ok];
    }
    let m0 = own.slopes[k] * gap * sign;
    let landing = neighbours.iter().map(|near| near.weight * next.slopes[near.seed as usize]).sum::<f64>() * gap * sign;
    let m1 = ok * landing + (1.0 - ok) * DEAD_PARTICLE_END_SLOPE * s;
    match rule {
        SlopeRule::Pchip | SlopeRule::Hyman => monotone([s, m0, m1, ok]),
        _ => [s, m0, m1, ok],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_natural_slope_has_a_bound_where_its_own_gaps_or_those_of_the_neighbour_that_tells_it_are_unlike() {
        let s = [0.0, 1.0, 2.0, 3.0, 4.0];
        let most = |gaps: [f64; 4], center: usize, rule: SlopeRule| {
            let z: Vec<f64> = (0..5).map(|k| gaps[..k].iter().sum()).collect();
            bounded(100.0, [&z, &s.map(|v| v - s[center])], center, rule)
        };
        let (alike, third) = ([8.0, 4.0, 3.0, 2.5], [8.0, 4.0, 0.5, 2.5]);
        assert_eq!(most(alike, 0, SlopeRule::Natural), 100.0);
        // Three ways of 1 px in a gap of 8.
        assert_eq!(most(third, 0, SlopeRule::Natural), 0.375);
        assert_eq!(most([2.5, 0.5, 4.0, 8.0], 4, SlopeRule::Natural), 0.375);
        assert_eq!(most(third, 1, SlopeRule::Natural), 0.375);
        assert_eq!(most(third, 0, SlopeRule::Catmull), 100.0, "a parabola through three knots");
        assert_eq!(most(third, 0, SlopeRule::Hyman), 100.0, "bounded already");
    }

    #[test]
    fn a_course_lands_with_the_slope_there_and_leaves_fast_where_its_particle_died() {
        let own = |slope: f64| {
            let near = Lists::new(&[vec![Weighted { seed: 0, weight: 0.25 }, Weighted { seed: 1, weight: 0.75 }]]);
            Fitted { slopes: vec![slope], down: near.clone(), up: near }
        };
        let next = Fitted { slopes: vec![4.0, 8.0], ..Fitted::default() };
        let at = |kept: f64, direction: Direction, rule: SlopeRule| {
            let track = Track { distance: 2.0, arc: 2.0, landing: DVec2::ZERO, kept };
            course(&own(3.0), &track, &next, 0, direction, 0.5, rule)
        };
        let natural = |kept: f64| at(kept, Direction::Up, SlopeRule::Natural);
        assert_eq!(natural(1.0), [2.0, 1.5, 3.5, 1.0]);
        assert_eq!(natural(0.0), [2.0, 1.5, 6.0, 0.0], "three times the way");
        assert_eq!(natural(0.5), [2.0, 1.5, 4.75, 0.5]);
        assert_eq!(at(1.0, Direction::Down, SlopeRule::Natural), [2.0, -1.5, -3.5, 1.0]);
        assert_eq!(at(0.5, Direction::Up, SlopeRule::Linear), [2.0, 2.0, 2.0, 0.5]);
    }
}
