//! Coverage of slices, counted in pixels, from which memory and time are estimated.

use crate::grid::components::count_of_runs;
use crate::stack::SliceContent;

/// Pixels in which two slices differ.
pub fn differing([a, b]: [&SliceContent; 2], [nx, ny]: [usize; 2]) -> usize {
    let mut rows = [vec![false; nx], vec![false; nx]];
    let differing = |j: usize| {
        a.read(j * nx, &mut rows[0]);
        b.read(j * nx, &mut rows[1]);
        rows[0].iter().zip(&rows[1]).filter(|(a, b)| a != b).count()
    };
    (0..ny).map(differing).sum()
}

/// Parts of a slice, and of what is around them.
pub fn parts(content: &SliceContent, [nx, _]: [usize; 2]) -> usize {
    let mask = content.mask();
    count_of_runs(mask.rows(nx), nx, false) + count_of_runs(mask.rows_outside(nx), nx, true)
}

/// Whether what is around the parts of a slice is in several pieces: holes, or what a part cuts off at the border.
pub fn has_holes(content: &SliceContent, [nx, _]: [usize; 2]) -> bool {
    count_of_runs(content.mask().rows_outside(nx), nx, true) > 1
}

/// Coverage of slices.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// Edges between a pixel inside and one outside.
    pub edges: usize,
    /// Pixels inside.
    pub pixels: usize,
    /// First and last column and row that have a pixel inside.
    low: [usize; 2],
    high: [usize; 2],
}

impl Default for Drawn {
    fn default() -> Self {
        Drawn { edges: 0, pixels: 0, low: [usize::MAX; 2], high: [0; 2] }
    }
}

impl Drawn {
    /// On one slice.
    pub fn of(content: &SliceContent, [nx, _]: [usize; 2]) -> Self {
        let mask = content.mask();
        let all = Drawn { edges: mask.inner_sides(nx), ..Drawn::default() };
        mask.rows(nx).fold(all, |all, run| {
            let (first, row) = (run.start % nx, run.start / nx);
            all.and(&Drawn { edges: 0, pixels: run.len(), low: [first, row], high: [first + run.len() - 1, row] })
        })
    }

    /// Coverage of these slices and of others.
    pub fn and(self, other: &Drawn) -> Self {
        Drawn {
            edges: self.edges + other.edges,
            pixels: self.pixels + other.pixels,
            low: std::array::from_fn(|a| self.low[a].min(other.low[a])),
            high: std::array::from_fn(|a| self.high[a].max(other.high[a])),
        }
    }

    /// Whether anything lies at the border of an image of `dims` pixels.
    pub fn at_border(&self, dims: [usize; 2]) -> bool {
        (0..2).any(|a| self.low[a] == 0 || self.high[a] + 1 == dims[a])
    }

    /// Pixels of the box around it and so many more to each side.
    pub fn box_pixels(&self, around: [usize; 2]) -> f64 {
        (0..2).map(|a| (self.high[a] + 1 + 2 * around[a]).saturating_sub(self.low[a]) as f64).product()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::{label4, label8};

    #[test]
    fn parts_are_those_of_both_sides_pixel_by_pixel() {
        for seed in 0..80usize {
            let (nx, ny) = (1 + seed % 23, 1 + seed % 11);
            let noise = |n: usize| ((n + 31 * seed) as u32).wrapping_mul(2654435761) >> 24 < 40 + 3 * seed as u32;
            let inside: Vec<bool> = (0..nx * ny).map(noise).collect();
            let outside: Vec<bool> = inside.iter().map(|inside| !inside).collect();
            let expected = label4(&inside, [nx, ny]).count + label8(&outside, [nx, ny]).count;
            assert_eq!(
                parts(&SliceContent::Mask(inside.into_iter().collect()), [nx, ny]),
                expected,
                "{nx} x {ny}, {seed}"
            );
        }
    }
}
