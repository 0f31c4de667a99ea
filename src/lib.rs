//! Smooth closed surfaces from stacks of parallel contours, by contour metamorphosis.

#![warn(missing_docs)]

pub mod backend;
pub mod batch;
pub mod caps;
pub mod components;
mod compose;
pub mod conditioning;
pub mod contour;
mod contours;
pub mod demo;
pub mod displacement;
mod ends;
pub mod error;
mod fairing;
pub mod field;
pub mod files;
mod fit;
mod frames;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod heights;
pub mod holdout;
pub mod jobs;
pub mod links;
mod matching;
pub mod memory;
mod motion;
pub mod moving_field;
pub mod parts;
mod pipeline;
pub mod polygons;
pub mod progress;
pub mod reference;
pub mod report;
mod rigid;
#[cfg(feature = "dicom")]
pub mod rtstruct;
pub mod settings;
pub mod spline;
pub mod stack;
pub mod stencil;
pub mod surface;
pub mod topology;
mod tracks;
mod trust;
mod warp;

pub use backend::Backend;
pub use error::{Error, Result};
pub use heights::height_grid;
pub use progress::Progress;
pub use reference::Reference;
pub use report::Report;
pub use settings::Settings;
pub use stack::ContourStack;
pub use surface::Reconstruction;

/// Reconstructs the body between the contours of `stack` on the reference path, at the heights [`height_grid`] gives.
///
/// # Errors
/// [`Error::Stack`], [`Error::Slice`] or [`Error::Setting`] for wrong input, before anything is computed; [`Error::Numerics`] when a
/// stage fails.
pub fn reconstruct(stack: &ContourStack, settings: &Settings) -> Result<Reconstruction> {
    stack.validate()?;
    let heights = height_grid(stack, settings, None).heights()?;
    reconstruct_with(stack, &heights, settings, &Reference, &progress::Silent)
}

/// The same at given heights (increasing, unit of the stack), on any backend, told to `progress`.
///
/// # Errors
/// As [`reconstruct`].
pub fn reconstruct_with(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    backend: &dyn Backend,
    progress: &dyn Progress,
) -> Result<Reconstruction> {
    let mut layers = Vec::new();
    let mut keep = |layer| {
        layers.push(layer);
        Ok(())
    };
    let body = pipeline::run(stack, heights, settings, backend, progress, &mut keep)?;
    Ok(Reconstruction { layers, ..body })
}

/// The same with every layer handed to `sink` as soon as it is finished, lowest first, so that the volume need not fit in memory; the result
/// has no layers.
///
/// # Errors
/// As [`reconstruct`]; what `sink` says.
pub fn reconstruct_into(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    backend: &dyn Backend,
    progress: &dyn Progress,
    sink: &mut dyn FnMut(surface::Layer) -> Result<()>,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, backend, progress, sink)
}
