//! What a node moves by: its difference `K v - v - P` less what the contours of its interval would move by, read along the trajectories.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use glam::DVec2;
use rayon::prelude::*;

use super::along::{read, read_beside};
use super::difference::{Beside, Difference, Scratch, Term};
use super::kept::{Near, Node, Transformed};
use super::level::MetContour;
use super::near::{SATURATED, nearer, widest};
use super::plane::Plane;
use super::rise::{Lines, Rise, correct};
use super::thin::Thin;
use super::{Fairing, FairingSpec, in_pool};
use crate::grid::sparse_image::SparseImage;
use crate::grid::spline::smoothstep;
use crate::registration::displacement::{Displacement, Resting};
use crate::stack::heights::NODES;

/// Offsets of the trajectories from a node to others, where they do not stand still.
struct Ways(BTreeMap<usize, Displacement>);

impl Ways {
    /// Those to node `l`.
    fn to(&self, l: usize) -> Option<&Displacement> {
        self.0.get(&l)
    }
}

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

    /// Offsets of the trajectories from node `k` to these others, by their numbers, each once.
    fn ways(&self, k: usize, others: impl IntoIterator<Item = usize>) -> Ways {
        let others: BTreeSet<usize> = others.into_iter().collect();
        Ways(others.into_iter().filter_map(|l| Some((l, self.offsets(k, l)?))).collect())
    }

    /// The nodes that the difference of node `k` reads.
    fn differing(&self, k: usize) -> impl Iterator<Item = usize> + use<> {
        self.nodes.weights(k).into_iter().map(|(l, _)| l).chain(self.nodes.beside(k))
    }

    /// `K v - v - P` at node `k`, by the `ways` to those that it reads.
    fn difference<'f>(&'f self, k: usize, ways: &'f Ways) -> Difference<'f> {
        let v = |l: usize| self.node(l).and_then(|node| node.made.as_ref()).map(|made| &made.v);
        let term = |(l, w): (usize, f64)| Some((l, Term { v: v(l)?, w: w as f32, offsets: ways.to(l) }));
        let terms: Vec<(usize, Term<'_>)> = self.nodes.weights(k).into_iter().filter_map(term).collect();
        let beside = self.nodes.beside(k).map(|l| match terms.iter().position(|(of, _)| *of == l) {
            Some(t) => Beside::Term(t),
            None => term((l, 1.0)).map_or(Beside::Own, |(_, term)| Beside::Other(term)),
        });
        Difference {
            terms: terms.into_iter().map(|(_, term)| term).collect(),
            plane: Plane::new(&self.nodes, k, self.bound(), self.spec.rugged).map(|plane| (plane, beside)),
            fades: self.nodes.contour(k).is_some().then(|| self.bound()),
        }
    }

    /// `K v - v - P` at contour `k`, zero far from its surface.
    fn difference_at_contour(&self, k: usize) -> SparseImage<f32> {
        let dims = self.spec.dims;
        let Some(own) = self.node(k).and_then(|node| node.made.as_ref()) else { return SparseImage::filled(dims, 0.0) };
        let far = self.bound() * widest(true);
        let ways = self.ways(k, self.differing(k));
        let difference = self.difference(k, &ways);
        let nowhere = |square: [usize; 2]| own.squares.is_far(square).then_some([0.0]);
        let [differences] =
            SparseImage::of_stretches(dims, nowhere, |[left, first], width, [rows]: [&mut [f32]; 1]| {
                let (mut row, mut scratch) = (vec![0.0; width], Scratch::default());
                for (j, out) in (first..).zip(rows.chunks_exact_mut(width)) {
                    own.v.read(left, j, &mut row);
                    for pixels in nearer(&row, far) {
                        let at = [left + pixels.start, j];
                        difference.read(&row[pixels.clone()], at, &mut scratch, &mut out[pixels]);
                    }
                }
            });
        differences
    }

    /// Makes the corrections of the nodes of some intervals.
    pub(super) fn correct(&mut self, intervals: Range<usize>) {
        if intervals.is_empty() {
            return;
        }
        let contours = (intervals.start..=intervals.end).map(|i| NODES * i);
        let unknown: Vec<usize> = contours.filter(|k| self.node(*k).is_some_and(|n| n.difference.is_none())).collect();
        for some in unknown.chunks(self.at_once()) {
            let made = || some.into_par_iter().map(|&k| self.difference_at_contour(k)).collect::<Vec<_>>();
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
        // What lies on the other side of either contour.
        let beyond = [ends[0].checked_sub(NODES), Some(ends[1] + NODES)];
        let ways = self.ways(k, self.differing(k).chain(ends).chain(beyond.into_iter().flatten()));
        let difference = self.difference(k, &ways);
        let beyond = beyond.map(|end| end.and_then(|end| Some((&self.node(end)?.phi, ways.to(end)))));
        let FairingSpec { spacing, rugged, .. } = self.spec;
        let contours = [(low, at_low, ends[0]), (high, at_high, ends[1])];
        let contours = contours.map(|(node, difference, end)| {
            (MetContour { phi: &node.phi, offsets: ways.to(end), spacing, rugged }, difference)
        });
        let t = (k - ends[0]) as f64 / NODES as f64;
        let (first, last) = (i == 0, i + 1 == self.nodes.intervals());
        let at_first = if first && self.spec.steered[0] { smoothstep(t) } else { 1.0 };
        let at_last = if last && self.spec.steered[1] { smoothstep(1.0 - t) } else { 1.0 };
        let (bound, nx) = (self.bound(), self.spec.dims[0]);
        let rise = Rise {
            alpha: (at_first * at_last * self.spec.alpha) as f32,
            w: smoothstep(t) as f32,
            bound,
            farthest: self.spec.farthest,
            beyond: beyond.each_ref().map(Option::is_some),
            limited: self.spec.limited.then_some(self.side as f32),
        };
        let nowhere = |square: [usize; 2]| squares.is_far(square).then_some([0.0]);
        let shares = self.spec.shares.get(i).and_then(Option::as_ref);
        let [correction] = SparseImage::of_stretches(self.spec.dims, nowhere, |[left, first], width, [rows]| {
            let mut own = vec![0.0; rows.len()];
            let near: Vec<Vec<Range<usize>>> = (first..)
                .zip(own.chunks_exact_mut(width))
                .map(|(j, own)| {
                    v.read(left, j, own);
                    nearer(own, SATURATED * bound).collect()
                })
                .collect();
            // Both contours' distances along the trajectories.
            let met = contours.each_ref().map(|(contour, _)| contour.met([left, first], width, &near));
            let [mut slope, mut here, mut own_d] = [const { Vec::new() }; 3];
            [&mut slope, &mut here, &mut own_d].into_iter().for_each(|line| line.resize(width, 0.0));
            // Both contours' differences along the trajectories, their distances straight along z, and along the trajectories those of the contours beyond.
            let mut there: [Vec<f32>; 6] = Default::default();
            let (mut ways, mut scratch) = (Vec::new(), Scratch::default());
            // Without a frame that follows them only means join what moves by its own width.
            let mut thin = self.spec.moving.map(|_| Thin::new(&node.phi, spacing));
            let (mut kept, mut counts) = (Vec::new(), Vec::new());
            for (((j, out), own), near) in
                (first..).zip(rows.chunks_exact_mut(width)).zip(own.chunks_exact(width)).zip(near)
            {
                gradient.read(left, j, &mut slope);
                for pixels in near {
                    let begin = left + pixels.start;
                    difference.read(&own[pixels.clone()], [begin, j], &mut scratch, &mut own_d[pixels.clone()]);
                    there.iter_mut().for_each(|there| there.resize(pixels.len(), 0.0));
                    let [low_d, high_d, low_straight, high_straight, below, above] = &mut there;
                    let [low_along, high_along] = met.each_ref().map(|met| &met.row(j, begin)[..pixels.len()]);
                    node.phi.read(begin, j, &mut here[pixels.clone()]);
                    match &mut thin {
                        Some(thin) => thin.shares(&here[pixels.clone()], [begin, j], &mut counts),
                        None => counts.resize(pixels.len(), 1.0),
                    }
                    ways.resize(pixels.len(), DVec2::ZERO);
                    for (((contour, difference), met), out) in contours.iter().zip(&met).zip([&mut *low_d, high_d]) {
                        if rugged == 1.0 {
                            read(difference, contour.offsets, [begin, j], out);
                            continue;
                        }
                        contour.ways(met, &here[pixels.clone()], [begin, j], &mut ways);
                        read_beside(difference, contour.offsets, &ways, [begin, j], out);
                    }
                    if self.spec.limited {
                        low.phi.read(begin, j, low_straight);
                        high.phi.read(begin, j, high_straight);
                    }
                    for (there, beyond) in [&mut *below, &mut *above].into_iter().zip(&beyond) {
                        if let Some((phi, offsets)) = beyond {
                            read(phi, *offsets, [begin, j], there);
                        }
                    }
                    kept.clear();
                    match shares {
                        Some(shares) => kept.extend_from_slice(&shares[j * nx + begin..][..pixels.len()]),
                        None => kept.resize(pixels.len(), 1.0),
                    }
                    let lines = Lines {
                        own: [own, &here, &slope, &own_d].map(|line| &line[pixels.clone()]),
                        shares: [&kept, &counts],
                        along: [[low_along, low_d], [high_along, high_d]],
                        straight: [low_straight, high_straight],
                        beyond: [below, above],
                    };
                    correct(&rise, &lines, &mut out[pixels]);
                }
            }
        });
        Some(correction)
    }
}
