//! Directions between neighbouring contours.

/// Which way a morph or sweep goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Direction {
    /// From a contour to the one below.
    Down,
    /// From a contour to the one above.
    #[default]
    Up,
}
