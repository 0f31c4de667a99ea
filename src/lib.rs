//! Smooth closed surfaces from stacks of parallel contours.
//!
//! The method is contour metamorphosis: Nilsson, Breen and Museth, "Surface Reconstruction Via Contour Metamorphosis: An Eulerian Approach
//! With Lagrangian Particle Tracking", IEEE Visualization 2005. Neighbouring contours are morphed into each other by 2D level sets, tracker
//! particles measure how far every piece of contour travels, splines through those distances give speeds, and a second level-set pass sweeps
//! out the surface. It passes through every input contour, is closed whatever the topology, and crosses contours without a visible crease. `docs/method.md` in the
//! repository has the equations and where this implementation departs from the paper.
//!
//! # A program
//!
//! ```
//! use interslice::{ContourStack, Geometry, Settings, Slice, SliceContent, reconstruct};
//!
//! # fn main() -> interslice::Result<()> {
//! // Three discs of radius 9, 11 and 8 px on slices 4 mm apart.
//! let disc = |radius: f64| {
//!     let inside = |node: usize| ((node % 32) as f64 - 15.5).hypot((node / 32) as f64 - 15.5) < radius;
//!     SliceContent::Mask((0..32 * 32).map(inside).collect())
//! };
//! let slice = |(k, radius): (usize, f64)| Slice {
//!     name: format!("slice {k}"),
//!     z: 4.0 * k as f64,
//!     extra: false,
//!     content: disc(radius),
//! };
//! let stack = ContourStack {
//!     dims: [32, 32],
//!     spacing: [1.0, 1.0],
//!     unit: "mm".into(),
//!     slices: [9.0, 11.0, 8.0].into_iter().enumerate().map(slice).collect(),
//!     z_out: None,
//!     geometry: Geometry::default(),
//!     known: None,
//! };
//!
//! let body = reconstruct(&stack, &Settings::default())?;
//! let mesh = body.mesh();
//! // The discs alone, by the trapezoidal rule, hold 2430 mm3; the surface bulges between them, and ends flat at the first and the last.
//! assert!((2450.0..2700.0).contains(&mesh.volume()));
//! assert!(body.report.contours.iter().all(|contour| contour.differing_pixels == 0));
//! # Ok(())
//! # }
//! ```
//!
//! # What there is
//!
//! | to | use |
//! |---|---|
//! | read files | [`read`] with [`ReadOptions`]; a [`ContourStack`] can be made by hand, too |
//! | say how | [`Settings`]; their names, ranges and defaults are those of the command line |
//! | reconstruct | [`reconstruct`], [`reconstruct_with`] a [`Backend`], [`reconstruct_into`] a [`LayerSink`], layer by layer |
//! | change a slice, or ask for more heights | [`Body`], which computes only what depends on it |
//! | use a result | [`Reconstruction`]: its [`Layer`]s, whose distances are a [`SparseImage`], [`mesh`](Reconstruction::mesh), [`Report`] |
//! | write files | [`write()`]; formats by extension |
//! | go from labels to labels | [`fill_labels`] |
//! | see how well it does | [`evaluate`] by slices that are left out |
//! | choose a machine | [`Reference`] (f64, CPU) or `Gpu` (f32, wgpu; feature `gpu`) |
//! | handle errors | [`Error`], an enum; a message names file, slice, value and limit |
//!
//! Lengths are in the unit of the stack's spacing, "px" is the larger side of a pixel, distances are negative inside. Other modules are the
//! program's own: they can be reached, are not documented here, and may change in any version.

#![warn(missing_docs)]

// The command line names what it uses as everybody else does.
extern crate self as interslice;

#[doc(hidden)]
pub mod backend;
#[doc(hidden)]
pub mod batch;
mod body;
#[doc(hidden)]
#[macro_use]
pub mod cli;
mod connectivity;
#[doc(hidden)]
pub mod contour;
#[doc(hidden)]
pub mod error;
#[doc(hidden)]
pub mod estimate;
#[doc(hidden)]
pub mod evaluate;
mod fairing;
#[doc(hidden)]
pub mod files;
#[cfg(feature = "gpu")]
#[doc(hidden)]
pub mod gpu;
#[doc(hidden)]
pub mod grid;
#[doc(hidden)]
pub mod input;
#[doc(hidden)]
pub mod labels;
#[doc(hidden)]
pub mod pipeline;
#[doc(hidden)]
pub mod polygons;
#[doc(hidden)]
pub mod preset;
#[doc(hidden)]
pub mod progress;
mod reconstruct;
#[doc(hidden)]
pub mod reference;
#[doc(hidden)]
pub mod registration;
pub mod report;
#[cfg(feature = "dicom")]
#[doc(hidden)]
pub mod rtstruct;
pub mod settings;
#[doc(hidden)]
pub mod stack;
#[doc(hidden)]
pub mod storage;
#[doc(hidden)]
pub mod surface;
#[cfg(feature = "terrain")]
#[doc(hidden)]
pub mod terrain;

pub use backend::{Backend, Means};
pub use body::Body;
pub use error::{Error, Result};
pub use evaluate::holdout::{Compared, HoldOut, SliceScore, hold_out as evaluate};
pub use files::labels::fill_labels;
pub use files::write::write;
#[cfg(feature = "gpu")]
pub use gpu::{Gpu, GpuOptions};
pub use grid::sparse_image::SparseImage;
pub use input::labels::Wanted;
pub use input::read;
pub use labels::report::{Borders, LabelReport, LabelsReport, LeftOut};
#[doc(hidden)]
pub use pipeline::Bonds;
#[doc(hidden)]
pub use pipeline::section::Section;
pub use progress::{Progress, Silent};
pub use reconstruct::{reconstruct, reconstruct_into, reconstruct_with};
#[doc(hidden)]
pub use reconstruct::{reconstruct_loosely, reconstruct_section};
pub use reference::Reference;
pub use report::Report;
pub use settings::Settings;
pub use stack::axis::Axis;
pub use stack::heights::height_grid;
pub use stack::{
    ContourStack, Geometry, HeightGrid, Known, LevelSlice, Mask, ReadOptions, Slice, SliceContent, WorldSpace,
};
pub use storage::spill::Budget;
pub use surface::header::Header;
pub use surface::mesh::{Mesh, Vertex};
pub use surface::stream::LayerSink;
pub use surface::{Layer, Reconstruction};
