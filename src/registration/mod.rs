//! Correspondence of contours: displacements between neighbouring slices, the moving frame of the whole stack, and warping along it.

pub mod displacement;
pub(crate) mod mid_frame;
pub mod motion_field;
pub(crate) mod motion_stack;
pub mod particle_weight;
pub(crate) mod rigid;
pub(crate) mod warp;
