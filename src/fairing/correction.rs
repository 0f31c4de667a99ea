//! What a node moves by: its difference `K v - v - P` less what the contours of its interval would move by, read along the trajectories.

use std::ops::Range;

use glam::DVec2;
use rayon::prelude::*;

use super::along::{add, read_beside};
use super::kept::{Near, Node, Transformed};
use super::level::MetContour;
use super::limit::{goes_on, limited};
use super::near::{SATURATED, fade, nearer, nearness, widest};
use super::plane::Plane;
use super::thin::Thin;
use super::{Fairing, FairingSpec, in_pool};
use crate::grid::sparse_image::SparseImage;
use crate::grid::spline::smoothstep;
use crate::registration::displacement::{Displacement, Resting};
use crate::stack::heights::NODES;

impl Fairing<'_> {
    /// Offsets of the trajectories from node `k` to node `l` in the blocks near its surface, px of the image; `None` where they stand still.
    fn offsets(&self, k: usize, l: usize) -> Option<Displacement> {
        let (_, pad) = self.spec.moving.filter(|_| k != l)?;
        let (from, to) = (self.node(k)?.made.as_ref()?, self.node(l)?.place()?);
        let (near, from) = (&from.near, from.place.as_ref()?);
        // The lowest node of every interval between both is among those that are kept.
        let intervals = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let of = |i| self.kept.iter().filter_map(Node::place).find(|place| place.interval == i);
        let between: Vec<&[Resting; 2]> = intervals.filter_map(of).map(|place| &*place.at_slices).collect();
        let mut offsets = Displacement::zero(self.spec.dims);
        let offset = |&(block, slices): &Near| {
            from.carry(slices, to, &between) - DVec2::from(pad.map(|p| p as f64)) - offsets.centre(block)
        };
        let found: Vec<DVec2> = near.par_iter().map(offset).collect();
        near.iter().zip(found).for_each(|((block, _), offset)| offsets.vectors[*block] = offset);
        Some(offsets)
    }

    /// `K v - v - P` at node `k`, zero far from its surface.
    fn difference(&self, k: usize) -> SparseImage<f32> {
        let dims = self.spec.dims;
        let Some(own) = self.node(k).and_then(|node| node.made.as_ref()) else { return SparseImage::filled(dims, 0.0) };
        let at_contour = self.nodes.contour(k).is_some();
        let far = self.bound() * widest(at_contour);
        let term = |(l, w): (usize, f64)| {
            let other = self.node(l).and_then(|node| node.made.as_ref())?;
            Some((&other.v, w as f32, self.offsets(k, l)))
        };
        let terms: Vec<(&SparseImage<f32>, f32, Option<Displacement>)> =
            self.nodes.weights(k).into_iter().filter_map(term).collect();
        let plane = Plane::new(&self.nodes, k, self.bound(), self.spec.rugged);
        let beside = self.nodes.beside(k).map(|l| term((l, 1.0)));
        let nowhere = |square: [usize; 2]| own.squares.is_far(square).then_some([0.0]);
        let [difference] = SparseImage::of_stretches(dims, nowhere, |[left, first], width, [rows]: [&mut [f32]; 1]| {
            let mut row = vec![0.0; width];
            let mut there: [Vec<f32>; 2] = Default::default();
            for (j, out) in (first..).zip(rows.chunks_exact_mut(width)) {
                own.v.read(left, j, &mut row);
                for pixels in nearer(&row, far) {
                    let (out, row) = (&mut out[pixels.clone()], &row[pixels.clone()]);
                    out.iter_mut().zip(row).for_each(|(sum, own)| *sum = -own);
                    for (v, w, offsets) in &terms {
                        add(v, *w, offsets.as_ref(), j, left + pixels.start, out);
                    }
                    if let Some(plane) = &plane {
                        for (there, term) in there.iter_mut().zip(&beside) {
                            there.clear();
                            match term {
                                Some((v, w, offsets)) => {
                                    there.resize(row.len(), 0.0);
                                    add(v, *w, offsets.as_ref(), j, left + pixels.start, there);
                                }
                                None => there.extend_from_slice(row),
                            }
                        }
                        plane.take_off(row, [&there[0], &there[1]], out);
                    }
                    if at_contour {
                        let fading = out.iter_mut().zip(row);
                        fading.for_each(|(sum, own)| *sum *= fade(own.abs() / self.bound()) as f32);
                    }
                }
            }
        });
        difference
    }

    /// Makes the corrections of the nodes of some intervals.
    pub(super) fn correct(&mut self, intervals: Range<usize>) {
        if intervals.is_empty() {
            return;
        }
        let contours = (intervals.start..=intervals.end).map(|i| NODES * i);
        let unknown: Vec<usize> = contours.filter(|k| self.node(*k).is_some_and(|n| n.difference.is_none())).collect();
        for some in unknown.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|&k| self.difference(k)).collect::<Vec<_>>();
            for (&k, made) in some.iter().zip(in_pool(made)) {
                if let Some(node) = self.node_mut(k) {
                    node.difference = Some(made);
                }
            }
        }
        let between: Vec<usize> = (NODES * intervals.start..NODES * intervals.end).filter(|k| k % NODES != 0).collect();
        for some in between.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|&k| self.correction(k)).collect::<Vec<_>>();
            for (&k, made) in some.iter().zip(in_pool(made)) {
                if let Some(node) = self.node_mut(k) {
                    node.correction = made;
                }
            }
        }
        // The next interval begins with the upper one of the last.
        for i in intervals {
            if let Some(node) = self.node_mut(NODES * i) {
                node.difference = None;
            }
        }
    }

    /// Correction of node `k`: its own difference less what the contours below and above would move by, read along the trajectories where they have
    /// the node's distances.
    fn correction(&self, k: usize) -> Option<SparseImage<f32>> {
        let i = k / NODES;
        let ends = [NODES * i, NODES * (i + 1)];
        let node = self.node(k)?;
        let Transformed { v, gradient, squares, .. } = node.made.as_ref()?;
        let [low, high] = [self.node(ends[0])?, self.node(ends[1])?];
        let [at_low, at_high] = [low.difference.as_ref()?, high.difference.as_ref()?];
        let d = self.difference(k);
        let offsets = ends.map(|end| self.offsets(k, end));
        // What lies on the other side of either contour.
        let beyond = [ends[0].checked_sub(NODES), Some(ends[1] + NODES)];
        let beyond = beyond.map(|end| end.and_then(|end| Some((&self.node(end)?.phi, self.offsets(k, end)))));
        let t = (k - ends[0]) as f64 / NODES as f64;
        let (first, last) = (i == 0, i + 1 == self.nodes.intervals());
        let at_first = if first && self.spec.steered[0] { smoothstep(t) } else { 1.0 };
        let at_last = if last && self.spec.steered[1] { smoothstep(1.0 - t) } else { 1.0 };
        let alpha = (at_first * at_last * self.spec.alpha) as f32;
        let (w, bound, nx) = (smoothstep(t) as f32, self.bound(), self.spec.dims[0]);
        let nowhere = |square: [usize; 2]| squares.is_far(square).then_some([0.0]);
        let shares = self.spec.shares.get(i).and_then(Option::as_ref);
        let side = self.side as f32;
        let [correction] = SparseImage::of_stretches(self.spec.dims, nowhere, |[left, first], width, [rows]| {
            let [mut own, mut slope, mut here, mut own_d] = [const { Vec::new() }; 4];
            [&mut own, &mut slope, &mut here, &mut own_d].into_iter().for_each(|line| line.resize(width, 0.0));
            // Both contours' differences and distances along the trajectories, their distances straight along z, and those of the contours beyond.
            let mut there: [Vec<f32>; 8] = Default::default();
            let mut ways = Vec::new();
            // Without a frame that follows them only means join what moves by its own width.
            let mut thin = self.spec.moving.map(|_| Thin::new(&node.phi, self.spec.spacing));
            let mut counts = Vec::new();
            for (j, out) in (first..).zip(rows.chunks_exact_mut(width)) {
                v.read(left, j, &mut own);
                gradient.read(left, j, &mut slope);
                d.read(left, j, &mut own_d);
                for pixels in nearer(&own, SATURATED * bound) {
                    let begin = left + pixels.start;
                    there.iter_mut().for_each(|there| {
                        there.clear();
                        there.resize(pixels.len(), 0.0);
                    });
                    let [low_d, high_d, low_along, high_along, low_straight, high_straight, below, above] = &mut there;
                    add(&low.phi, 1.0, offsets[0].as_ref(), j, begin, low_along);
                    add(&high.phi, 1.0, offsets[1].as_ref(), j, begin, high_along);
                    node.phi.read(begin, j, &mut here[pixels.clone()]);
                    match &mut thin {
                        Some(thin) => thin.shares(&here[pixels.clone()], [begin, j], &mut counts),
                        None => counts.resize(pixels.len(), 1.0),
                    }
                    ways.resize(pixels.len(), DVec2::ZERO);
                    let contours =
                        [(&low.phi, &*low_along, at_low, &mut *low_d), (&high.phi, &*high_along, at_high, high_d)];
                    for ((phi, there, difference, out), offsets) in contours.into_iter().zip(&offsets) {
                        let FairingSpec { spacing, rugged, .. } = self.spec;
                        if rugged == 1.0 {
                            add(difference, 1.0, offsets.as_ref(), j, begin, out);
                            continue;
                        }
                        let contour = MetContour { phi, offsets: offsets.as_ref(), spacing, rugged };
                        contour.ways(&here[pixels.clone()], there, [begin, j], &mut ways);
                        read_beside(difference, offsets.as_ref(), &ways, [begin, j], out);
                    }
                    if self.spec.limited {
                        low.phi.read(begin, j, low_straight);
                        high.phi.read(begin, j, high_straight);
                    }
                    for (there, beyond) in [&mut *below, &mut *above].into_iter().zip(&beyond) {
                        if let Some((phi, offsets)) = beyond {
                            add(phi, 1.0, offsets.as_ref(), j, begin, there);
                        }
                    }
                    let on = |a: f32, b: f32| goes_on([a, b], self.spec.farthest);
                    for (p, n) in pixels.enumerate() {
                        let [low, high] = [low_along[p], high_along[p]];
                        // Whether the surface goes on to the contours beyond. Where it closes there its slope at the contour stays, and how it closes has no
                        // say: a tip would swell the layers on the other side. A stack's ends are no tips.
                        let on_below = if beyond[0].is_some() { on(low, below[p]) } else { 1.0 };
                        let on_above = if beyond[1].is_some() { on(high, above[p]) } else { 1.0 };
                        let mut share = on(low, high);
                        // A surface that ends in an interval still goes on if it does so from its contour to the other side: it is the tip of a body.
                        if low.abs() < high.abs() && beyond[0].is_some() {
                            share = share.max(on_below);
                        } else if high.abs() < low.abs() && beyond[1].is_some() {
                            share = share.max(on_above);
                        }
                        let alpha = alpha * shares.map_or(1.0, |s| s[j * nx + left + n]) * share * counts[p];
                        let ramps = (on_below + (1.0 - on_below) * w) * (on_above + (1.0 - on_above) * (1.0 - w));
                        let rise =
                            alpha * ramps * (own_d[n] - on_below * (1.0 - w) * low_d[p] - on_above * w * high_d[p]);
                        let c = slope[n] * rise * nearness(own[n].abs() / bound) as f32;
                        let ranges = [[low_along[p], high_along[p]], [low_straight[p], high_straight[p]]];
                        out[n] = if self.spec.limited { limited(c, here[n], ranges, side) } else { c };
                    }
                }
            }
        });
        Some(correction)
    }
}
