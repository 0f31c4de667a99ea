//! Many reconstructions, as a manifest lists them: one device, bounded memory, resumed where they were interrupted.

mod flight;
mod gate;
pub mod line;
pub mod lock;
pub mod machine;
pub mod manifest;
pub mod results;
pub mod runner;
pub mod template;

pub use machine::Machine;
pub use manifest::{Job, Manifest};
pub use runner::{Options, Outcome, Watch, finished, run};
