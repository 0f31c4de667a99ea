//! Constrained fairing: a smoothing along z that leaves the input contours where they are and makes them invisible.
//!
//! The signed distance u of every layer becomes `v = B tanh(u / (n B))` with the 3D gradient `n = max(|grad u|, .3)`, which counts near the
//! surface only. With the mean K along the trajectories of the moving field (or straight along z), `D = K v - v`, a layer at `z`
//! between the contours i and i + 1 moves by `alpha (D - (1 - w) D(z_i) - w D(z_{i+1}))`, `w = 3 t^2 - 2 t^3`: as smoothing would move it, less
//! what would move the contours (`D(z_i)` fades out where its |v| / B goes from .82 to .88). The distance u moves by n times that where v is
//! small against B, and not at all far from the surface or where it lies flat. Layers beyond the first and last contour stay.

mod along;
mod flatness;
mod kept;
mod near;
mod transform;
mod window;

use std::collections::VecDeque;
use std::ops::Range;

use rayon::prelude::*;

use self::along::add;
use self::kept::{Kept, Near, Transformed, blocks_near};
use self::near::{SATURATED, fade, nearer, nearness, widest};
use self::transform::{Lengths, transform};
pub use self::window::reach;
use self::window::{takes_part, weights};

use crate::displacement::{Displacement, Resting};
use crate::error::Result;
use crate::moving_stack::MovingStack;
use crate::packed::Packed;
use crate::spline::smoothstep;
use crate::surface::Layer;

/// Does `work` on a thread of the pool, from which its loops need not hand anything over to another.
fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Layers of fewer pixels are worked on side by side.
const SMALL: usize = 1 << 20;

/// What fairing needs to know of a stack.
pub struct Spec<'m> {
    /// The frame in which layers follow each other, and the padding of its image.
    pub moving: Option<(&'m MovingStack<'m>, usize)>,
    /// Heights of the contours, increasing.
    pub contours: Vec<f64>,
    /// Pixels of a layer.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// Median gap of the whole stack.
    pub gap: f64,
    /// Median distance between layers.
    pub dz: f64,
    /// A gradient along z is taken over at least this distance to either side, at most half of any gap: over a tiny one it would show little
    /// but the layers' own errors.
    pub apart: f64,
    /// Strength, 0 to 1.5.
    pub alpha: f64,
    /// Whether the user has given the slope at the first and at the last contour: it stays.
    pub clamped: [bool; 2],
    /// For an interval with parts that are kept apart the share of the strength at each pixel: smoothing would join them.
    pub shares: Vec<Option<Vec<f32>>>,
}

/// Takes layers in order of height and hands them on, faired.
pub struct Fairing<'m> {
    spec: Spec<'m>,
    bound: f32,
    kept: VecDeque<Kept>,
    /// How many of the lowest of them have their `v`.
    made: usize,
    /// The lowest interval that is not finished.
    interval: usize,
    /// D at its lower contour, if it is known.
    at_contour: Option<Packed<f32>>,
}

impl<'m> Fairing<'m> {
    /// Nothing yet.
    pub fn new(spec: Spec<'m>) -> Self {
        let bound = (0.5 * spec.gap).max(2.0 * spec.dz).max(2.0 * spec.spacing[0].max(spec.spacing[1])) as f32;
        Fairing { spec, bound, kept: VecDeque::new(), made: 0, interval: 0, at_contour: None }
    }

    /// Takes the next layer; hands on what is finished.
    ///
    /// # Errors
    /// What `sink` says.
    pub fn push(&mut self, layer: Layer, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let z = layer.z;
        let dims = self.spec.dims;
        self.kept.push_back(in_pool(|| Kept::new(layer, dims)));
        loop {
            // Those that have a neighbour above.
            let ready = self.kept.partition_point(|kept| z - kept.z >= self.spec.apart);
            // A mean tells from the next layer that takes part how much the one before stands for.
            let (heights, needed) = (self.heights(), self.needed_up_to());
            if !(0..ready).rev().take_while(|&l| heights[l] >= needed).any(|l| self.takes_part(&heights, l)) {
                return Ok(());
            }
            self.transform(ready)?;
            self.finish_interval(sink)?;
        }
    }

    /// Hands on everything that is left.
    ///
    /// # Errors
    /// What `sink` says.
    pub fn finish(mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        self.transform(self.kept.len())?;
        while self.interval + 1 < self.spec.contours.len() {
            self.finish_interval(sink)?;
        }
        self.kept.iter_mut().filter_map(Kept::take).try_for_each(sink)
    }

    /// Heights of the layers that wait.
    fn heights(&self) -> Vec<f64> {
        self.kept.iter().map(|kept| kept.z).collect()
    }

    /// Whether layer `l` takes part in means.
    fn takes_part(&self, heights: &[f64], l: usize) -> bool {
        takes_part(heights, &self.spec.contours, self.spec.dz, l)
    }

    /// The layers that take part in means.
    fn taking_part(&self, heights: &[f64]) -> Vec<usize> {
        (0..heights.len()).filter(|&l| self.takes_part(heights, l)).collect()
    }

    /// Height up to which layers must be known to finish the current interval.
    fn needed_up_to(&self) -> f64 {
        let contours = &self.spec.contours;
        if self.interval + 1 < contours.len() { reach(contours, self.interval)[1] } else { f64::INFINITY }
    }

    /// Layers that are worked on at the same time: rows of small ones are too little for all threads.
    fn at_once(&self) -> usize {
        if self.spec.dims[0] * self.spec.dims[1] < SMALL { rayon::current_num_threads() } else { 1 }
    }

    /// Makes of the lowest `count` layers, whose neighbours are there, what has not been made yet.
    fn transform(&mut self, count: usize) -> Result<()> {
        while self.made < count {
            let some = self.made..(self.made + self.at_once()).min(count);
            let transformed = || some.clone().into_par_iter().map(|k| self.transformed(k)).collect::<Result<Vec<_>>>();
            let made = in_pool(transformed)?;
            self.kept.range_mut(some.clone()).zip(made).for_each(|(kept, made)| kept.made = made);
            self.made = some.end;
        }
        Ok(())
    }

    fn transformed(&self, k: usize) -> Result<Option<Transformed>> {
        let (z, last) = (self.kept[k].z, self.kept.len() - 1);
        let below = (0..k).rev().find(|&l| z - self.kept[l].z >= self.spec.apart).unwrap_or(0);
        let above = (k + 1..=last).find(|&l| self.kept[l].z - z >= self.spec.apart).unwrap_or(last);
        let around = [below, k, above].map(|l| &self.kept[l]);
        let rise = (around[2].z - around[0].z).max(f64::MIN_POSITIVE) as f32;
        let around = around.map(|kept| kept.layer.as_ref().map(|(_, phi)| phi));
        let [Some(below), Some(here), Some(above)] = around else { return Ok(None) };
        let lengths = Lengths { spacing: self.spec.spacing, bound: self.bound, rise };
        let [v, gradient] = transform([below, here, above], lengths);
        let (mut place, mut near) = (None, Vec::new());
        if let Some((moving, pad)) = self.spec.moving {
            let known = self.kept.iter().take(k).rev().find_map(Kept::place);
            let (found, paths) = moving.place(z, known)?;
            let far = self.bound * widest(self.kept[k].contour.is_some());
            near = blocks_near(&v, far, &paths, pad);
            place = Some(found);
        }
        Ok(Some(Transformed { v, gradient, place, near }))
    }

    /// Offsets of the trajectories from layer `k` to layer `l` in the blocks near its surface, px of the image; `None` where they stand still.
    fn offsets(&self, k: usize, l: usize) -> Option<Displacement> {
        let (_, pad) = self.spec.moving.filter(|_| k != l)?;
        let (from, to) = (self.kept[k].made.as_ref()?, self.kept[l].place()?);
        let (near, from) = (&from.near, from.place.as_ref()?);
        // The lowest layer of every interval between both is among those that wait.
        let intervals = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let of = |i| self.kept.iter().filter_map(Kept::place).find(|place| place.interval == i);
        let between: Vec<&[Resting; 2]> = intervals.filter_map(of).map(|place| &*place.at_slices).collect();
        let mut offsets = Displacement::zero(self.spec.dims);
        let offset = |&(block, slices): &Near| {
            let (x, y) = (offsets.centre(block), from.carry(slices, to, &between));
            [0, 1].map(|a| y[a] - pad as f64 - x[a])
        };
        let found: Vec<[f64; 2]> = near.par_iter().map(offset).collect();
        near.iter().zip(found).for_each(|((block, _), offset)| offsets.vectors[*block] = offset);
        Some(offsets)
    }

    /// `K v - v` at layer `k`, row-major, zero far from its surface; nothing of a layer that has no v.
    fn difference(&self, k: usize) -> Vec<f32> {
        let (dims, nx) = (self.spec.dims, self.spec.dims[0]);
        let mut out = vec![0.0f32; nx * dims[1]];
        let Some(own) = &self.kept[k].made else { return out };
        let at_contour = self.kept[k].contour.is_some();
        let far = self.bound * widest(at_contour);
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
        let (heights, known) = (self.heights(), |l: usize| self.kept[l].made.is_some());
        for (l, w) in weights(&heights, &self.taking_part(&heights), &self.spec.contours, k, known) {
            let (Some(other), offsets) = (&self.kept[l].made, self.offsets(k, l)) else { continue };
            let row = |((j, out), near): ((usize, &mut [f32]), &Vec<Range<usize>>)| {
                for pixels in near.iter().cloned() {
                    add(&other.v, w, offsets.as_ref(), j, pixels.start, &mut out[pixels]);
                }
            };
            out.par_chunks_mut(nx).enumerate().zip(&near).for_each(row);
        }
        if at_contour {
            let faded = |((j, out), near): ((usize, &mut [f32]), &Vec<Range<usize>>)| {
                let mut row = vec![0.0; nx];
                own.v.read(0, j, &mut row);
                for i in near.iter().cloned().flatten() {
                    out[i] *= fade(row[i].abs() / self.bound) as f32;
                }
            };
            out.par_chunks_mut(nx).enumerate().zip(&near).for_each(faded);
        }
        out
    }

    /// Moves the layers of the current interval and hands on everything below its upper contour.
    fn finish_interval(&mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let place = |c: usize| self.kept.iter().position(|k| k.contour == Some(c));
        let (Some(low), Some(high)) = (place(self.interval), place(self.interval + 1)) else {
            self.interval += 1;
            return Ok(());
        };
        let from_low = self.at_contour.take();
        let at = |k: usize| Packed::of(self.spec.dims, &self.difference(k));
        let both = || rayon::join(|| from_low.unwrap_or_else(|| at(low)), || at(high));
        let (from_low, from_high) = in_pool(both);
        self.kept.range_mut(..=low).filter_map(Kept::take).try_for_each(&mut *sink)?;
        let between: Vec<usize> = (low + 1..high).collect();
        for some in between.chunks(self.at_once()) {
            let layers: Vec<(usize, Layer)> =
                some.iter().filter_map(|&k| self.kept[k].take().map(|layer| (k, layer))).collect();
            let moved = |(k, layer): (usize, Layer)| {
                let t = (self.kept[k].z - self.kept[low].z) / (self.kept[high].z - self.kept[low].z);
                self.moved(k, layer, [(low, &from_low), (high, &from_high)], t)
            };
            let layers: Vec<Layer> = in_pool(|| layers.into_par_iter().map(moved).collect());
            layers.into_iter().try_for_each(&mut *sink)?;
        }
        self.at_contour = Some(from_high);
        self.interval += 1;
        self.forget();
        Ok(())
    }

    /// Layer `k`, at time `t` of its interval, moved by its own difference less what the contours below and above would move by, read along
    /// the trajectories.
    fn moved(&self, k: usize, mut layer: Layer, contours: [(usize, &Packed<f32>); 2], t: f64) -> Layer {
        let Some(Transformed { v, gradient, .. }) = &self.kept[k].made else { return layer };
        let d = self.difference(k);
        let contours = contours.map(|(c, d)| (d, self.offsets(k, c)));
        let (first, last) = (self.interval == 0, self.interval + 2 == self.spec.contours.len());
        let at_low = if first && self.spec.clamped[0] { smoothstep(t) as f32 } else { 1.0 };
        let at_high = if last && self.spec.clamped[1] { smoothstep(1.0 - t) as f32 } else { 1.0 };
        let w = smoothstep(t) as f32;
        let (bound, alpha, nx) = (self.bound, at_low * at_high * self.spec.alpha as f32, self.spec.dims[0]);
        let shares = self.spec.shares.get(self.interval).and_then(Option::as_ref);
        let row = |there: &mut [Vec<f32>; 2], (j, u): (usize, &mut [f32])| {
            let [mut own, mut slope] = [vec![0.0; nx], vec![0.0; nx]];
            v.read(0, j, &mut own);
            gradient.read(0, j, &mut slope);
            // Far from the surface nothing changes.
            for pixels in nearer(&own, SATURATED * bound) {
                for ((d, offsets), there) in contours.iter().zip(there.iter_mut()) {
                    there.clear();
                    there.resize(pixels.len(), 0.0);
                    add(d, 1.0, offsets.as_ref(), j, pixels.start, there);
                }
                for ((i, low), high) in pixels.zip(&there[0]).zip(&there[1]) {
                    let (n, u) = (j * nx + i, &mut u[i]);
                    let alpha = alpha * shares.map_or(1.0, |s| s[n]);
                    let rise = alpha * (d[n] - (1.0 - w) * low - w * high);
                    *u += slope[i] * rise * nearness(own[i].abs() / bound) as f32;
                    if *u == 0.0 {
                        *u = f32::MIN_POSITIVE;
                    }
                }
            }
        };
        layer.phi.par_chunks_mut(nx).enumerate().for_each_init(Default::default, row);
        layer
    }

    /// Drops what no later mean needs.
    fn forget(&mut self) {
        let contours = &self.spec.contours;
        let to_come = self.interval..contours.len() - 1;
        let needed = to_come.map(|i| reach(contours, i)[0]).fold(f64::INFINITY, f64::min);
        // Of those that take part one more stays, by which it is known how much the one above stands for, and the layer below it, by which it
        // is known that it takes part.
        let heights = self.heights();
        let below = (0..heights.len()).rev().find(|&l| heights[l] < needed && self.takes_part(&heights, l));
        let done = self.kept.iter().take_while(|kept| kept.layer.is_none()).count();
        let dropped = below.unwrap_or(0).saturating_sub(1).min(done);
        self.kept.drain(..dropped);
        self.made -= dropped;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 2] = [41, 41];

    /// Layers `dz` apart of a disc, as large as `radius` says of their heights, after fairing.
    fn faired(contours: &[f64], dz: f64, radius: impl Fn(f64) -> f64) -> Vec<Vec<f32>> {
        let gaps: Vec<f64> = contours.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let mut fairing = Fairing::new(Spec {
            moving: None,
            contours: contours.to_vec(),
            dims: DIMS,
            spacing: [1.0; 2],
            gap: crate::heights::median(gaps.clone()),
            dz,
            apart: dz,
            alpha: 1.5,
            clamped: [false; 2],
            shares: vec![None; gaps.len()],
        });
        let mut out = Vec::new();
        let mut sink = |layer: Layer| {
            out.push(layer.phi);
            Ok(())
        };
        for k in 0..=(gaps.iter().sum::<f64>() / dz) as usize {
            let z = contours[0] + k as f64 * dz;
            let phi = |n: usize| ((n % DIMS[0]) as f64 - 20.0).hypot((n / DIMS[0]) as f64 - 20.0) - radius(z);
            let phi = (0..DIMS[0] * DIMS[1]).map(|n| phi(n) as f32).collect();
            let contour = contours.iter().position(|c| *c == z);
            fairing.push(Layer { z, phi, output: true, contour }, &mut sink).expect("pushed");
        }
        fairing.finish(&mut sink).expect("finished");
        out
    }

    #[test]
    fn upside_down_it_is_the_same() {
        // Fine gaps below smaller ones and above: the window forgets layers that take part and others.
        for (gaps, dz) in [([6, 12, 3, 3, 6], 0.5), ([5, 20, 4, 3, 24], 0.5), ([10, 10, 20, 10, 10], 1.0)] {
            let contours: Vec<f64> = std::iter::once(0)
                .chain(gaps)
                .scan(0, |z, gap| {
                    *z += gap;
                    Some(f64::from(*z))
                })
                .collect();
            let top = contours[contours.len() - 1];
            let turned: Vec<f64> = contours.iter().rev().map(|z| top - z).collect();
            let radius = |z: f64| 10.0 + 4.0 * (0.9 * z).sin();
            let (up, down) = (faired(&contours, dz, radius), faired(&turned, dz, |z| radius(top - z)));
            let apart = up.iter().flatten().zip(down.iter().rev().flatten()).map(|(a, b)| (a - b).abs());
            let largest = apart.fold(0.0, f32::max);
            assert!(largest < 2e-5, "{gaps:?}: {largest}");
        }
    }

    #[test]
    fn a_little_change_of_the_layers_changes_little() {
        // Rings of symmetric pixels pass every threshold together on the way.
        const STEP: f64 = 2e-3;
        let radius = |z: f64, more: f64| 8.0 + 6.0 * (z * std::f64::consts::PI / 8.0).sin() + more;
        let body = |k: u32| faired(&[0.0, 8.0, 16.0], 1.0, |z| radius(z, f64::from(k) * STEP)).concat();
        let bodies: Vec<Vec<f32>> = (0..400).into_par_iter().map(body).collect();
        let change = |pair: &[Vec<f32>]| pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let largest = bodies.windows(2).map(change).fold(0.0, f32::max);
        println!("largest change {largest} at a step of {STEP}");
        assert!(largest < 6.0 * STEP as f32, "{largest}");
    }
}
