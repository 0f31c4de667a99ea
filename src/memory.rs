//! How much memory and disk a reconstruction needs, asked before it starts.

use std::path::Path;

use rayon::prelude::*;
use sysinfo::{DiskRefreshKind, Disks, System};

use crate::error::{Error, Result};
use crate::pipeline::CHUNK_BYTES;
use crate::settings::{Method, Motion, Settings};
use crate::shelf::Budget;
use crate::stack::{ContourStack, SliceContent};

/// Bytes per padded pixel and slice: level set, labels of solids and background, the level sets of its groups below and above.
const PER_SLICE_PIXEL: f64 = 56.0;
/// The same for the moving frame: fields and slopes of the slices, and of the morph both contours of every interval in its mid frame.
const PER_MOVING_PIXEL: f64 = 24.0;
const PER_FRAME_PIXEL: f64 = 96.0;
/// Bytes per pixel of a layer that waits to be faired, and the gaps that wait.
const PER_WAITING_PIXEL: f64 = 12.0;
const WAITING_GAPS: f64 = 3.0;
/// Bytes per pixel and layer of the tiles of both directions while an interval is swept and blended. Finished layers are written and forgotten.
const PER_SWEPT_PIXEL: f64 = 8.0;
const PER_BLENDED_PIXEL: f64 = 28.0;

/// Of a run that keeps as little as it can: bytes per pixel and slice that stay in memory all the same (the slice's own values),
/// and per padded pixel of what one interval takes while it is worked on.
const PER_MASK_PIXEL: f64 = 1.0;
const PER_LEVEL_PIXEL: f64 = 4.0;
const PER_INTERVAL_PIXEL: f64 = 160.0;
/// Bytes per pixel edge of the contours: seeds, in their slices and both frames, tracks, chains, slopes. They stay in memory.
const PER_CONTOUR_EDGE: f64 = 1200.0;
/// Bytes that do not depend on the stack.
const BASE_BYTES: f64 = 24.0 * 1024.0 * 1024.0;

/// What a run on the reference path needs, estimated from above, as if every group filled the image. Whoever keeps the layers
/// ([`reconstruct`](crate::reconstruct)) needs 4 bytes of memory per voxel more; writing them takes what
/// [`format::bytes`](crate::files::format::bytes) says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// Bytes of memory where everything stays there.
    pub all: u64,
    /// Bytes of memory where as much as can be is in a temporary file.
    pub least: u64,
    /// Bytes of what one interval takes, in `least`.
    interval: u64,
    /// Bytes of the temporary file where nothing stays in memory.
    pub disk: u64,
}

impl Needs {
    /// Of a run for `heights` (increasing) on so many threads.
    pub fn of(stack: &ContourStack, heights: &[f64], settings: &Settings, threads: usize) -> Self {
        let padded: f64 = stack.dims.iter().map(|n| (n + 2 * (settings.margin() + 8)) as f64).product();
        let pixels: f64 = stack.dims.iter().map(|n| *n as f64).product();
        let slices = stack.slices.len() as f64;
        let layers = (heights.len() + stack.slices.len() + 2) as f64;
        let between = |w: &[crate::stack::Slice]| heights.iter().filter(|z| **z > w[0].z && **z < w[1].z).count();
        let most_between = stack.slices.windows(2).map(between).max().unwrap_or(0) as f64;
        let at_once = (2 * threads).min(stack.slices.len()) as f64;
        let swept = (at_once * most_between * padded).max(CHUNK_BYTES as f64 / 4.0).min(layers * padded);
        let moving = match (settings.motion, settings.method) {
            (Motion::None, Method::Morph) => 0.0,
            (Motion::Field | Motion::Rigid, Method::Morph) => PER_MOVING_PIXEL + PER_FRAME_PIXEL,
            (_, Method::Field) => PER_MOVING_PIXEL,
        };
        let waiting = if settings.fair > 0.0 { layers.min(WAITING_GAPS * most_between) } else { 0.0 };
        let waiting = waiting * pixels * PER_WAITING_PIXEL;
        let kept = slices * padded * (PER_SLICE_PIXEL + moving);
        let all = kept + waiting + swept * PER_SWEPT_PIXEL + most_between * padded * PER_BLENDED_PIXEL;
        let contours: usize = stack.slices.par_iter().map(|s| edges(&s.content, stack.dims)).sum();
        let contours = contours as f64 * PER_CONTOUR_EDGE;
        let at_once = most_between.min(threads as f64);
        let interval = padded * (PER_INTERVAL_PIXEL + most_between * PER_SWEPT_PIXEL + at_once * PER_BLENDED_PIXEL);
        let least = BASE_BYTES + contents(stack) + contours + interval + waiting;
        let [all, least] = [all + contours, least].map(|bytes| bytes as u64);
        Needs { all, least: least.min(all), interval: interval as u64, disk: kept as u64 }
    }

    /// The same of a section of `stack`, all of which has been read.
    pub fn within(self, stack: &ContourStack) -> Self {
        let read = contents(stack) as u64;
        Needs { all: self.all + read, least: self.least + read, ..self }
    }

    /// What a run may keep in memory beside `beside` bytes of others, where `limit` bytes are allowed in all, or else what is free.
    ///
    /// # Errors
    /// [`Error::Memory`] where even the least is too much; [`Error::Disk`] where the temporary file does not fit.
    pub fn budget(&self, beside: u64, limit: Option<u64>) -> Result<Budget> {
        let Some(limit) = limit.or_else(available) else { return Ok(Budget::unlimited()) };
        if self.all + beside <= limit {
            return Ok(Budget::unlimited());
        }
        let least = self.least + beside;
        check(least, Some(limit))?;
        let folder = std::env::temp_dir();
        match free_disk(&folder) {
            Some(free) if free < self.disk => {
                Err(Error::Disk { folder, needed_mib: self.disk.div_ceil(1 << 20), available_mib: free >> 20 })
            }
            _ => Ok(Budget::of((limit - least) / 2, self.interval + (limit - least) / 2)),
        }
    }
}

/// Bytes of the slices as they were read.
fn contents(stack: &ContourStack) -> f64 {
    let pixels: f64 = stack.dims.iter().map(|n| *n as f64).product();
    let each = stack.slices.iter().map(|s| match s.content {
        SliceContent::Mask(_) => PER_MASK_PIXEL * pixels,
        SliceContent::Level(_) => PER_LEVEL_PIXEL * pixels,
    });
    each.sum()
}

/// Edges between a pixel inside and one outside.
fn edges(content: &SliceContent, [nx, ny]: [usize; 2]) -> usize {
    let crossings = |j: usize| {
        let inside = |i: usize, j: usize| content.inside(j * nx + i);
        let right = (1..nx).filter(|&i| inside(i, j) != inside(i - 1, j)).count();
        right + if j > 0 { (0..nx).filter(|&i| inside(i, j) != inside(i, j - 1)).count() } else { 0 }
    };
    (0..ny).map(crossings).sum()
}

/// Bytes that are free on the disk of a folder; nothing on a system that does not tell.
fn free_disk(folder: &Path) -> Option<u64> {
    let folder = folder.canonicalize().ok()?;
    let disks = Disks::new_with_refreshed_list_specifics(DiskRefreshKind::nothing().with_storage()).ok()?;
    let holding = disks.iter().filter(|disk| folder.starts_with(disk.mount_point()));
    holding.max_by_key(|disk| disk.mount_point().components().count()).map(|disk| disk.available_space())
}

/// Bytes of memory that are free; nothing on a system that does not tell.
pub fn available() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory();
    Some(system.available_memory()).filter(|bytes| *bytes > 0)
}

/// Refuses to hold what was read where it is larger than the memory that is free.
///
/// # Errors
/// What takes too much: its size and what is free.
pub fn check_room(bytes: f64) -> std::result::Result<(), String> {
    const MIB: f64 = (1 << 20) as f64;
    match available() {
        Some(free) if bytes > free as f64 => {
            Err(format!("take {:.0} MiB of memory, {} MiB are available", (bytes / MIB).ceil(), free >> 20))
        }
        _ => Ok(()),
    }
}

/// Refuses what needs more memory than `limit`, or else than is free.
///
/// # Errors
/// [`Error::Memory`] with both figures.
pub fn check(needed: u64, limit: Option<u64>) -> Result<()> {
    match limit.or_else(available) {
        Some(available) if needed > available => {
            Err(Error::Memory { needed_mib: needed.div_ceil(1 << 20), available_mib: available >> 20 })
        }
        _ => Ok(()),
    }
}
