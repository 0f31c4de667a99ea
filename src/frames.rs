//! Rigid frames of single parts made one displacement: each part's own motion all along its way, and between the parts something between.
//!
//! A block at distance `d_k` from the way of body k (from its place on the lower slice to that on the upper) gets the mean of the bodies' motions
//! with weights `1 / (max(d_k - 4, 0) + 1/4)^2`. What stands still is a body too. A body alone in the image takes all of it along.

use crate::contours::Contour;
use crate::displacement::{BLOCK, Displacement};
use crate::reference::exact::exact_distance;
use crate::rigid::Rigid;
use crate::topology::{Decided, match_components};

/// Within this distance of its way a body's motion is nearly its own, px.
const RIM: f64 = 4.0;
/// Distance that counts as none, px.
const NEAR: f64 = 0.25;
/// A part that has another one nearer than this to its way gets no frame unless it is linked, px.
const ISOLATED: f64 = 8.0;

/// A part below and one above that move as one.
struct Body {
    parts: (u32, u32),
    rigid: Rigid,
    /// Distance of each block from its way, px.
    away: Vec<f64>,
}

/// Two slices and the blocks of their image.
struct Slices<'c> {
    low: &'c Contour,
    high: &'c Contour,
    grid: [usize; 2],
    h: [f64; 2],
}

/// The displacement that takes every linked part to its partner; zero where nothing is linked.
pub fn linked(low: &Contour, high: &Contour, links: &[(u32, u32)], h: [f64; 2]) -> Displacement {
    let slices = Slices::new(low, high, h);
    slices.displacement(links.iter().map(|&pair| slices.body(pair).0).collect())
}

/// The same with a frame for every group of one part below and one above that is isolated and gains by it.
pub fn rigid(low: &Contour, high: &Contour, links: &[(u32, u32)], h: [f64; 2]) -> Displacement {
    let slices = Slices::new(low, high, h);
    let groups = match_components((&low.solids, &low.phi), (&high.solids, &high.phi), &Decided::joining(links)).groups;
    let single = groups.iter().filter(|g| g.low.len() == 1 && g.high.len() == 1).map(|g| (g.low[0], g.high[0]));
    let mut bodies: Vec<Body> = links.iter().map(|&pair| slices.body(pair).0).collect();
    for pair in single.filter(|pair| !links.contains(pair)) {
        let (body, worthwhile) = slices.body(pair);
        if worthwhile && slices.isolated(&body) {
            bodies.push(body);
        }
    }
    slices.displacement(bodies)
}

impl<'c> Slices<'c> {
    fn new(low: &'c Contour, high: &'c Contour, h: [f64; 2]) -> Self {
        Slices { low, high, grid: Displacement::zero(low.phi.dims).grid, h }
    }

    /// Block of a position of the image.
    fn block(&self, x: [f64; 2]) -> usize {
        let [i, j]: [usize; 2] =
            std::array::from_fn(|a| ((x[a] + 0.5).max(0.0) as usize / BLOCK).min(self.grid[a] - 1));
        j * self.grid[0] + i
    }

    /// Distance of every block from those that are marked, px.
    fn distance(&self, marked: &[bool]) -> Vec<f64> {
        exact_distance(marked, self.grid, self.h.map(|side| side * BLOCK as f64)).data
    }

    /// The pair as a body, and whether its motion is worthwhile.
    fn body(&self, parts: (u32, u32)) -> (Body, bool) {
        let found = Rigid::between((self.low, parts.0), (self.high, parts.1), self.h);
        let shift = found.rigid.shift;
        let steps = (shift[0].abs().max(shift[1].abs()) / BLOCK as f64).ceil().max(1.0);
        let mut way = vec![false; self.grid[0] * self.grid[1]];
        for (contour, part, sign) in [(self.low, parts.0, 1.0), (self.high, parts.1, -1.0)] {
            for x in positions(contour, part) {
                for step in 0..=steps as usize {
                    let s = sign * step as f64 / steps;
                    way[self.block([x[0] + s * shift[0], x[1] + s * shift[1]])] = true;
                }
            }
        }
        (Body { parts, rigid: found.rigid, away: self.distance(&way) }, found.worthwhile)
    }

    /// Whether no other part of either slice lies near the body's way.
    fn isolated(&self, body: &Body) -> bool {
        [(self.low, body.parts.0), (self.high, body.parts.1)].into_iter().all(|(contour, own)| {
            let nx = contour.phi.dims[0];
            let others = contour.solids.labels.iter().enumerate().filter(|(_, label)| **label > 0 && **label != own);
            let place = |n: usize| self.block([(n % nx) as f64, (n / nx) as f64]);
            others.map(|(n, _)| body.away[place(n)]).all(|away| away >= ISOLATED)
        })
    }

    fn displacement(&self, bodies: Vec<Body>) -> Displacement {
        let zero = Displacement::zero(self.low.phi.dims);
        if bodies.is_empty() {
            return zero;
        }
        let mut still = vec![false; self.grid[0] * self.grid[1]];
        let nx = self.low.phi.dims[0];
        let moves = |part: u32, own: fn(&Body) -> u32| bodies.iter().any(|b| own(b) == part);
        let low: Vec<bool> = (0..=self.low.solids.count as u32).map(|p| p == 0 || moves(p, |b| b.parts.0)).collect();
        let high: Vec<bool> = (0..=self.high.solids.count as u32).map(|p| p == 0 || moves(p, |b| b.parts.1)).collect();
        for (contour, moves) in [(self.low, low), (self.high, high)] {
            let others = contour.solids.labels.iter().enumerate().filter(|(_, label)| !moves[**label as usize]);
            for (n, _) in others {
                still[self.block([(n % nx) as f64, (n / nx) as f64])] = true;
            }
        }
        let still = self.distance(&still);
        let weight = |away: f64| ((away - RIM).max(0.0) + NEAR).powi(-2);
        let vectors = (0..zero.vectors.len()).map(|k| {
            let (mut whole, mut sum) = (weight(still[k]), [0.0; 2]);
            for body in &bodies {
                let w = weight(body.away[k]);
                let v = body.rigid.at(zero.centre(k), self.h);
                whole += w;
                sum = [sum[0] + w * v[0], sum[1] + w * v[1]];
            }
            sum.map(|s| s / whole)
        });
        Displacement { grid: zero.grid, vectors: vectors.collect() }
    }
}

/// Pixels of a part.
fn positions(contour: &Contour, part: u32) -> impl Iterator<Item = [f64; 2]> + '_ {
    let (low, high) = contour.solid_box[part as usize];
    let nx = contour.phi.dims[0];
    let of_row = move |j: usize| {
        let here = move |&i: &usize| contour.solids.labels[j * nx + i] == part;
        (low[0]..=high[0]).filter(here).map(move |i| [i as f64, j as f64])
    };
    (low[1]..=high[1]).flat_map(of_row)
}
