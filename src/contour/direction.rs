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

impl Direction {
    /// Share of the gap that a layer at time `t` is away from the contour that this direction comes from.
    pub fn away(self, t: f64) -> f64 {
        match self {
            Direction::Up => t,
            Direction::Down => 1.0 - t,
        }
    }
}
