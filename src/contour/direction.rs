//! Directions between neighbouring contours.

/// Direction of a morph or sweep.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Direction {
    /// Downwards: from a contour to the one below.
    Down,
    /// Upwards: from a contour to the one above.
    #[default]
    Up,
}
