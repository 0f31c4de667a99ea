//! Correspondence of contours: displacements between neighbouring slices, the moving frame of the whole stack, and warping along it.

pub mod cells;
pub mod displacement;
pub mod displacement_row;
pub mod lone_parts;
pub(crate) mod mid_frame;
pub mod motion_field;
pub(crate) mod motion_stack;
pub mod particle_weight;
pub(crate) mod rigid;
pub mod value_curve;
pub(crate) mod warp;
