//! Reconstruction: a checked stack becomes the body's layers.

use crate::backend::{Backend, Means};
use crate::error::Result;
use crate::pipeline;
use crate::pipeline::Bonds;
use crate::pipeline::section::Section;
use crate::progress::{Progress, Silent};
use crate::reference::Reference;
use crate::settings::Settings;
use crate::stack::ContourStack;
use crate::stack::heights::height_grid;
use crate::storage::spill::Budget;
use crate::surface::stream::LayerSink;
use crate::surface::{Layer, Reconstruction};

/// Reconstructs the body between the contours of `stack` on the reference path, at the heights [`height_grid`] gives.
///
/// # Errors
/// [`Error::Stack`](crate::Error::Stack), [`Error::Slice`](crate::Error::Slice) or [`Error::Setting`](crate::Error::Setting) for wrong input, before anything is computed; [`Error::Numerics`](crate::Error::Numerics) when a
/// stage fails.
pub fn reconstruct(stack: &ContourStack, settings: &Settings) -> Result<Reconstruction> {
    stack.validate()?;
    let heights = height_grid(stack, settings, None).heights()?;
    reconstruct_with(stack, &heights, settings, &Reference, &Silent)
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
    let mut keep = |layer: Layer| {
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
/// The errors of [`reconstruct`]; what `sink` says; [`Error::Read`](crate::Error::Read) or [`Error::Write`](crate::Error::Write) of the temporary file beyond the budget.
pub fn reconstruct_into(
    stack: &ContourStack,
    heights: &[f64],
    settings: &Settings,
    means: &Means<'_>,
    sink: &mut dyn LayerSink,
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
    sink: &mut dyn LayerSink,
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
    sink: &mut dyn LayerSink,
) -> Result<Reconstruction> {
    pipeline::run(stack, heights, settings, section, Bonds::ALL, means, sink)
}
