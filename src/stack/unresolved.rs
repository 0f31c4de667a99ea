//! Parts of a mask that its pixels do not resolve: their outline lies between so few pixels that a mesh loses most of them.
//!
//! Share of the painted volume that meshes of upright parts have, far from each other: a pixel 0.39, two in a row 0.69 and at corners 0.48, three in a row 0.84,
//! in a corner 0.75 and at corners 0.72; four in a square 0.90, six 0.92, nine 0.93. Voxels have all of them on their slices.

use std::ops::Range;

use crate::grid::components::parts_of_runs;

/// Larger parts are resolved, px.
const MOST: usize = 3;
/// Share of the painted pixels from which on such parts are told: of less a mesh lacks less than it lacks of any thin part.
const SHARE: f64 = 0.05;

/// Such parts of slices that are seen one after the other.
#[derive(Debug, Clone, Default)]
pub struct Unresolved {
    parts: usize,
    pixels: usize,
    painted: usize,
    /// First slice with one.
    first: Option<usize>,
}

impl Unresolved {
    /// Looks at a slice, by its place, whose pixels are these runs of rows, `nx` wide.
    pub fn see(&mut self, slice: usize, runs: &[Range<usize>], nx: usize) {
        let mut sizes = vec![0; runs.len()];
        for (run, part) in runs.iter().zip(parts_of_runs(runs.iter().cloned(), nx, true)) {
            sizes[part] += run.len();
        }
        let small = || sizes.iter().filter(|pixels| (1..=MOST).contains(*pixels));
        self.parts += small().count();
        self.pixels += small().sum::<usize>();
        self.painted += sizes.iter().sum::<usize>();
        self.first = self.first.or(small().next().map(|_| slice));
    }

    /// Words about them where they are more than a few beside large ones; `name` tells what a slice is called.
    pub fn told(&self, name: impl Fn(usize) -> String) -> Option<String> {
        let share = self.pixels as f64 / self.painted.max(1) as f64;
        let first = self.first.filter(|_| share > SHARE)?;
        let parts = if self.parts == 1 { "part of a slice has" } else { "parts of slices have" };
        Some(format!(
            "{} {parts} at most {MOST} px, {:.0} % of what is painted (the first on {}): pixels do not resolve them, and a mesh may lose a half of them. \
             A volume has their voxels; pixels a third as long and wide help both",
            self.parts,
            100.0 * share,
            name(first)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::mask::Mask;

    const N: usize = 40;

    fn seen(inside: impl Fn(usize, usize) -> bool) -> Unresolved {
        let mask: Mask = (0..N * N).map(|n| inside(n % N, n / N)).collect();
        let mut seen = Unresolved::default();
        seen.see(0, &[], N);
        seen.see(7, &mask.rows(N).collect::<Vec<_>>(), N);
        seen
    }

    #[test]
    fn parts_of_three_pixels_are_told_where_they_are_much_of_what_is_painted() {
        let told = |seen: &Unresolved| seen.told(|k| format!("`{k}`"));
        let dots = seen(|i, j| i % 5 == 2 && j % 5 == 2);
        assert!(told(&dots).is_some_and(|said| said.starts_with("64 parts of slices have at most 3 px, 100 % ")));
        assert!(told(&dots).is_some_and(|said| said.contains("(the first on `7`)")));
        // Three at corners are one part, four in a row are more.
        let corners = seen(|i, j| i == j && i % 5 < 3);
        assert_eq!((corners.parts, corners.pixels), (8, 24));
        assert_eq!(seen(|i, j| j == 9 && i % 5 < 4).parts, 0);
        // Crumbs beside a body: 10 px of 410, and of 130.
        let crumbs = |side: usize| seen(move |i, j| (i < side && j < 20) || (j == 30 && i % 4 == 0));
        assert_eq!((crumbs(20).parts, crumbs(6).parts), (10, 10));
        assert!(told(&crumbs(20)).is_none() && told(&crumbs(6)).is_some());
        assert!(told(&Unresolved::default()).is_none());
    }
}
