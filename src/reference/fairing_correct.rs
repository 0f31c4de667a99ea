//! Corrections of nodes: what the mean along the trajectories would move them by, less what it would move their contours by.

use std::ops::Range;

use rayon::prelude::*;

use super::fairing::ReferenceFairing;
use super::fairing_limit::{goes_on, limited};
use super::fairing_near::{SATURATED, fade, nearer, nearness, widest};
use super::fairing_nodes::Transformed;
use super::fairing_paths::add;
use crate::backend::fairing::{CorrectionRequest, NodeMean};
use crate::grid::spline::smoothstep;
use crate::grid::tiled::Packed;
use crate::registration::displacement::Displacement;

/// Distances of a node, and where the trajectories of another one read them.
type Seen<'n> = (&'n Packed<f32>, Option<Displacement>);

impl ReferenceFairing<'_> {
    /// `K v - v` at a node, row-major, zero far from its surface.
    pub(super) fn difference(&self, mean: &NodeMean) -> Vec<f32> {
        let (k, dims, nx) = (mean.node, self.frame.dims, self.frame.dims[0]);
        let mut out = vec![0.0f32; nx * dims[1]];
        let Some(own) = self.node(k).and_then(|node| node.made.as_ref()) else { return out };
        let far = self.bound() * widest(own.at_contour);
        let begin = |(j, out): (usize, &mut [f32])| {
            let mut row = vec![0.0; nx];
            own.v.read(0, j, &mut row);
            let near: Vec<Range<usize>> = nearer(&row, far).collect();
            for pixels in near.iter().cloned() {
                out[pixels.clone()].iter_mut().zip(&row[pixels]).for_each(|(sum, own)| *sum = -own);
            }
            near
        };
        let near: Vec<Vec<Range<usize>>> = out.par_chunks_mut(nx).enumerate().map(begin).collect();
        for &(l, w) in &mean.weights {
            let Some(other) = self.node(l).and_then(|node| node.made.as_ref()) else { continue };
            let offsets = self.offsets(k, l);
            let row = |((j, out), near): ((usize, &mut [f32]), &Vec<Range<usize>>)| {
                for pixels in near.iter().cloned() {
                    add(&other.v, w as f32, offsets.as_ref(), j, pixels.start, &mut out[pixels]);
                }
            };
            out.par_chunks_mut(nx).enumerate().zip(&near).for_each(row);
        }
        if own.at_contour {
            let faded = |((j, out), near): ((usize, &mut [f32]), &Vec<Range<usize>>)| {
                let mut row = vec![0.0; nx];
                own.v.read(0, j, &mut row);
                for i in near.iter().cloned().flatten() {
                    out[i] *= fade(row[i].abs() / self.bound()) as f32;
                }
            };
            out.par_chunks_mut(nx).enumerate().zip(&near).for_each(faded);
        }
        out
    }

    /// Correction of a node between two contours: its own difference less what these would move by, read along the trajectories. `time` is its
    /// own in the interval, `alpha` its strength.
    pub(super) fn correction(
        &self,
        (mean, time, alpha): &(NodeMean, f64, f64),
        request: &CorrectionRequest,
        at_ends: &[Option<Packed<f32>>; 2],
    ) -> Option<Packed<f32>> {
        let k = mean.node;
        let node = self.node(k)?;
        let Transformed { v, gradient, .. } = node.made.as_ref()?;
        let ends = [request.ends[0].node, request.ends[1].node];
        let [low, high] = [self.node(ends[0])?, self.node(ends[1])?];
        let [at_low, at_high] = [at_ends[0].as_ref()?, at_ends[1].as_ref()?];
        let d = self.difference(mean);
        let offsets = ends.map(|end| self.offsets(k, end));
        // What lies on the other side of either contour.
        let beyond = |end: Option<usize>| end.and_then(|end| Some((&*self.node(end)?.phi, self.offsets(k, end))));
        let beyond: [Option<Seen<'_>>; 2] = request.beyond.map(beyond);
        let (w, alpha, bound, nx) = (smoothstep(*time) as f32, *alpha as f32, self.bound(), self.frame.dims[0]);
        let (shares, side) = (request.shares.as_deref(), self.frame.side() as f32);
        let [correction] = Packed::of_rows(self.frame.dims, |first, [rows]: [&mut [f32]; 1]| {
            let [mut own, mut slope, mut here] = [vec![0.0; nx], vec![0.0; nx], vec![0.0; nx]];
            // Both contours' differences and distances along the trajectories, and their distances straight along z.
            let mut there: [Vec<f32>; 6] = Default::default();
            for (j, out) in (first..).zip(rows.chunks_exact_mut(nx)) {
                v.read(0, j, &mut own);
                gradient.read(0, j, &mut slope);
                for pixels in nearer(&own, SATURATED * bound) {
                    there.iter_mut().for_each(|there| {
                        there.clear();
                        there.resize(pixels.len(), 0.0);
                    });
                    let [low_d, high_d, low_along, high_along, low_straight, high_straight] = &mut there;
                    add(at_low, 1.0, offsets[0].as_ref(), j, pixels.start, low_d);
                    add(at_high, 1.0, offsets[1].as_ref(), j, pixels.start, high_d);
                    add(&low.phi, 1.0, offsets[0].as_ref(), j, pixels.start, low_along);
                    add(&high.phi, 1.0, offsets[1].as_ref(), j, pixels.start, high_along);
                    if self.frame.limited {
                        low.phi.read(pixels.start, j, low_straight);
                        high.phi.read(pixels.start, j, high_straight);
                        node.phi.read(pixels.start, j, &mut here[pixels.clone()]);
                    }
                    let on = |p: usize| goes_on([low_along[p], high_along[p]], self.frame.farthest);
                    let mut share: Vec<f32> = (0..pixels.len()).map(on).collect();
                    if share.iter().any(|share| *share < 1.0) {
                        let own = [&*low_along, &*high_along];
                        self.tips(&mut share, own, &beyond, [pixels.start, j]);
                    }
                    for (p, n) in pixels.enumerate() {
                        let alpha = alpha * shares.map_or(1.0, |s| s[j * nx + n]);
                        let alpha = alpha * share[p];
                        let rise = alpha * (d[j * nx + n] - (1.0 - w) * low_d[p] - w * high_d[p]);
                        let c = slope[n] * rise * nearness(own[n].abs() / bound) as f32;
                        let ranges = [[low_along[p], high_along[p]], [low_straight[p], high_straight[p]]];
                        out[n] = if self.frame.limited { limited(c, here[n], ranges, side) } else { c };
                    }
                }
            }
        });
        Some(correction)
    }

    /// Tips: a surface that ends in an interval still goes on if it does so from its contour to the other side: it is the tip of a body. `share` says
    /// how far it goes on within the interval, `own` are the distances of the interval's contours, `beyond` those on their other sides; of pixels
    /// from `first` on.
    fn tips(&self, share: &mut [f32], own: [&Vec<f32>; 2], beyond: &[Option<Seen<'_>>; 2], first: [usize; 2]) {
        let farthest = self.frame.farthest;
        for (side, beyond) in beyond.iter().enumerate() {
            let Some((phi, offsets)) = beyond else { continue };
            let mut there = vec![0.0; share.len()];
            add(phi, 1.0, offsets.as_ref(), first[1], first[0], &mut there);
            for (p, share) in share.iter_mut().enumerate() {
                let [here, other] = [own[side][p], own[1 - side][p]];
                if here.abs() < other.abs() {
                    *share = share.max(goes_on([here, there[p]], farthest));
                }
            }
        }
    }
}
