//! How good a reconstruction is: the hold-out score, and bodies of known shape.

pub mod demo;
pub mod holdout;
