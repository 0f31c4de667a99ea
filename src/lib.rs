//! Smooth closed surfaces from stacks of parallel contours, by contour metamorphosis.

#![warn(missing_docs)]

pub mod error;
pub mod progress;
pub mod report;
pub mod settings;
pub mod stack;
pub mod surface;

pub use error::{Error, Result};
pub use progress::Progress;
pub use report::Report;
pub use settings::Settings;
pub use stack::ContourStack;
pub use surface::Reconstruction;

/// Reconstructs the body between the contours of `stack`.
///
/// # Errors
/// [`Error::Stack`], [`Error::Slice`], [`Error::Setting`] or [`Error::Memory`] for wrong input, before anything is computed;
/// [`Error::Numerics`] when a stage fails.
pub fn reconstruct(stack: &ContourStack, settings: &Settings) -> Result<Reconstruction> {
    let _ = (stack, settings);
    Err(Error::Numerics { stage: "pipeline", message: "not built yet".into() })
}
