//! Storage of data: in memory up to a budget, beyond it in temporary files; and how much room there is.

pub mod folders;
pub mod json;
pub mod kinds;
pub mod regular;
pub mod room;
pub mod spill;
pub mod temporaries;
