//! Cost of a reconstruction, estimated from the stack before it starts.

pub(crate) mod coverage;
pub mod memory;
pub mod runtime;
