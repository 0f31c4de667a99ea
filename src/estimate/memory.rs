//! Memory and disk that a reconstruction needs, asked before it starts.

use rayon::prelude::*;

use crate::contour::offsets::OUT;
use crate::error::{Error, Result};
use crate::estimate::coverage::{Drawn, differing, has_holes, parts};
use crate::fairing::{GAPS_AT_ONCE, LARGE_AT_ONCE, SMALL};
use crate::grid::tile::samples;
use crate::pipeline::ends::end_parts::TOGETHER;
use crate::pipeline::matching::{ASKED_BYTES, asked_bytes, kept_bytes};
use crate::pipeline::{AHEAD, LAYER_BYTES_ON_A_GPU, tile_margin};
use crate::settings::{Method, Motion, Settings};
use crate::stack::beyond::REACH;
use crate::stack::ending::LOOKED_AT;
use crate::stack::heights::{CAP_LAYERS, NODES, shown_nodes};
use crate::stack::{ContourStack, SliceContent};
use crate::storage::room::{available, check, check_temporary, free_disk};
use crate::storage::spill::Budget;

/// Bytes per padded pixel and slice that stay in memory where everything does: level set and parts; the fields, slopes and displacements of
/// the moving frame; both contours of an interval as its mid frame sees them; and, of the box around all contours, both ends of its groups.
const PER_SLICE_PIXEL: f64 = 14.0;
const PER_MOVING_PIXEL: f64 = 22.0;
const PER_FRAME_PIXEL: f64 = 26.0;
const PER_GROUP_PIXEL: f64 = 20.0;
/// Bytes per padded pixel of what one interval takes while it is worked on: its slices' fields and slopes, and a layer.
const PER_INTERVAL_PIXEL: f64 = 60.0;
/// Bytes per pixel of the box around all contours of a sweep, and of both ends of the groups of an interval.
const PER_SWEEP_PIXEL: f64 = 52.0;
/// Bytes per padded pixel of slices with their holes filled, and of fields and slopes of what is hollow in the interval at hand. On slices of 480 x 480 px a gut
/// and a leaning tube took 109 and 94 MiB without, where 97 and 82 were allowed.
const PER_HOLLOW_PIXEL: f64 = 140.0;
/// Bytes per padded pixel of the parts of a contour that says how the body ends.
const PER_END_PIXEL_ASKED: f64 = 17.0;
/// Bytes per padded pixel of every further layer that is made at once.
const PER_LAYER_PIXEL: f64 = 20.0;
/// Bytes per pixel of the image of the layer that is handed on, and of what its taker makes of it.
const PER_IMAGE_PIXEL: f64 = 8.0;
/// Bytes per pixel edge of the contours: seeds, in their slices and both frames, tracks, chains, slopes; of all slices where everything
/// stays in memory, else of three.
const PER_CONTOUR_EDGE: f64 = 800.0;
const CONTOURS_AT_ONCE: f64 = 3.0;
/// Bytes per pixel edge of a layer that waits to be faired, and at most per pixel; the gaps that wait.
const PER_WAITING_EDGE: f64 = 750.0;
const PER_WAITING_PIXEL: f64 = 20.0;
const WAITING_GAPS: f64 = 3.5;
/// A node takes this many times what another layer does.
const WAITING_SHARE: f64 = 3.0;
/// Layers between the threads that make them, look at them and take them.
const HANDED_OVER: f64 = 2.0 * (AHEAD + 1) as f64;
/// This part of what is allowed stays free, where more than the least is: the system's pages are larger than what lies in them.
const RESERVE: u64 = 16;
/// Bytes of a MiB.
const MIB: f64 = (1 << 20) as f64;

/// Bytes that do not depend on the stack.
const BASE_BYTES: f64 = 28.0 * 1024.0 * 1024.0;

/// Needs of a run on the reference path, estimated from above, as if every group filled the image. Whoever keeps the layers
/// ([`reconstruct`](crate::reconstruct)) needs 4 bytes of memory per voxel more; writing them takes what
/// [`format::bytes`](crate::files::format::bytes) says.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MemoryNeeds {
    /// Bytes of memory where everything stays there.
    pub all: u64,
    /// Bytes of memory where as much as can be is in a temporary file.
    pub least: u64,
    /// Bytes of the temporary file where nothing stays in memory.
    pub disk: u64,
}

impl MemoryNeeds {
    /// The needs of a run for `heights` (increasing) on so many threads.
    pub fn of(stack: &ContourStack, heights: &[f64], settings: &Settings, threads: usize) -> Self {
        let px = stack.spacing[0].max(stack.spacing[1]);
        let h = stack.spacing.map(|side| side / px);
        let image: f64 = stack.dims.iter().map(|n| *n as f64).product();
        let slices = stack.slices.len() as f64;
        let threads = threads as f64;
        let drawn: Vec<Drawn> = stack.slices.par_iter().map(|s| Drawn::of(&s.content, stack.dims)).collect();
        let all_drawn = drawn.iter().fold(Drawn::default(), Drawn::and);
        let largest = drawn.iter().map(|d| d.edges).max().unwrap_or(0) as f64;
        // What is computed lies in a window around all that is drawn, and what the border cuts goes on beyond it.
        let beyond = if all_drawn.at_border(stack.dims) { REACH } else { 0 };
        let [around, margin] = [8, 0].map(|more| samples(settings.margin() + more + beyond, h));
        let (padded, pixels) = (all_drawn.box_pixels(around), all_drawn.box_pixels(margin));
        let boxed = padded;
        let between = |w: &[crate::stack::Slice]| heights.iter().filter(|z| **z > w[0].z && **z < w[1].z).count();
        let most_between = stack.slices.windows(2).map(between).max().unwrap_or(0) as f64;
        let morph = settings.method == Method::Morph;
        let moving = match (settings.motion, settings.method) {
            (Motion::None, Method::Morph) => 0.0,
            (Motion::Field | Motion::Rigid, Method::Morph) => PER_MOVING_PIXEL + PER_FRAME_PIXEL,
            (_, Method::Field) => PER_MOVING_PIXEL,
        };
        let layers = (heights.len() + NODES * stack.slices.len() + 2) as f64;
        // Nodes wait with more than their distances, other layers with these alone.
        let nodes = NODES as f64;
        let waiting = |gaps: f64| {
            let waiting = layers.min(gaps * (most_between / WAITING_SHARE + nodes));
            let waiting = if settings.fair > 0.0 { waiting } else { 0.0 };
            waiting * (largest * PER_WAITING_EDGE).min(pixels * PER_WAITING_PIXEL)
        };
        let handed_over =
            layers.min(HANDED_OVER) * (largest * PER_WAITING_EDGE).min(pixels * PER_WAITING_PIXEL) / WAITING_SHARE;
        let more_gaps = if pixels < SMALL as f64 { GAPS_AT_ONCE as f64 } else { LARGE_AT_ONCE as f64 / nodes };
        let groups = if morph { boxed * PER_GROUP_PIXEL } else { 0.0 };
        // Parts and holes of both contours of an interval may be without counterpart: while they are asked for, and afterwards.
        let parts: Vec<usize> = match morph {
            true => stack.slices.par_iter().map(|s| parts(&s.content, stack.dims)).collect(),
            false => Vec::new(),
        };
        // Those of the contours that say how the body ends are asked for one contour after the other, where there is memory those of several, and
        // known farther.
        let margin = tile_margin(settings, h);
        let beyond_ends = [0, 1].map(|a| margin[a] + samples(OUT as usize, h)[a]);
        let at_ends = |parts: &[usize]| parts.iter().take(LOOKED_AT).max().copied().unwrap_or(0);
        let upside_down: Vec<usize> = parts.iter().rev().copied().collect();
        let at_ends = at_ends(&parts).max(at_ends(&upside_down)) as f64;
        let of_intervals = parts.windows(2).map(|pair| (pair[0] + pair[1]) as f64);
        let (parts, most_parts) = of_intervals.fold((0.0, 0.0), |(sum, most), n| (sum + n, f64::max(most, n)));
        let [asked, part] = [asked_bytes, kept_bytes].map(|bytes| bytes(margin) as f64);
        let ends = at_ends * (asked_bytes(beyond_ends) + 2 * kept_bytes(beyond_ends)) as f64;
        let ends_together =
            (padded * LOOKED_AT.min(stack.slices.len()) as f64 * PER_END_PIXEL_ASKED).min(TOGETHER as f64);
        let kept = slices * (padded * (PER_SLICE_PIXEL + moving) + groups) + parts * part;
        let asking = |together: f64| (most_parts * asked).max(together.min(parts * asked)).max(ends);
        // They close by caps, which have their own.
        let caps = |intervals: f64| (intervals * most_parts).min(parts) * part;
        let at_once =
            most_between.min((LAYER_BYTES_ON_A_GPU as f64 / (2.0 * size_of::<f64>() as f64 * padded)).max(1.0));
        let is_hollow = |pair: &[crate::stack::Slice]| pair.iter().all(|s| has_holes(&s.content, stack.dims));
        let hollow = moving > 0.0 && stack.slices.par_windows(2).any(is_hollow);
        let hollow = if hollow { padded * PER_HOLLOW_PIXEL } else { 0.0 };
        let sweeping = if morph { groups + threads * boxed * PER_SWEEP_PIXEL } else { 0.0 };
        let all = kept
            + all_drawn.edges as f64 * PER_CONTOUR_EDGE
            + waiting(WAITING_GAPS + more_gaps)
            + handed_over
            + asking(ASKED_BYTES as f64).max(ends_together).max(caps(2.0 * threads))
            + image * PER_IMAGE_PIXEL
            + hollow
            + (at_once * padded * PER_LAYER_PIXEL).max(threads * padded * 2.0 * PER_LAYER_PIXEL);
        let contours = largest * CONTOURS_AT_ONCE.min(slices) * PER_CONTOUR_EDGE;
        let interval = (padded * PER_INTERVAL_PIXEL).max(sweeping) + asking(0.0).max(most_parts * part + caps(1.0));
        let read = contents(stack);
        let least = interval + hollow + contours + waiting(WAITING_GAPS) + image * PER_IMAGE_PIXEL;
        let [all, least] = [all, least].map(|bytes| (BASE_BYTES + read + bytes) as u64);
        MemoryNeeds { all, least: least.min(all), disk: (kept + all_drawn.edges as f64 * PER_CONTOUR_EDGE) as u64 }
    }

    /// The needs of a section of `stack`, all of which has been read.
    pub fn within(self, stack: &ContourStack) -> Self {
        self.beside(contents(stack) as u64)
    }

    /// The needs with `bytes` of memory more for what is beside it: its outputs, say.
    pub fn beside(self, bytes: u64) -> Self {
        MemoryNeeds { all: self.all + bytes, least: self.least + bytes, ..self }
    }

    /// What is enough for this run and for another, one after the other.
    pub fn or(self, other: Self) -> Self {
        let MemoryNeeds { all, least, disk } = other;
        MemoryNeeds { all: self.all.max(all), least: self.least.max(least), disk: self.disk.max(disk) }
    }

    /// Budget of a run in memory beside `beside` bytes of others, where `limit` bytes are allowed in all, or else what is free.
    ///
    /// # Errors
    /// [`Error::Memory`] where even the least is too much; [`Error::Disk`] where the temporary file does not fit, [`Error::Output`] where there can be
    /// none.
    pub fn budget(&self, beside: u64, limit: Option<u64>) -> Result<Budget> {
        let Some(limit) = limit.or_else(available) else { return Ok(Budget::unlimited()) };
        if self.all + beside <= limit {
            return Ok(Budget::unlimited());
        }
        let least = self.least + beside;
        check(least, Some(limit))?;
        let folder = std::env::temp_dir();
        check_temporary(&folder)?;
        match free_disk(&folder) {
            Some(free) if free < self.disk => {
                Err(Error::Disk { folder, needed_mib: self.disk.div_ceil(1 << 20), available_mib: free >> 20 })
            }
            _ => {
                let rest = (limit - least).saturating_sub(limit / RESERVE);
                Ok(Budget::of(rest / 2, rest / 2))
            }
        }
    }
}

/// Bytes of the slices as they were read.
fn contents(stack: &ContourStack) -> f64 {
    let each = stack.slices.iter().map(|s| match &s.content {
        SliceContent::Mask(mask) => mask.bytes(),
        SliceContent::Level(u) => u.bytes(),
    });
    each.sum::<usize>() as f64
}

/// Triangles per pixel edge of the larger of the contours around a layer, per pixel in which neighbouring contours differ, and per pixel on
/// which the body ends.
const PER_LAYER_EDGE: f64 = 2.5;
const PER_DIFFERENCE: f64 = 3.0;
const PER_END_PIXEL: f64 = 3.0;

/// Triangles that the surface has at most, as far as contours tell.
pub fn triangles(stack: &ContourStack, heights: &[f64]) -> u64 {
    let drawn: Vec<Drawn> = stack.slices.par_iter().map(|s| Drawn::of(&s.content, stack.dims)).collect();
    let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    let shown = shown_nodes(&z, heights, stack.spacing[0].min(stack.spacing[1]));
    let layers =
        |low: f64, high: f64| (1 + heights.iter().chain(&shown).filter(|z| **z > low && **z < high).count()) as f64;
    let between = |(w, d): (&[crate::stack::Slice], &[Drawn])| {
        let edges = d[0].edges.max(d[1].edges) as f64;
        let differing = differing([&w[0].content, &w[1].content], stack.dims) as f64;
        layers(w[0].z, w[1].z) * edges * PER_LAYER_EDGE + differing * PER_DIFFERENCE
    };
    let sides = stack.slices.par_windows(2).zip(drawn.par_windows(2)).map(between);
    let end = |d: &Drawn, low: f64, high: f64| {
        layers(low, high).max(CAP_LAYERS as f64) * d.edges as f64 * PER_LAYER_EDGE + d.pixels as f64 * PER_END_PIXEL
    };
    let first = stack.slices.first().zip(drawn.first()).map_or(0.0, |(s, d)| end(d, f64::NEG_INFINITY, s.z));
    let last = stack.slices.last().zip(drawn.last()).map_or(0.0, |(s, d)| end(d, s.z, f64::INFINITY));
    (sides.collect::<Vec<f64>>().iter().sum::<f64>() + first + last) as u64
}

/// Refuses slices of so many pixels that could not even wait for their turn: what is kept of each, in memory or in a temporary file.
///
/// # Errors
/// Refusal of what takes too much: its size and what is free.
pub fn check_slices(pixels: f64, slices: usize) -> std::result::Result<(), String> {
    let needed = PER_SLICE_PIXEL * pixels * slices as f64;
    match available().zip(free_disk(&std::env::temp_dir())) {
        Some((memory, disk)) if needed > memory as f64 + disk as f64 => Err(format!(
            "take {:.0} MiB of memory and temporary files, {} and {} MiB are available",
            (needed / MIB).ceil(),
            memory >> 20,
            disk >> 20
        )),
        _ => Ok(()),
    }
}
