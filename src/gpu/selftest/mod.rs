//! Every kernel beside its f64 twin, on this machine's driver.

pub mod cases;
pub mod comparison;
pub mod doctor;
mod morph_twins;
mod moving_twins;
pub mod single_kernels;
pub mod twins;
