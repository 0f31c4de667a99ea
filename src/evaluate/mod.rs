//! Evaluation of a reconstruction: the hold-out score, and bodies of known shape.

pub mod demo;
pub mod holdout;
