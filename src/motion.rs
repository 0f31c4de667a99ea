//! The frame in which the two contours of an interval are compared and morphed.

/// A map between the pixels of an interval's lower and upper contour. So far contours stay where they are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Frame {
    /// Both contours in the image's own frame.
    #[default]
    Fixed,
}

impl Frame {
    /// Where a position of the lower contour's frame lies on the upper contour.
    pub fn up(self, x: [f64; 2]) -> [f64; 2] {
        match self {
            Frame::Fixed => x,
        }
    }

    /// Where a position of the upper contour's frame lies on the lower contour.
    pub fn down(self, x: [f64; 2]) -> [f64; 2] {
        match self {
            Frame::Fixed => x,
        }
    }
}

/// Frames of all intervals.
pub fn frames(intervals: usize) -> Vec<Frame> {
    vec![Frame::Fixed; intervals]
}
