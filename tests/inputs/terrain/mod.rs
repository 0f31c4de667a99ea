//! Contour maps in, height maps and contour lines out: files that this test writes itself.

mod border;
mod elevations;
mod evaluated;
mod formats;
mod height_maps;
mod joining;
mod levels;
mod maps;
mod near_border;
mod systems;
