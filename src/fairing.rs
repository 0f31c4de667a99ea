//! Constrained fairing: a smoothing along z that leaves the input contours where they are and makes them invisible.
//!
//! The signed distance u of every layer becomes `v = B tanh(u / (n B))` with the 3D gradient `n = max(|grad u|, .3)`, which counts near the
//! surface only. With the Gaussian mean K along the trajectories of the moving field (or straight along z), `D = K v - v`, a layer at `z`
//! between the contours i and i + 1 moves by `alpha (D - (1 - w) D(z_i) - w D(z_{i+1}))`, `w = 3 t^2 - 2 t^3`: as smoothing would move it, less
//! what would move the contours. The distance u moves by n times that where v is small against B, and not at all far from the surface or
//! where it lies flat. Layers beyond the first and last contour stay.

use std::collections::VecDeque;
use std::ops::Range;

use rayon::prelude::*;

use crate::displacement::{BLOCK, Displacement};
use crate::error::Result;
use crate::moving_field::{Place, upright};
use crate::moving_stack::MovingStack;
use crate::spline::smoothstep;
use crate::surface::Layer;

/// Sigma of the mean along z, gaps.
const SIGMA: f64 = 0.3;
/// Means are cut here, sigmas.
const TRUNCATE: f64 = 2.75;
/// Least gradient: flat places must not be blown up.
const LEAST_GRADIENT: f32 = 0.3;
/// Beyond this `u / (n B)` tanh is 1.
const FLAT: f32 = 6.0;
/// Pixels with a smaller |v| / B move by all of it, those with a larger than SATURATED not at all.
const NEAR: f32 = 0.4;
const SATURATED: f32 = 0.85;

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

/// A block of a layer, and where its trajectory meets the slices below and above, px of the padded image.
type Near = (usize, [[f64; 2]; 2]);

/// A layer with what fairing makes of it.
struct Kept {
    z: f64,
    place: Option<Place>,
    contour: Option<usize>,
    /// Until it is handed on.
    layer: Option<Layer>,
    /// `v`, as soon as the layer above is known.
    v: Vec<f32>,
    /// `n`; near the surface less where it lies flat.
    gradient: Vec<f32>,
}

/// Takes layers in order of height and hands them on, faired.
pub struct Fairing<'m> {
    spec: Spec<'m>,
    bound: f32,
    kept: VecDeque<Kept>,
    /// How many of the lowest of them have their `v`.
    transformed: usize,
    /// The lowest interval that is not finished.
    interval: usize,
    /// D at its lower contour, if it is known.
    at_contour: Option<Vec<f32>>,
}

impl<'m> Fairing<'m> {
    /// Nothing yet.
    pub fn new(spec: Spec<'m>) -> Self {
        let bound = (0.5 * spec.gap).max(2.0 * spec.dz).max(2.0 * spec.spacing[0].max(spec.spacing[1])) as f32;
        Fairing { spec, bound, kept: VecDeque::new(), transformed: 0, interval: 0, at_contour: None }
    }

    /// Takes the next layer; hands on what is finished.
    ///
    /// # Errors
    /// What `sink` says.
    pub fn push(&mut self, layer: Layer, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let (z, contour) = (layer.z, layer.contour);
        let place = self.spec.moving.map(|(moving, _)| moving.place(z)).transpose()?;
        self.kept.push_back(Kept { z, place, contour, layer: Some(layer), v: Vec::new(), gradient: Vec::new() });
        while self.transformed < self.kept.len() && z - self.kept[self.transformed].z >= self.spec.apart {
            self.transform(self.transformed);
            self.transformed += 1;
        }
        while self.transformed > 0 && self.kept[self.transformed - 1].z >= self.needed_up_to() {
            self.finish_interval(sink)?;
        }
        Ok(())
    }

    /// Hands on everything that is left.
    ///
    /// # Errors
    /// What `sink` says.
    pub fn finish(mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        for k in self.transformed..self.kept.len() {
            self.transform(k);
        }
        self.transformed = self.kept.len();
        while self.interval + 1 < self.spec.contours.len() {
            self.finish_interval(sink)?;
        }
        self.kept.drain(..).filter_map(|k| k.layer).try_for_each(sink)
    }

    /// Height up to which layers must be known to finish the current interval.
    fn needed_up_to(&self) -> f64 {
        let contours = &self.spec.contours;
        if self.interval + 1 < contours.len() { reach(contours, self.interval)[1] } else { f64::INFINITY }
    }

    /// Makes v and n of a layer whose neighbours are there.
    fn transform(&mut self, k: usize) {
        let [nx, ny] = self.spec.dims;
        let [dx, dy] = self.spec.spacing.map(|s| s as f32);
        let (z, last) = (self.kept[k].z, self.kept.len() - 1);
        let below = (0..k).rev().find(|&l| z - self.kept[l].z >= self.spec.apart).unwrap_or(0);
        let above = (k + 1..=last).find(|&l| self.kept[l].z - z >= self.spec.apart).unwrap_or(last);
        let around = [below, k, above].map(|l| &self.kept[l]);
        let rise = (around[2].z - around[0].z).max(f64::MIN_POSITIVE) as f32;
        let [Some(below), Some(here), Some(above)] = around.map(|kept| kept.layer.as_ref()) else { return };
        let (bound, far) = (self.bound, SATURATED * self.bound);
        let row = |steep: &mut Vec<f32>, (j, (v, gradient)): (usize, (&mut [f32], &mut [f32]))| {
            let (down, up) = (j.saturating_sub(1), (j + 1).min(ny - 1));
            let [u, south, north] = [j, down, up].map(|j| line(here, j, nx));
            let [lower, higher] = [below, above].map(|layer| line(layer, j, nx));
            let rise_y = dy * (up - down).max(1) as f32;
            steep.resize(nx, 0.0);
            for i in 0..nx {
                let (left, right) = (i.saturating_sub(1), (i + 1).min(nx - 1));
                let gx = (u[right] - u[left]) / (dx * (right - left).max(1) as f32);
                let gy = (north[i] - south[i]) / rise_y;
                let gz = (higher[i] - lower[i]) / rise;
                let along = gx * gx + gy * gy;
                gradient[i] = (along + gz * gz).sqrt().max(LEAST_GRADIENT);
                steep[i] = gz.abs() / along.sqrt().max(LEAST_GRADIENT);
            }
            for i in 0..nx {
                let ratio = u[i] / (gradient[i] * bound);
                v[i] = if ratio.abs() > FLAT { bound.copysign(ratio) } else { bound * ratio.tanh() };
                // A surface that lies flat shows no creases, and a mean along z would only wash its relief away.
                if v[i].abs() < far {
                    gradient[i] *= upright(f64::from(steep[i])) as f32;
                }
            }
        };
        let (mut v, mut gradient) = (vec![0.0; nx * ny], vec![0.0; nx * ny]);
        let rows = v.par_chunks_mut(nx).zip(gradient.par_chunks_mut(nx)).enumerate();
        rows.for_each_init(Vec::new, row);
        (self.kept[k].v, self.kept[k].gradient) = (v, gradient);
    }

    /// Weights of the layers in the mean at layer `k`. Each layer stands for half of the way to its neighbours; beyond the body's ends the
    /// layers go on as their reflections in the last one, `2 v_end - v`, so that a slope there stays.
    fn weights(&self, k: usize) -> Vec<(usize, f32)> {
        let z = self.kept[k].z;
        let sigma = sigma(&self.spec.contours, z);
        let last = self.kept.len() - 1;
        let at = |l: usize| self.kept[l].z;
        let height = |l: usize| {
            let (below, above) = (at(l) - at(l.saturating_sub(1)), at((l + 1).min(last)) - at(l));
            if below == 0.0 || above == 0.0 { below.max(above) } else { 0.5 * (below + above) }
        };
        let weight = |l: usize, z_l: f64| {
            let away = (z_l - z).abs();
            if away <= TRUNCATE * sigma { height(l) * (-0.5 * (away / sigma).powi(2)).exp() } else { 0.0 }
        };
        let mut weights: Vec<f64> = (0..=last).map(|l| weight(l, at(l))).collect();
        for end in [0, last] {
            for l in (0..=last).filter(|&l| l != end) {
                let reflected = weight(l, 2.0 * at(end) - at(l));
                weights[end] += 2.0 * reflected;
                weights[l] -= reflected;
            }
        }
        let known = |(l, w): &(usize, f64)| *w != 0.0 && !self.kept[*l].v.is_empty();
        let terms: Vec<(usize, f64)> = weights.into_iter().enumerate().filter(known).collect();
        let whole: f64 = terms.iter().map(|t| t.1).sum();
        terms.into_iter().map(|(l, w)| (l, (w / whole) as f32)).collect()
    }

    /// Blocks of layer `k` that are read where its surface is near, and where their trajectories meet the slices around it.
    fn near_surface(&self, k: usize) -> Vec<Near> {
        let (Some((_, pad)), Some(place)) = (self.spec.moving, &self.kept[k].place) else { return Vec::new() };
        let still = Displacement::zero(self.spec.dims);
        let mut near = vec![false; still.vectors.len()];
        let nx = self.spec.dims[0];
        let far = SATURATED * self.bound;
        // A pixel reads the four blocks whose centres are around it.
        let around = |low: usize, high: usize, axis: usize| {
            let [first, last] = [low, high].map(|p| (p + BLOCK / 2) / BLOCK);
            first.saturating_sub(1)..last.min(still.grid[axis] - 1) + 1
        };
        for (j, row) in self.kept[k].v.chunks_exact(nx).enumerate() {
            for pixels in stretches(row, far) {
                for by in around(j, j, 1) {
                    near[by * still.grid[0]..][around(pixels.start, pixels.end - 1, 0)].fill(true);
                }
            }
        }
        let slices = |block: usize| place.to_slices(still.centre(block).map(|x| x + pad as f64));
        (0..near.len()).filter(|&block| near[block]).map(|block| (block, slices(block))).collect()
    }

    /// Offsets of the trajectories from layer `k` to layer `l` in the blocks `near`, px of the image; `None` where they stand still.
    fn offsets(&self, k: usize, l: usize, near: &[Near]) -> Option<Displacement> {
        let (_, pad) = self.spec.moving.filter(|_| k != l)?;
        let (from, to) = (self.kept[k].place.as_ref()?, self.kept[l].place.as_ref()?);
        // The lowest layer of every interval between both is among those that wait.
        let intervals = from.interval.min(to.interval) + 1..from.interval.max(to.interval);
        let of = |i| self.kept.iter().filter_map(|kept| kept.place.as_ref()).find(|place| place.interval == i);
        let between: Vec<&[Displacement; 2]> = intervals.filter_map(of).map(|place| &*place.at_slices).collect();
        let mut offsets = Displacement::zero(self.spec.dims);
        for &(block, slices) in near {
            let (x, y) = (offsets.centre(block), from.carry(slices, to, &between));
            offsets.vectors[block] = [0, 1].map(|a| y[a] - pad as f64 - x[a]);
        }
        Some(offsets)
    }

    /// `K v - v` at layer `k`, zero far from its surface. `near` are its blocks near the surface.
    fn difference(&self, k: usize, near: &[Near]) -> Vec<f32> {
        let weights = self.weights(k);
        let offsets: Vec<Option<Displacement>> = weights.par_iter().map(|&(l, _)| self.offsets(k, l, near)).collect();
        let (own, far, nx) = (&self.kept[k].v, SATURATED * self.bound, self.spec.dims[0]);
        let mut out = vec![0.0f32; own.len()];
        let dims = self.spec.dims;
        let row = |(j, out): (usize, &mut [f32])| {
            let own = &own[j * nx..][..nx];
            for pixels in stretches(own, far) {
                let out = &mut out[pixels.clone()];
                out.iter_mut().zip(&own[pixels.clone()]).for_each(|(sum, own)| *sum = -own);
                for ((l, w), offsets) in weights.iter().zip(&offsets) {
                    add(&self.kept[*l].v, *w, dims, offsets.as_ref(), j, pixels.start, out);
                }
            }
        };
        out.par_chunks_mut(nx).enumerate().for_each(row);
        out
    }

    /// Moves the layers of the current interval and hands on everything below its upper contour.
    fn finish_interval(&mut self, sink: &mut dyn FnMut(Layer) -> Result<()>) -> Result<()> {
        let place = |c: usize| self.kept.iter().position(|k| k.contour == Some(c));
        let (Some(low), Some(high)) = (place(self.interval), place(self.interval + 1)) else {
            self.interval += 1;
            return Ok(());
        };
        let from_low = self.at_contour.take().unwrap_or_else(|| self.difference(low, &self.near_surface(low)));
        let from_high = self.difference(high, &self.near_surface(high));
        for k in low + 1..high {
            let near = self.near_surface(k);
            let d = self.difference(k, &near);
            let t = (self.kept[k].z - self.kept[low].z) / (self.kept[high].z - self.kept[low].z);
            let offsets = [low, high].map(|c| self.offsets(k, c, &near));
            let (first, last) = (self.interval == 0, self.interval + 2 == self.spec.contours.len());
            let at_low = if first && self.spec.clamped[0] { smoothstep(t) as f32 } else { 1.0 };
            let at_high = if last && self.spec.clamped[1] { smoothstep(1.0 - t) as f32 } else { 1.0 };
            self.move_layer(k, &d, [(&from_low, &offsets[0]), (&from_high, &offsets[1])], t, at_low * at_high);
        }
        self.at_contour = Some(from_high);
        self.interval += 1;
        self.kept.range_mut(..high).filter_map(|k| k.layer.take()).try_for_each(sink)?;
        self.forget();
        Ok(())
    }

    /// Moves layer `k` by this share of its own `d` less what the contours below and above would move by, read along the trajectories.
    fn move_layer(&mut self, k: usize, d: &[f32], contours: [(&[f32], &Option<Displacement>); 2], t: f64, share: f32) {
        let w = smoothstep(t) as f32;
        let (bound, alpha, dims) = (self.bound, share * self.spec.alpha as f32, self.spec.dims);
        let shares = self.spec.shares.get(self.interval).and_then(Option::as_ref);
        let Kept { layer: Some(layer), v, gradient, .. } = &mut self.kept[k] else { return };
        let (nx, far) = (dims[0], SATURATED * bound);
        let row = |there: &mut [Vec<f32>; 2], (j, u): (usize, &mut [f32])| {
            // Far from the surface nothing changes.
            for pixels in stretches(&v[j * nx..][..nx], far) {
                for ((d, offsets), there) in contours.iter().zip(there.iter_mut()) {
                    there.clear();
                    there.resize(pixels.len(), 0.0);
                    add(d, 1.0, dims, offsets.as_ref(), j, pixels.start, there);
                }
                for ((i, low), high) in pixels.zip(&there[0]).zip(&there[1]) {
                    let (n, u) = (j * nx + i, &mut u[i]);
                    let alpha = alpha * shares.map_or(1.0, |s| s[n]);
                    let rise = alpha * (d[n] - (1.0 - w) * low - w * high);
                    *u += gradient[n] * rise * near(v[n].abs() / bound);
                    if *u == 0.0 {
                        *u = f32::MIN_POSITIVE;
                    }
                }
            }
        };
        layer.phi.par_chunks_mut(nx).enumerate().for_each_init(Default::default, row);
    }

    /// Drops what no later mean needs.
    fn forget(&mut self) {
        let contours = &self.spec.contours;
        let to_come = self.interval..contours.len() - 1;
        let needed = to_come.map(|i| reach(contours, i)[0]).fold(f64::INFINITY, f64::min);
        // One layer more stays: how far the lowest reaches down is known from it.
        while self.kept.len() > 2 && self.kept[0].layer.is_none() && self.kept[1].z < needed {
            self.kept.pop_front();
            self.transformed -= 1;
        }
    }
}

/// SIGMA times the gap: at a contour the mean of those next to it, between them a smooth step, so that what follows is C1.
fn sigma(contours: &[f64], z: f64) -> f64 {
    let last = contours.len() - 1;
    let i = contours.partition_point(|c| *c <= z).clamp(1, last) - 1;
    let t = ((z - contours[i]) / (contours[i + 1] - contours[i])).clamp(0.0, 1.0);
    let w = smoothstep(t);
    SIGMA * ((1.0 - w) * gap_at(contours, i) + w * gap_at(contours, i + 1))
}

/// The mean of the gaps next to a contour.
fn gap_at(contours: &[f64], i: usize) -> f64 {
    let last = contours.len() - 1;
    let below = if i > 0 { contours[i] - contours[i - 1] } else { contours[1] - contours[0] };
    let above = if i < last { contours[i + 1] - contours[i] } else { contours[last] - contours[last - 1] };
    0.5 * (below + above)
}

/// Lowest and highest height from which layers of interval `i` take their means, contours included.
pub fn reach(contours: &[f64], i: usize) -> [f64; 2] {
    let widest = TRUNCATE * SIGMA * gap_at(contours, i).max(gap_at(contours, i + 1));
    [contours[i] - widest, contours[i + 1] + widest]
}

/// Row `j` of a layer.
fn line(layer: &Layer, j: usize, nx: usize) -> &[f32] {
    &layer.phi[j * nx..][..nx]
}

/// How much of its way a pixel at `|v| / B` moves.
fn near(ratio: f32) -> f32 {
    smoothstep(f64::from((SATURATED - ratio) / (SATURATED - NEAR))) as f32
}

/// The stretches of a row in which `v` is less than `far`.
fn stretches(v: &[f32], far: f32) -> impl Iterator<Item = Range<usize>> {
    let mut at = 0;
    v.chunk_by(move |a, b| (a.abs() < far) == (b.abs() < far)).filter_map(move |some| {
        at += some.len();
        (some[0].abs() < far).then(|| at - some.len()..at)
    })
}

/// Adds `w` times the values of a layer at the pixels of row `j` from `first` on, or where their trajectories are.
fn add(v: &[f32], w: f32, dims: [usize; 2], offsets: Option<&Displacement>, j: usize, first: usize, out: &mut [f32]) {
    let Some(offsets) = offsets else {
        out.iter_mut().zip(&v[j * dims[0] + first..]).for_each(|(sum, v)| *sum += w * v);
        return;
    };
    let mut some = [[0.0; 2]; 4 * BLOCK];
    for (first, out) in (first..).step_by(some.len()).zip(out.chunks_mut(some.len())) {
        let some = &mut some[..out.len()];
        offsets.read_row(j, first, some);
        for ((i, sum), [x, y]) in (first..).zip(out).zip(some) {
            *sum += w * sample(v, dims, [i as f64 + *x, j as f64 + *y]);
        }
    }
}

/// Bilinear value of a layer at `x`, the edge repeated.
#[inline]
fn sample(v: &[f32], [nx, ny]: [usize; 2], x: [f64; 2]) -> f32 {
    let at = [x[0].clamp(0.0, (nx - 1) as f64), x[1].clamp(0.0, (ny - 1) as f64)];
    // Through u32: cheaper than to usize.
    let [i, j] = [(at[0], nx), (at[1], ny)].map(|(at, n)| (at as u32 as usize).min(n.saturating_sub(2)));
    let (fx, fy) = ((at[0] - i as f64) as f32, (at[1] - j as f64) as f32);
    let (right, up) = (usize::from(nx > 1), if ny > 1 { nx } else { 0 });
    let n = j * nx + i;
    (1.0 - fy) * ((1.0 - fx) * v[n] + fx * v[n + right]) + fy * ((1.0 - fx) * v[n + up] + fx * v[n + up + right])
}
