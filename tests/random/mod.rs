//! Random stacks, what must hold for all of them, and results that are wrong on purpose.
//!
//! ```text
//! seed -> Numbers -> Case (stack, settings) -> property(case, source) -> what was measured, against its bound
//! ```
//!
//! A [`source::Source`] gives the layers of a stack: the program on either backend; straight lines between the slices' distances, which keep
//! every promise by construction; or those, damaged, so that a property can be seen to fail. The test suite (`tests/promises`) and the
//! campaign (`benches/campaign.rs`) share all of it.
#![allow(dead_code)]

pub mod case;
pub mod measure;
pub mod numbers;
pub mod parts;
pub mod ply;
pub mod properties;
pub mod settings;
pub mod source;
pub mod turned;
