//! Values on pixels: dense fields, tiled fields, rectangles of an image, connected components, and the scalar arithmetic on them.

pub mod components;
pub mod field;
pub mod near_knots;
pub mod seen;
pub mod sparse_image;
pub mod spline;
pub mod stencil;
pub mod tile;
pub mod union;
