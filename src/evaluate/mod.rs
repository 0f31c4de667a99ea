//! Evaluation of a reconstruction: the hold-out score, and bodies of known shape.

mod along;
pub mod demo;
pub mod holdout;
mod view;
