//! A grid that outputs are asked to have: that of an image, or of a map. Distances are interpolated in the planes of the slices; heights are
//! the image's planes themselves.

use std::io;

use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Layer;
use super::header::Header;
use super::stream::{BodyWriter, Ending};
use crate::grid::field::bilinear;
use crate::grid::sparse_image::SparseImage;
use crate::stack::{ContourStack, Geometry, HeightGrid};

/// Part of a voxel by which planes of an image may leave those of the slices.
const SLANT: f64 = 0.1;
/// Part of their step by which planes of a volume may be uneven.
const UNEVEN: f64 = 0.01;
/// Pixels by which what lies on a grid's edge may be off.
const ROUNDING: f64 = 1e-6;

/// A grid in the world (LPS).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LikeGrid {
    /// Voxels along its axes.
    pub dims: [usize; 3],
    /// Position of the first.
    pub origin: DVec3,
    /// Steps along its axes; of uneven planes the mean one.
    pub steps: [DVec3; 3],
    /// Places of the planes along the third axis, where they are not even.
    pub planes: Option<Vec<f64>>,
    /// Whether it is a raster without heights of its own.
    pub is_flat: bool,
}

/// A grid as a stack sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct LikeFrame {
    grid: LikeGrid,
    /// Its axes along which columns, rows and heights of the stack's layers run.
    order: [usize; 3],
    /// Whether its planes come from top to bottom.
    falls: bool,
}

impl LikeGrid {
    /// The grid for slices that lie so.
    ///
    /// # Errors
    /// A message where none of its axes runs from slice to slice.
    pub fn frame(&self, geometry: &Geometry) -> Result<LikeFrame, String> {
        let normal = geometry.axes[2];
        let up = |axis: usize| self.steps[axis].dot(normal) / self.steps[axis].length();
        let across = (0..3).max_by(|a, b| up(*a).abs().total_cmp(&up(*b).abs())).unwrap_or(2);
        let [u, v] = [[1, 2], [0, 2], [0, 1]][across];
        // How far the corners of a plane leave it, in steps between planes.
        let slant = |axis: usize| (self.steps[axis] * self.dims[axis] as f64).dot(normal).abs();
        let off = (slant(u) + slant(v)) / self.steps[across].length();
        if off > SLANT && !self.is_flat {
            let degrees = up(across).abs().min(1.0).acos().to_degrees();
            return Err(format!(
                "names a grid whose planes are oblique to the slices by {degrees:.2} degrees, {off:.2} of a step over a plane, at most {SLANT}; resample one of the two"
            ));
        }
        Ok(LikeFrame { grid: self.clone(), order: [u, v, across], falls: up(across) < 0.0 })
    }

    /// Whether planes are as even as a volume's are.
    ///
    /// # Errors
    /// A message with the two steps that differ most.
    pub fn check_even(&self) -> Result<(), String> {
        let Some(planes) = &self.planes else { return Ok(()) };
        let gaps = planes.windows(2).map(|w| w[1] - w[0]);
        let [low, high] = gaps.fold([f64::INFINITY, 0.0], |[low, high], gap| [f64::min(low, gap), f64::max(high, gap)]);
        match high - low > UNEVEN * high {
            true => Err(format!("its planes are {low:.4} to {high:.4} apart; a volume needs even ones")),
            false => Ok(()),
        }
    }
}

impl LikeFrame {
    /// Heights of its planes in the stack, increasing; none of a raster.
    pub fn heights(&self, geometry: &Geometry) -> Option<Vec<f64>> {
        if self.grid.is_flat {
            return None;
        }
        let [_, _, across] = self.order;
        let (first, step) = (self.grid.origin - geometry.origin, self.grid.steps[across]);
        let along = |k: usize| match &self.grid.planes {
            Some(planes) if across == 2 => step / step.length() * (planes[k] - planes[0]),
            _ => k as f64 * step,
        };
        let mut heights: Vec<f64> =
            (0..self.grid.dims[across]).map(|k| (first + along(k)).dot(geometry.axes[2])).collect();
        if self.falls {
            heights.reverse();
        }
        Some(heights)
    }

    /// Whether its pixels and those of slices have a place in common: the boxes around both meet.
    pub fn meets(&self, geometry: &Geometry, dims: [usize; 2], spacing: [f64; 2]) -> bool {
        let [u, v, across] = self.order;
        let steps = |axis: usize, n: f64| self.grid.steps[axis] * n;
        let end = |axis: usize| self.grid.dims[axis] as f64 - 0.5;
        let ends = [[-0.5, -0.5], [end(u), -0.5], [-0.5, end(v)], [end(u), end(v)]];
        let planes = if self.grid.is_flat { 1 } else { 2 };
        let corners = (0..planes).flat_map(|last| {
            let plane = self.grid.origin + steps(across, last as f64 * (self.grid.dims[across] as f64 - 1.0));
            ends.map(|[i, j]| plane + steps(u, i) + steps(v, j) - geometry.origin)
        });
        let places: Vec<DVec3> = corners.collect();
        (0..2).all(|a| {
            let along = places.iter().map(|p| p.dot(geometry.axes[a]) / spacing[a]);
            let [low, high] =
                along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
            low < dims[a] as f64 - 0.5 && high > -0.5
        })
    }

    /// Share of the pixels drawn on slices whose middle lies beyond its voxels; nothing of a raster, which shows a part of a map.
    pub fn beyond(&self, stack: &ContourStack) -> f64 {
        let Some(planes) = self.heights(&stack.geometry) else { return 0.0 };
        let (Some(first), Some(last)) = (planes.first(), planes.last()) else { return 0.0 };
        let half = 0.5 * (last - first) / (planes.len() - 1).max(1) as f64;
        let pixels = self.pixels(&stack.geometry, stack.spacing);
        let steps = DMat2::from_cols_array_2d(&pixels.steps.map(|step| step.to_array()));
        let (to_pixels, [nx, ny]) = (steps.inverse(), pixels.dims);
        let within = |i: usize, j: usize| {
            let at = to_pixels * (DVec2::new(i as f64, j as f64) - pixels.first);
            let edge = DVec2::splat(0.5 + ROUNDING);
            at.cmpge(-edge).all() && at.cmple(DVec2::new(nx as f64, ny as f64) - 1.0 + edge).all()
        };
        let (mut all, mut lost) = (0usize, 0usize);
        let columns = stack.dims[0];
        for slice in &stack.slices {
            let level = slice.z >= first - half && slice.z <= last + half;
            for run in slice.content.mask().rows(columns) {
                all += run.len();
                lost += if level { run.filter(|n| !within(n % columns, n / columns)).count() } else { run.len() };
            }
        }
        lost as f64 / all.max(1) as f64
    }

    /// The header of a volume on the grid.
    pub fn header(&self, body: &Header) -> Header {
        let LikeGrid { dims, origin, steps, is_flat, .. } = &self.grid;
        let [u, v, w] = self.order;
        let space = body.geometry.space;
        let unit = |axis: usize| steps[axis] / steps[axis].length();
        let (geometry, grid) = if *is_flat {
            let order = [0, 1, 2];
            (Geometry { origin: *origin, axes: [unit(u), unit(v), body.geometry.axes[2]], order, space }, body.grid)
        } else {
            let grid = HeightGrid { start: 0.0, step: steps[w].length(), count: dims[w] };
            (Geometry { origin: *origin, axes: [unit(u), unit(v), unit(w)], order: self.order, space }, grid)
        };
        let spacing = [steps[u].length(), steps[v].length()];
        Header { dims: [dims[u], dims[v]], spacing, geometry, grid, ..body.clone() }
    }

    /// A writer of layers of `body` through `inner`, which has the header of the grid; `nearest` where layers have numbers of labels, which have
    /// nothing between them.
    pub fn writer(&self, inner: Box<dyn BodyWriter>, body: &Header, nearest: bool) -> Box<dyn BodyWriter> {
        Box::new(LikeWriter { inner, pixels: self.pixels(&body.geometry, body.spacing), nearest })
    }

    /// Its pixels among those of layers.
    fn pixels(&self, geometry: &Geometry, spacing: [f64; 2]) -> LikePixels {
        let [u, v, _] = self.order;
        let spacing = DVec2::from(spacing);
        let flat = |p: DVec3| DVec2::new(p.dot(geometry.axes[0]), p.dot(geometry.axes[1])) / spacing;
        LikePixels {
            dims: [self.grid.dims[u], self.grid.dims[v]],
            first: flat(self.grid.origin - geometry.origin),
            steps: [flat(self.grid.steps[u]), flat(self.grid.steps[v])],
        }
    }

    /// A writer of volumes that gives `inner` the layers from the top, where the grid's planes come so.
    pub fn turned(&self, inner: Box<dyn BodyWriter>) -> Box<dyn BodyWriter> {
        if self.falls && !self.grid.is_flat { Box::new(Turned { inner, layers: Vec::new() }) } else { inner }
    }
}

/// Writes layers on another grid of pixels.
struct LikeWriter {
    inner: Box<dyn BodyWriter>,
    pixels: LikePixels,
    /// Whether layers have numbers, which have nothing between them.
    nearest: bool,
}

/// A grid of pixels among those of a body's layers.
struct LikePixels {
    dims: [usize; 2],
    /// The first pixel and the steps to its neighbours, in pixels of the body's layers.
    first: DVec2,
    steps: [DVec2; 2],
}

impl LikePixels {
    /// A layer at these pixels, of the `nearest` of its own or between them.
    fn of_layer(&self, layer: &Layer, nearest: bool) -> Layer {
        let [nx, ny] = layer.phi.dims();
        let far = layer.phi.values().fold(f32::MIN_POSITIVE, |far, v| far.max(v.abs()));
        let outside = if nearest { 0.0 } else { far };
        let mut values = vec![outside; self.dims[0] * self.dims[1]];
        values.par_chunks_mut(self.dims[0].max(1)).enumerate().for_each(|(j, row)| {
            for (i, value) in row.iter_mut().enumerate() {
                let x = self.first + i as f64 * self.steps[0] + j as f64 * self.steps[1];
                let Some(x) = among(x, [nx, ny]) else { continue };
                *value = if nearest {
                    layer.phi.at(x.x.round() as usize, x.y.round() as usize)
                } else {
                    value_between(&layer.phi, x)
                };
            }
        });
        let phi = SparseImage::of(self.dims, &values);
        Layer { z: layer.z, phi, output: layer.output, contour: layer.contour }
    }
}

/// The place among the centres of `dims` pixels of which `x` has the value. Pixels are areas: half a pixel beyond their centres there is nothing.
/// A place that is a pixel's centre but for rounding is that centre: its own value comes back.
pub(super) fn among(x: DVec2, dims: [usize; 2]) -> Option<DVec2> {
    let last = DVec2::new(dims[0] as f64 - 1.0, dims[1] as f64 - 1.0);
    if !(x.cmpge(DVec2::splat(-0.5)).all() && x.cmple(last + 0.5).all()) {
        return None;
    }
    let x = x.clamp(DVec2::ZERO, last);
    let centre = x.round();
    Some(DVec2::select((x - centre).abs().cmplt(DVec2::splat(1e-6)), centre, x))
}

/// Bilinear value at a place among the centres of `dims` pixels, of which `at` tells the values.
pub(super) fn between(x: DVec2, dims: [usize; 2], at: impl Fn(usize, usize) -> f64) -> f64 {
    let [i, j] = [x.x as usize, x.y as usize];
    let [right, upper] = [(i + 1).min(dims[0] - 1), (j + 1).min(dims[1] - 1)];
    bilinear([at(i, j), at(right, j), at(i, upper), at(right, upper)], x.fract().to_array())
}

/// Value of a layer between its pixels; of one of them its own, between them never 0.
fn value_between(phi: &SparseImage<f32>, x: DVec2) -> f32 {
    if x.fract() == DVec2::ZERO {
        return phi.at(x.x as usize, x.y as usize);
    }
    let value = between(x, phi.dims(), |i, j| phi.at(i, j).into()) as f32;
    if value == 0.0 { f32::MIN_POSITIVE } else { value }
}

impl BodyWriter for LikeWriter {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        self.inner.layer(&self.pixels.of_layer(layer, self.nearest))
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        self.inner.finish(end)
    }
}

/// Keeps the output layers until the end, squares near the surface only, and gives them away from the top.
struct Turned {
    inner: Box<dyn BodyWriter>,
    layers: Vec<Layer>,
}

impl BodyWriter for Turned {
    fn layer(&mut self, layer: &Layer) -> io::Result<()> {
        if layer.output {
            self.layers.push(layer.clone());
        }
        Ok(())
    }

    fn finish(&mut self, end: &mut Ending<'_>) -> io::Result<()> {
        std::mem::take(&mut self.layers).iter().rev().try_for_each(|layer| self.inner.layer(layer))?;
        self.inner.finish(end)
    }
}
