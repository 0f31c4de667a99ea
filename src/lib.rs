//! Smooth closed surfaces from stacks of parallel contours, by contour metamorphosis.

#![warn(missing_docs)]

pub mod backend;
pub mod batch;
mod connectivity;
pub mod contour;
pub mod error;
pub mod estimate;
pub mod evaluate;
mod fairing;
pub mod files;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod grid;
pub mod input;
pub mod labels;
pub mod pipeline;
pub mod polygons;
pub mod preset;
pub mod progress;
pub mod reference;
pub mod registration;
pub mod report;
#[cfg(feature = "dicom")]
pub mod rtstruct;
pub mod settings;
pub mod stack;
pub mod storage;
pub mod surface;
#[cfg(feature = "terrain")]
pub mod terrain;

pub use backend::{Backend, Means};
pub use error::{Error, Result};
pub use pipeline::Bonds;
pub use pipeline::section::Section;
pub use progress::Progress;
pub use reference::Reference;
pub use report::Report;
pub use settings::Settings;
pub use stack::ContourStack;
pub use stack::heights::height_grid;
pub use storage::spill::Budget;
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

/// Reconstructs the body at given heights (increasing, unit of the stack), on any backend, and tells `progress` how far it is.
///
/// # Errors
/// The errors of [`reconstruct`].
pub fn reconstruct_with(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    backend: &dyn Backend,
    progress: &dyn Progress,
) -> Result<Reconstruction> {
    let mut layers = Vec::new();
    let mut keep = |layer: surface::Layer| {
        layers.push(layer);
        Ok(())
    };
    let means = Means { backend, progress, budget: &Budget::unlimited() };
    let body = reconstruct_into(stack, heights, settings, &means, &mut keep)?;
    Ok(Reconstruction { layers, ..body })
}

/// Reconstructs the body and hands every layer to `sink` (a closure will do) as soon as it is finished, lowest first, so that neither slices nor
/// volume need fit in memory. The result has no layers and does not depend on the budget.
///
/// # Errors
/// The errors of [`reconstruct`]; what `sink` says; [`Error::Read`] or [`Error::Write`] of the temporary file beyond the budget.
pub fn reconstruct_into(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    means: &Means<'_>,
    sink: &mut dyn surface::stream::LayerSink,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, &Section::whole(stack), Bonds::ALL, means, sink)
}

/// Reconstructs the body with some of the [`Bonds`] that hold it together left out, to measure what they are worth.
///
/// # Errors
/// The errors of [`reconstruct_into`].
pub fn reconstruct_loosely(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    bonds: Bonds,
    means: &Means<'_>,
    sink: &mut dyn surface::stream::LayerSink,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, &Section::whole(stack), bonds, means, sink)
}

/// Reconstructs a section of `stack`: its layers are, bit by bit, those of the whole; `heights` are those of the whole. The report has the
/// section's contours, both ends included, and its intervals; the extent is the body's where the section ends with the stack.
///
/// # Errors
/// The errors of [`reconstruct_into`].
pub fn reconstruct_section(
    stack: &ContourStack,
    section: &Section,
    heights: &[f64],
    settings: &Settings,
    means: &Means<'_>,
    sink: &mut dyn surface::stream::LayerSink,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, section, Bonds::ALL, means, sink)
}
