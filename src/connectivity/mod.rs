//! Connectivity: pieces of a body over layers, cores of overlaps that must not tear, and pieces that float.

pub(crate) mod bridges;
pub(crate) mod cores;
pub(crate) mod grounded;
pub mod runs;
