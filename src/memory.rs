//! How much memory a reconstruction needs, asked before it starts.

use sysinfo::System;

use crate::error::{Error, Result};
use crate::pipeline::CHUNK_BYTES;
use crate::settings::{Method, Motion, Settings};
use crate::stack::ContourStack;

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

/// Bytes a run on the reference path needs at most, for `heights` (increasing) and `threads`: an estimate from above, as if every group
/// filled the image. Whoever keeps the layers ([`reconstruct`](crate::reconstruct)) needs 4 bytes per voxel more; writing them takes what
/// [`outputs::bytes`](crate::files::outputs::bytes) says.
pub fn estimate_bytes(stack: &ContourStack, heights: &[f64], settings: &Settings, threads: usize) -> u64 {
    let padded: f64 = stack.dims.iter().map(|n| (n + 2 * (settings.margin() + 8)) as f64).product();
    let pixels: f64 = stack.dims.iter().map(|n| *n as f64).product();
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
    let bytes = stack.slices.len() as f64 * padded * (PER_SLICE_PIXEL + moving)
        + waiting * pixels * PER_WAITING_PIXEL
        + swept * PER_SWEPT_PIXEL
        + most_between * padded * PER_BLENDED_PIXEL;
    bytes as u64
}

/// Bytes of memory that are free; nothing on a system that does not tell.
pub fn available() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory();
    Some(system.available_memory()).filter(|bytes| *bytes > 0)
}

/// Refuses a run that needs more than is free.
///
/// # Errors
/// [`Error::Memory`] with both figures.
pub fn check(needed: u64) -> Result<()> {
    match available() {
        Some(available) if needed > available => {
            Err(Error::Memory { needed_mib: needed >> 20, available_mib: available >> 20 })
        }
        _ => Ok(()),
    }
}
