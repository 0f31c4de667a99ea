//! Rigid frames of single parts made one displacement: each part's own motion all along its way, and between the parts something between.
//!
//! A node at distance `d_k` from the way of body k (from its place on the lower slice to that on the upper) gets the mean of the bodies' motions
//! with weights `1 / (max(d_k - 4, 0) + 1/4)^2`. What stands still is a body too. A body alone in the image takes all of it along. A part that
//! goes into a much larger one is a body by itself; the larger one stands still but for where the other arrives.

use glam::DVec2;

use super::leaps::is_compact;
use crate::contour::Contour;
use crate::contour::overlap::{DecidedPairs, match_components};
use crate::grid::field::position;
use crate::reference::exact::exact_distance;
use crate::registration::displacement::{BLOCK, Displacement};
use crate::registration::rigid::Rigid;

/// Within this distance of its way a body's motion is nearly its own, px.
const RIM: f64 = 4.0;
/// Distance that counts as none, px.
const NEAR: f64 = 0.25;
/// A large part gives way to a small one that comes into it this many times as far as that one moves: from there to where it stands still
/// the displacement changes by about a pixel per pixel.
const GIVES_WAY: f64 = 2.0;
/// A motion this close to the one asked for is the same, px.
const FOLLOWED: f64 = 1.0;
/// A part that has another one nearer than this to its way gets no frame unless it is linked, px.
const ISOLATED: f64 = 8.0;

/// Dice coefficient of two parts where they lie up to which they lie apart. With half and twice of it the same is found: it saves looking at what lies together.
const APART: f64 = 0.5;

/// Turn, `2 tan(theta / 2)`, beyond which a part that lies apart is not taken along: it would go along chords, and what turns so far in a gap slides along
/// itself (`sliding`). A coil of pitch 15 that begins in the stack, every 5th slice, has 0.94 of Dice with a bound of 0.5, 29 degrees, and 0.88 without.
const MOST_TURN: f64 = 0.5;

/// A part below and one above that move as one.
struct Body {
    parts: (u32, u32),
    rigid: Rigid,
    /// Whether the part below and the part above move as a whole.
    whole: [bool; 2],
    /// Distance of each node from its way, px.
    away: Vec<f64>,
}

/// Two slices and the nodes of their image.
struct Slices<'c> {
    low: &'c Contour,
    high: &'c Contour,
    nodes: Displacement,
    h: [f64; 2],
}

/// The displacement of an interval.
#[derive(Debug, Clone)]
pub struct Frames {
    /// Zero where nothing moves.
    pub displacement: Displacement,
    /// For each link the share of its parts' pixels that half way have the motion that the link asks for.
    pub followed: Vec<f64>,
}

/// The displacement that takes every linked part to its partner.
pub fn linked(low: &Contour, high: &Contour, links: &[(u32, u32)], h: [f64; 2]) -> Frames {
    let slices = Slices::new(low, high, h);
    slices.frames(links.iter().map(|&pair| slices.body(pair).0).collect(), links.len())
}

/// Frames of links, and of every group of one part below and one above that is isolated and gains by it.
pub fn rigid(low: &Contour, high: &Contour, links: &[(u32, u32)], h: [f64; 2]) -> Frames {
    let slices = Slices::new(low, high, h);
    let bodies = slices.singles(links, |_| true).filter(|body| slices.isolated(body));
    slices.frames(slices.linked(links).chain(bodies).collect(), links.len())
}

/// A displacement of parts that lie apart though they overlap.
pub struct Apart {
    /// It, with that of links.
    pub displacement: Displacement,
    /// Mean of the areas of these parts on both slices, pixels.
    pub area: f64,
}

/// Frames of the same groups and of links, of those groups of which both parts lie apart and are not compact: so far a search near where they lie may not
/// see, and their walls meet other ones. None where there are no such groups.
pub fn apart(low: &Contour, high: &Contour, links: &[(u32, u32)], h: [f64; 2]) -> Option<Apart> {
    let slices = Slices::new(low, high, h);
    let apart = slices.singles(links, |pair| slices.lie_apart(pair));
    let bodies: Vec<Body> = apart.filter(|body| body.rigid.turn.abs() <= MOST_TURN).collect();
    if bodies.is_empty() {
        return None;
    }
    let area = |body: &Body| positions(low, body.parts.0).count() + positions(high, body.parts.1).count();
    let area = 0.5 * bodies.iter().map(area).sum::<usize>() as f64;
    let displacement = slices.frames(slices.linked(links).chain(bodies).collect(), links.len()).displacement;
    Some(Apart { displacement, area })
}

impl<'c> Slices<'c> {
    fn new(low: &'c Contour, high: &'c Contour, h: [f64; 2]) -> Self {
        Slices { low, high, nodes: Displacement::zero(low.phi.dims), h }
    }

    /// The bodies of links.
    fn linked<'s>(&'s self, links: &'s [(u32, u32)]) -> impl Iterator<Item = Body> + 's {
        links.iter().map(|&pair| self.body(pair).0)
    }

    /// Groups of one part below and one above, not linked and such as `wanted`, that gain by a frame.
    fn singles<'s>(
        &'s self,
        links: &[(u32, u32)],
        wanted: impl Fn((u32, u32)) -> bool + 's,
    ) -> impl Iterator<Item = Body> + 's {
        let [low, high] = [self.low, self.high].map(|contour| (&contour.solids, &contour.phi));
        let groups = match_components(low, high, &DecidedPairs::joining(links)).groups;
        let single = groups.iter().filter(|g| g.low.len() == 1 && g.high.len() == 1).map(|g| (g.low[0], g.high[0]));
        let single: Vec<(u32, u32)> = single.filter(|pair| !links.contains(pair)).collect();
        let bodies = single.into_iter().filter(move |pair| wanted(*pair)).map(|pair| self.body(pair));
        bodies.filter(|(_, worthwhile)| *worthwhile).map(|(body, _)| body)
    }

    /// Whether two parts, not both compact, have little in common where they lie.
    fn lie_apart(&self, (from, to): (u32, u32)) -> bool {
        let [nx, _] = self.low.phi.dims;
        let own: Vec<DVec2> = positions(self.low, from).collect();
        let there = |x: &&DVec2| self.high.solids.labels[x.y as usize * nx + x.x as usize] == to;
        let common = own.iter().filter(there).count();
        let sizes = [own.len(), positions(self.high, to).count()];
        let depths = [self.low.solid_depth[from as usize], self.high.solid_depth[to as usize]];
        let are_compact = [0, 1].map(|k| is_compact(sizes[k], depths[k], self.h));
        are_compact != [true; 2] && 2.0 * common as f64 <= APART * sizes.iter().sum::<usize>() as f64
    }

    /// Distance of every node from those that are marked, px.
    fn distance(&self, marked: &[bool]) -> Vec<f64> {
        exact_distance(marked, self.nodes.grid, self.h.map(|side| side * BLOCK as f64)).data
    }

    /// The pair as a body, and whether its motion is worthwhile.
    fn body(&self, parts: (u32, u32)) -> (Body, bool) {
        let found = Rigid::between((self.low, parts.0), (self.high, parts.1), self.h);
        let shift = found.rigid.shift;
        let steps = (shift.abs().max_element() / BLOCK as f64).ceil().max(1.0);
        let ends = [(self.low, parts.0, 1.0), (self.high, parts.1, -1.0)];
        let sizes = ends.map(|(contour, part, _)| positions(contour, part).count());
        let whole = [0, 1].map(|end| found.alike || sizes[end] < sizes[1 - end]);
        let mut way = vec![false; self.nodes.vectors.len()];
        for ((contour, part, sign), _) in ends.into_iter().zip(whole).filter(|(_, whole)| *whole) {
            for x in positions(contour, part) {
                for step in 0..=steps as usize {
                    let s = sign * step as f64 / steps;
                    self.nodes.nearest(x + s * shift).for_each(|k| way[k] = true);
                }
            }
        }
        (Body { parts, rigid: found.rigid, whole, away: self.distance(&way) }, found.worthwhile)
    }

    /// Whether no other part of either slice lies near the body's way.
    fn isolated(&self, body: &Body) -> bool {
        [(self.low, body.parts.0), (self.high, body.parts.1)].into_iter().all(|(contour, own)| {
            let nx = contour.phi.dims[0];
            let others = contour.solids.labels.iter().enumerate().filter(|(_, label)| **label > 0 && **label != own);
            let places = |n: usize| self.nodes.nearest(position(n, nx));
            others.flat_map(|(n, _)| places(n)).all(|k| body.away[k] >= ISOLATED)
        })
    }

    /// The displacement of all bodies, the first of which are linked.
    fn frames(&self, bodies: Vec<Body>, linked: usize) -> Frames {
        let zero = &self.nodes;
        if bodies.is_empty() {
            return Frames { displacement: zero.clone(), followed: Vec::new() };
        }
        let mut still = vec![false; zero.vectors.len()];
        let nx = self.low.phi.dims[0];
        for (contour, end) in [(self.low, 0), (self.high, 1)] {
            for (n, &label) in contour.solids.labels.iter().enumerate().filter(|(_, label)| **label > 0) {
                for k in zero.nearest(position(n, nx)) {
                    still[k] |= !bodies.iter().any(|body| body.takes(end, label, k, self.h));
                }
            }
        }
        let still = self.distance(&still);
        let weight = |away: f64| ((away - RIM).max(0.0) + NEAR).powi(-2);
        let vectors = (0..zero.vectors.len()).map(|k| {
            let (mut whole, mut sum) = (weight(still[k]), DVec2::ZERO);
            for body in &bodies {
                let w = weight(body.away[k]);
                whole += w;
                sum += w * body.rigid.at(zero.centre(k), self.h);
            }
            sum / whole
        });
        let displacement = zero.with(vectors.collect());
        let followed = bodies[..linked].iter().map(|body| self.followed(body, &displacement)).collect();
        Frames { displacement, followed }
    }

    /// Share of a body's pixels that half way have its own motion.
    fn followed(&self, body: &Body, displacement: &Displacement) -> f64 {
        let (mut all, mut there) = (0, 0);
        let ends = [(self.low, body.parts.0, 0.5), (self.high, body.parts.1, -0.5)];
        for ((contour, part, sign), _) in ends.into_iter().zip(body.whole).filter(|(_, whole)| *whole) {
            for x in positions(contour, part) {
                let middle = x + sign * body.rigid.shift;
                let off = DVec2::from(self.h) * (displacement.at(middle) - body.rigid.at(middle, self.h));
                all += 1;
                there += usize::from(libm::hypot(off.x, off.y) < FOLLOWED);
            }
        }
        there as f64 / all.max(1) as f64
    }
}

impl Body {
    /// Whether node `k` of part `label` of the lower (0) or upper (1) slice goes with the body: all of it if it moves as a whole, else
    /// what is near the body's way.
    fn takes(&self, end: usize, label: u32, k: usize, h: [f64; 2]) -> bool {
        let shift = DVec2::from(h) * self.rigid.shift;
        label == [self.parts.0, self.parts.1][end]
            && (self.whole[end] || self.away[k] < GIVES_WAY * libm::hypot(shift.x, shift.y))
    }
}

/// Pixels of a part.
fn positions(contour: &Contour, part: u32) -> impl Iterator<Item = DVec2> + '_ {
    let (low, high) = contour.solid_box[part as usize];
    let nx = contour.phi.dims[0];
    let of_row = move |j: usize| {
        let here = move |&i: &usize| contour.solids.labels[j * nx + i] == part;
        (low[0]..=high[0]).filter(here).map(move |i| DVec2::new(i as f64, j as f64))
    };
    (low[1]..=high[1]).flat_map(of_row)
}

/// Share of a part's pixels that lie in the other one along the trajectories, of the part that has more of them; `at_slices` is the
/// displacement read at both slices, `None` where slices stay in place.
pub fn meeting(low: &Contour, high: &Contour, (from, to): (u32, u32), at_slices: Option<&[Displacement; 2]>) -> f64 {
    let share = |(own, part): (&Contour, u32), (other, wanted): (&Contour, u32), end: usize, sign: f64| {
        let [nx, ny] = own.phi.dims;
        let (mut all, mut there) = (0, 0);
        for x in positions(own, part) {
            let y = at_slices.map_or(x, |at| x + sign * at[end].at(x));
            let DVec2 { x: i, y: j } = y.round();
            let within = i >= 0.0 && j >= 0.0 && i < nx as f64 && j < ny as f64;
            all += 1;
            there += usize::from(within && other.solids.labels[j as usize * nx + i as usize] == wanted);
        }
        there as f64 / all.max(1) as f64
    };
    share((low, from), (high, to), 0, 1.0).max(share((high, to), (low, from), 1, -1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    const DIMS: [usize; 2] = [140, 90];

    /// Discs with these middles and radii; parts are numbered by their lowest rows.
    fn discs(discs: &[(DVec2, f64)]) -> Contour {
        let value = |i: usize, j: usize| {
            let away =
                |(middle, radius): &(DVec2, f64)| middle.distance(DVec2::new(i as f64, j as f64)) - radius + 1e-9;
            discs.iter().map(away).fold(f64::INFINITY, f64::min)
        };
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    #[test]
    fn between_a_body_and_what_stands_still_the_nearer_counts_more() {
        let (still, shift) = ((DVec2::new(100.0, 60.0), 6.0), DVec2::new(10.0, 4.0));
        let [low, high] = [DVec2::ZERO, shift].map(|by| discs(&[(DVec2::new(30.0, 30.0) + by, 6.0), still]));
        let displacement = linked(&low, &high, &[(1, 1)], [1.0; 2]).displacement;
        let slices = Slices::new(&low, &high, [1.0; 2]);
        let [moving, resting] = [(1, 1), (2, 2)].map(|pair| slices.body(pair).0);
        assert!(moving.rigid.shift.distance(shift) < 0.1 && resting.rigid.shift.length() < 0.1);
        let weight = |d: f64| if d <= 4.0 { 16.0 } else { 1.0 / (d - 3.75).powi(2) };
        for (k, v) in displacement.vectors.iter().enumerate() {
            let (own, other) = (weight(moving.away[k]), weight(resting.away[k]));
            let expected = own / (own + other) * moving.rigid.shift;
            assert!(v.distance(expected) < 1e-9, "node {k}: {v}, not {expected}");
        }
    }

    #[test]
    fn a_part_moves_by_itself_where_no_other_is_near_its_way() {
        let from = (DVec2::new(30.0, 30.0), 8.0);
        let to = (DVec2::new(38.0, 30.0), 8.0);
        for (other, moves) in [(DVec2::new(100.0, 60.0), true), (DVec2::new(38.0, 46.0), false)] {
            let [low, high] = [from, to].map(|own| discs(&[own, (other, 4.0)]));
            let displacement = rigid(&low, &high, &[], [1.0; 2]).displacement;
            assert_eq!(displacement.largest() > 7.0, moves, "beside {other}: {}", displacement.largest());
            assert_eq!(displacement.largest() > 0.0, moves, "beside {other}");
        }
    }
}
