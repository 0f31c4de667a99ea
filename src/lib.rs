//! Smooth closed surfaces from stacks of parallel contours, by contour metamorphosis.

#![warn(missing_docs)]

pub mod appearance;
pub mod areas;
pub mod backend;
pub mod batch;
pub mod caps;
pub mod change;
mod closing;
pub mod components;
mod compose;
pub mod conditioning;
pub mod contour;
mod contours;
mod cores;
pub mod demo;
pub mod displacement;
mod drawn;
pub mod effort;
pub mod end_law;
mod end_parts;
mod ends;
pub mod error;
pub mod examined;
mod fairing;
pub mod field;
pub mod files;
mod fit;
mod frames;
#[cfg(feature = "gpu")]
pub mod gpu;
mod grounded;
pub mod heights;
pub mod holdout;
pub mod jobs;
pub mod labels;
pub mod links;
mod lone_part;
pub mod map;
mod matching;
pub mod memory;
mod motion;
pub mod moving_field;
mod moving_stack;
mod offsets;
pub mod packed;
pub mod parts;
mod pipeline;
pub mod polygons;
pub mod preset;
pub mod progress;
pub mod reference;
pub mod report;
mod rigid;
#[cfg(feature = "dicom")]
pub mod rtstruct;
pub mod runs;
pub mod section;
pub mod settings;
pub mod shelf;
pub mod spline;
pub mod stack;
pub mod stencil;
pub mod surface;
#[cfg(feature = "terrain")]
pub mod terrain;
pub mod tile;
pub mod topology;
mod tracks;
mod trust;
pub mod verdict;
mod warp;

pub use backend::{Backend, Means};
pub use error::{Error, Result};
pub use heights::height_grid;
pub use pipeline::Bonds;
pub use progress::Progress;
pub use reference::Reference;
pub use report::Report;
pub use section::Section;
pub use settings::Settings;
pub use shelf::Budget;
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
    let mut keep = |layer: surface::Layer| {
        layers.push(layer);
        Ok(())
    };
    let means = Means { backend, progress, budget: &Budget::unlimited() };
    let body = reconstruct_into(stack, heights, settings, &means, &mut keep)?;
    Ok(Reconstruction { layers, ..body })
}

/// The same with every layer handed to `sink` (a closure will do) as soon as it is finished, lowest first, so that neither slices nor volume
/// need fit in memory; the result has no layers and does not depend on the budget.
///
/// # Errors
/// As [`reconstruct`]; what `sink` says; [`Error::Read`] or [`Error::Write`] of the temporary file beyond the budget.
pub fn reconstruct_into(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    means: &Means<'_>,
    sink: &mut dyn surface::stream::LayerSink,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, &Section::whole(stack), Bonds::ALL, means, sink)
}

/// The same with some of what holds the body together left out, to see what that is worth.
///
/// # Errors
/// As [`reconstruct_into`].
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

/// The layers of a section of `stack`, bit by bit those of the whole; `heights` are those of the whole. The report has the section's contours,
/// both ends included, and its intervals; the extent is the body's where the section ends with the stack.
///
/// # Errors
/// As [`reconstruct_into`].
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
