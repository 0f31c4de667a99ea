//! Part of a stack that one run makes.

use std::ops::Range;

use crate::pipeline::section::Section;
use crate::registration::motion_field::even_gaps;
use crate::stack::ContourStack;
use crate::stack::change::Change;
use crate::stack::heights::median;

/// Least of what a unit of height counts as: where no contour changes, gaps are short beside every width.
const LEAST_RATE: f64 = 1e-9;

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
    /// Median gap of the whole stack.
    pub gap: f64,
    /// Changes between the slices of the whole stack.
    pub change: Change,
}

impl Span {
    /// The span of a section of `stack`.
    pub fn new(stack: &ContourStack, section: &Section) -> Self {
        let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
        let first = section.slices.start;
        let here = |r: &Range<usize>| r.start - first..r.end - first;
        let gaps = || z.windows(2).map(|w| w[1] - w[0]);
        let intervals = first..section.slices.end - 1;
        Span {
            kept: here(&section.kept),
            layers: here(&section.layers),
            traced: here(&section.traced),
            first,
            ends: [section.layers.start == 0, section.layers.end == z.len() - 1],
            gaps: even_gaps(&z)[intervals].to_vec(),
            gap: median(gaps().collect()),
            change: Change::of(stack),
        }
    }

    /// Gap of interval `i` as a width, for comparisons with widths, unit of the pixel spacing.
    pub fn gap_as_width(&self, i: usize) -> f64 {
        self.change.rate.max(LEAST_RATE) * self.gaps[i]
    }
}
