//! Pinholes: holes of a pixel or two in the midst of what is painted, on their slice and on those beside it. Nearer to an outline or to another hole
//! they are the ends of folds, as between two organs that touch.

use std::collections::BTreeMap;
use std::ops::Range;

use super::forgotten::holes;
use super::mask::Mask;
use super::specks::around;

/// Larger holes are none, px.
const MOST: usize = 2;

/// What is painted around them, px.
const MIDST: usize = 3;

/// Such holes of slices that are seen one after the other.
#[derive(Debug, Clone, Default)]
pub struct Pinholes {
    count: usize,
    /// First slice with one, and column and row of its first pixel there.
    first: Option<(usize, [usize; 2])>,
}

impl Pinholes {
    /// Looks at a slice, by its place, between those below and above, on images `nx` wide.
    pub fn see(&mut self, slice: usize, [below, here, above]: [&Mask; 3], nx: usize) {
        let nx = nx.max(1);
        let mut all: BTreeMap<usize, (usize, Vec<Range<usize>>)> = BTreeMap::new();
        for (run, hole) in holes(here, nx) {
            let (pixels, own) = all.entry(hole).or_default();
            *pixels += run.len();
            // Of a larger one nothing is asked.
            if *pixels <= MOST {
                own.push(run);
            }
        }
        let dims = [nx, here.len() / nx];
        for (_, runs) in all.into_values().filter(|(pixels, _)| *pixels <= MOST) {
            let painted = |node: usize| {
                let own = runs.iter().any(|run| run.contains(&node));
                below.at(node) && above.at(node) && (own || here.at(node))
            };
            if runs.iter().flat_map(|run| around(run, dims, MIDST)).all(painted) {
                self.count += 1;
                self.first.get_or_insert((slice, [runs[0].start % nx, runs[0].start / nx]));
            }
        }
    }

    /// Words about them; `name` tells what a slice is called.
    pub fn told(&self, name: impl Fn(usize) -> String) -> Option<String> {
        let (slice, [column, row]) = self.first?;
        let (holes, lie) = if self.count == 1 { ("hole", "lies") } else { ("holes", "lie") };
        Some(format!(
            "{} {holes} of at most {MOST} px {lie} in the midst of what is painted there and on the slices below and above (the first on {} at column \
             {column}, row {row}), each a bubble of its own: left unpainted by mistake?",
            self.count,
            name(slice)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 30;

    /// A square with holes of these pixels.
    fn with(holes: &[[usize; 2]]) -> Mask {
        let inside = |i: usize, j: usize| (5..25).contains(&i) && (5..25).contains(&j) && !holes.contains(&[i, j]);
        (0..N * N).map(|n| inside(n % N, n / N)).collect()
    }

    #[test]
    fn holes_of_a_pixel_or_two_are_told_and_no_others() {
        let count = |slices: [&[[usize; 2]]; 3]| {
            let [below, here, above] = slices.map(with);
            let mut seen = Pinholes::default();
            seen.see(4, [&below, &here, &above], N);
            (seen.count, seen.first)
        };
        assert_eq!(count([&[], &[[9, 12]], &[]]), (1, Some((4, [9, 12]))));
        // Two side by side or at corners are one; three are too many.
        assert_eq!(count([&[], &[[20, 8], [9, 12], [10, 13], [14, 18], [15, 18]], &[]]), (3, Some((4, [20, 8]))));
        assert_eq!(count([&[], &[[9, 12], [10, 12], [11, 12]], &[]]).0, 0);
        // A notch is none, nor what opens at a corner of the outline, nor what goes on in a slice beside.
        assert_eq!(count([&[], &[[5, 12], [24, 24]], &[]]).0, 0);
        assert_eq!(count([&[[10, 11]], &[[9, 12]], &[]]).0 + count([&[], &[[9, 12]], &[[9, 12]]]).0, 0);
        // Near an outline or another hole, here or on a slice beside, they are folds' ends.
        assert_eq!(count([&[], &[[7, 12], [14, 22]], &[]]).0, 0);
        assert_eq!(count([&[], &[[9, 12], [12, 12]], &[]]).0 + count([&[[12, 12]], &[[9, 12]], &[]]).0, 0);
        assert_eq!(count([&[[13, 12]], &[[9, 12], [13, 15]], &[]]).0, 1);
        assert!(Pinholes::default().told(|_| String::new()).is_none());
    }
}
