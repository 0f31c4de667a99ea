//! Steps in which the layers of morphed intervals are made, as many together as a device has room for.

use std::ops::Range;

use super::Gpu;
use super::atlas::padded;
use super::distance;
use super::morph_layer::beside;
use super::packed_layers::square_count;
use super::work;
use crate::backend::interval_morph::IntervalMorph;
use crate::grid::sparse_image::AREA;
use crate::registration::displacement::BLOCK as STRIDE;

/// Images of an interval's fields on the device: slices, slopes, and what the way to the frame loses.
pub const FIELDS: usize = 6;
/// Images of the ground: either contour, and the layer beside it.
pub const GROUNDS: usize = 4;
/// Share of the device that layers have at least, whatever else is there.
const LEAST: f64 = 0.3;

/// Layers of an interval, which has this number, by their numbers there.
pub type Step = (usize, Vec<usize>);

/// Layers of all intervals in the order in which they are made: those beside the contours first, as others need them.
pub fn steps(intervals: &[IntervalMorph<'_>]) -> Vec<Step> {
    let mut out = Vec::new();
    for (i, of) in intervals.iter().enumerate() {
        let mut first: Vec<usize> = Vec::new();
        if of.frame.is_some() {
            first.extend(beside(of).into_iter().flatten());
            first.sort_unstable();
            first.dedup();
            out.push((i, first.clone()));
        }
        out.extend((0..of.times.len()).filter(|k| !first.contains(k)).map(|k| (i, vec![k])));
    }
    out
}

/// Steps that are made together, in order: as many as a device has room for on which there are so many bytes besides.
pub fn batches(gpu: &Gpu, intervals: &[IntervalMorph<'_>], steps: &[Step], besides: usize) -> Vec<Range<usize>> {
    let left = (1.0 - gpu.share(besides, 0)).max(LEAST);
    let fits = |load: &Load| {
        let share = (gpu.share(load.bytes, 0) / left).max(gpu.share(0, load.largest));
        share.max(gpu.share_of_work(load.work)) <= 1.0
    };
    let mut out: Vec<Range<usize>> = Vec::new();
    let mut load = Load::default();
    for (n, (i, layers)) in steps.iter().enumerate() {
        let with = |load: &Load| load.with((*i, &intervals[*i]), layers.len());
        let more = with(&load);
        match out.last_mut() {
            Some(batch) if fits(&more) => {
                batch.end = n + 1;
                load = more;
            }
            _ => {
                out.push(n..n + 1);
                load = with(&Load::default());
            }
        }
    }
    out
}

/// What layers that are made together take of a device.
#[derive(Debug, Default)]
struct Load {
    bytes: usize,
    /// Bytes of the largest array.
    largest: usize,
    /// Values of the costliest dispatch.
    work: usize,
    /// Pixels of the slices of all groups.
    slices: usize,
    /// The last interval and the number of its layers: an interval's layers have arrays and dispatches of their own.
    last: Option<(usize, usize)>,
}

impl Load {
    /// So many more layers of interval `i`.
    fn with(&self, (i, of): (usize, &IntervalMorph<'_>), more: usize) -> Load {
        let nodes: usize = of.image.padded().iter().product();
        let squares = square_count(of.image);
        let (known, layers) = match self.last {
            Some((last, layers)) if last == i => (true, layers + more),
            _ => (false, more),
        };
        let slices: usize = of.pairs.iter().map(|(tile, _)| padded(tile.len())).sum();
        let all_slices = self.slices + more * slices;
        let (mut fixed, mut each, mut parts, mut images) = (0, 0, 0, layers * nodes);
        if let Some(frame) = &of.frame {
            let caps: usize = of.solids.iter().map(|(cap, _)| cap.field.data.len()).sum();
            let fields = FIELDS * nodes + frame.part_pixels;
            // Fields lie there twice when they are new.
            fixed = 4 * (fields + 4 * nodes + GROUNDS * nodes + caps) + 32 * nodes / (STRIDE * STRIDE);
            each = 24 * nodes / (STRIDE * STRIDE);
            parts = frame.parts;
            images = (images + GROUNDS * nodes).max(fields);
        }
        // In the frame, at its place, packed and read back.
        each += slices * (distance::NODE_BYTES + 4) + 8 * nodes + squares * (8 * AREA + 16);
        let arrays = [all_slices, images, layers * squares * AREA].map(|values| 4 * values);
        let warp = (2 * work::LAYER_PIXEL + work::LONE_PART * parts) * nodes * layers;
        Load {
            bytes: self.bytes + more * each + if known { 0 } else { fixed },
            largest: arrays.into_iter().fold(self.largest, usize::max),
            work: self.work.max(work::DISTANCE_PIXEL * all_slices).max(warp),
            slices: all_slices,
            last: Some((i, layers)),
        }
    }
}
