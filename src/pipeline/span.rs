//! Part of a stack that one run makes.

use std::ops::Range;

use crate::pipeline::section::Section;
use crate::registration::motion_field::even_gaps;
use crate::stack::change::Change;
use crate::stack::heights::middle_gap;
use crate::stack::{ContourStack, SliceContent};

/// Least of what a unit of height counts as: where no contour changes, gaps are short beside every width.
const LEAST_RATE: f64 = 1e-9;

/// What contours between pixels that are inside or not may be off by, px, and those of lines and grey values. Mean error of the radius of cones, balls,
/// necks and waves with narrow gaps (7 stacks), px: 0.26 of pixels, for 0.31 without a doubt, and 0.21 of polygons.
const DOUBT_OF_PIXELS: f64 = 0.35;
const DOUBT_OF_LINES: f64 = 0.05;

/// A section, its intervals and slices numbered as in the run, and what it must know of the whole stack.
pub struct Span {
    /// Intervals whose layers are kept.
    pub kept: Range<usize>,
    /// Intervals whose layers are computed.
    pub layers: Range<usize>,
    /// Intervals that are traced.
    pub traced: Range<usize>,
    /// Number of the run's first slice in the stack.
    pub first: usize,
    /// Whether the run's layers begin and end where the stack does.
    pub ends: [bool; 2],
    /// Gaps of the intervals, as the whole stack rounds them.
    pub gaps: Vec<f64>,
    /// The stack's middle gap, see [`middle_gap`].
    pub gap: f64,
    /// What the contours of the whole stack may be off by, px, see [`crate::grid::near_knots`].
    pub doubt: f64,
    /// Changes between the slices of the whole stack.
    pub change: Change,
}

/// See [`Span::doubt`].
fn doubt(stack: &ContourStack) -> f64 {
    let drawn = stack.slices.iter().any(|slice| matches!(slice.content, SliceContent::Mask(_)));
    if drawn { DOUBT_OF_PIXELS } else { DOUBT_OF_LINES }
}

impl Span {
    /// The span of a section of `stack`.
    pub fn new(stack: &ContourStack, section: &Section) -> Self {
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let first = section.slices.start;
        let here = |r: &Range<usize>| r.start - first..r.end - first;
        let intervals = first..section.slices.end - 1;
        Span {
            kept: here(&section.kept),
            layers: here(&section.layers),
            traced: here(&section.traced),
            first,
            ends: [section.layers.start == 0, section.layers.end == z.len() - 1],
            gaps: even_gaps(&z)[intervals].to_vec(),
            gap: middle_gap(&z),
            doubt: doubt(stack),
            change: Change::of(stack),
        }
    }

    /// Gap of interval `i` as a width, for comparisons with widths, unit of the pixel spacing.
    pub fn gap_as_width(&self, i: usize) -> f64 {
        self.change.rate.max(LEAST_RATE) * self.gaps[i]
    }
}
