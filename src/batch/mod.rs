//! Many reconstructions, as a manifest lists them: one device, bounded memory, resumed where they were interrupted.

mod agenda;
mod flight;
mod gate;
pub mod index;
pub mod line;
pub mod lock;
pub mod machine;
pub mod manifest;
pub mod pictures;
pub mod results;
pub mod runner;
#[cfg(feature = "gpu")]
pub mod shared_gpu;
mod spread;
pub mod template;

pub use agenda::{Options, Outcome, Watch};
pub use machine::Machine;
pub use manifest::{Job, Manifest};
pub use runner::{finished, run};
