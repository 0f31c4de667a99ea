//! Parts and holes that a slice has not, though both of its neighbours have them at the same place.

use std::collections::BTreeMap;
use std::ops::Range;

use super::mask::Mask;
use crate::grid::components::parts_of_runs;

/// Smaller parts and holes are specks, px.
const LEAST: usize = 16;

/// A part or hole that a slice has not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Forgotten {
    /// Pixels that both neighbours have.
    pub pixels: usize,
    /// Column and row in the middle of the longest run of them.
    pub at: [usize; 2],
}

/// The largest part of what the slices below and above have in common of which the slice between has no pixel, on images `nx` wide.
pub fn forgotten_part([below, here, above]: [&Mask; 3], nx: usize) -> Option<Forgotten> {
    largest_unseen([below.rows(nx), above.rows(nx)], here.runs(), nx)
}

/// The largest part of what holes of the slices below and above have in common of which the slice between has no pixel outside.
pub fn forgotten_hole([below, here, above]: [&Mask; 3], nx: usize) -> Option<Forgotten> {
    let runs = |mask| holes(mask, nx).map(|(run, _)| run);
    largest_unseen([below, above].map(runs), here.rows_outside(nx), nx)
}

/// Pixels outside that the mask encloses, run by run, each with the number of its hole.
pub(super) fn holes(mask: &Mask, nx: usize) -> impl Iterator<Item = (Range<usize>, usize)> {
    let nx = nx.max(1);
    let runs: Vec<Range<usize>> = mask.rows_outside(nx).collect();
    let parts = parts_of_runs(runs.iter().cloned(), nx, true);
    let mut open = vec![false; runs.len()];
    for (run, part) in runs.iter().zip(&parts) {
        let at_side = run.start % nx == 0 || run.end % nx == 0;
        open[*part] |= at_side || run.start < nx || run.end + nx > mask.len();
    }
    runs.into_iter().zip(parts).filter(move |(_, part)| !open[*part])
}

/// The largest part of what the runs of two slices have in common of which the runs `here` have no pixel.
fn largest_unseen(
    [below, above]: [impl Iterator<Item = Range<usize>>; 2],
    here: impl Iterator<Item = Range<usize>>,
    nx: usize,
) -> Option<Forgotten> {
    let nx = nx.max(1);
    let common: Vec<Range<usize>> = common(below, above).collect();
    let mut own = here.peekable();
    let seen = |run: &Range<usize>| {
        while own.next_if(|other| other.end <= run.start).is_some() {}
        own.peek().is_some_and(|other| other.start < run.end)
    };
    let seen: Vec<bool> = common.iter().map(seen).collect();
    // Pixels of each part that is nowhere seen, and its longest run.
    let mut parts: BTreeMap<usize, Option<(usize, Range<usize>)>> = BTreeMap::new();
    for ((run, part), seen) in common.iter().zip(parts_of_runs(common.iter().cloned(), nx, true)).zip(seen) {
        let known = parts.entry(part).or_insert(Some((0, 0..0)));
        *known = known.take().filter(|_| !seen).map(|(pixels, longest)| {
            let longest = if run.len() > longest.len() { run.clone() } else { longest };
            (pixels + run.len(), longest)
        });
    }
    let largest = parts.into_values().flatten().max_by_key(|(pixels, _)| *pixels);
    let (pixels, longest) = largest.filter(|(pixels, _)| *pixels >= LEAST)?;
    let middle = (longest.start + longest.end) / 2;
    Some(Forgotten { pixels, at: [middle % nx, middle / nx] })
}

/// What two rows of runs have in common.
fn common(
    a: impl Iterator<Item = Range<usize>>,
    b: impl Iterator<Item = Range<usize>>,
) -> impl Iterator<Item = Range<usize>> {
    let (mut a, mut b) = (a.peekable(), b.peekable());
    let step = move || {
        let (first, second) = (a.peek()?.clone(), b.peek()?.clone());
        // The one that ends first meets nothing else of the other.
        let _ = if first.end <= second.end { a.next() } else { b.next() };
        Some(first.start.max(second.start)..first.end.min(second.end))
    };
    std::iter::from_fn(step).filter(|run| run.start < run.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    fn mask(inside: impl Fn(usize, usize) -> bool) -> Mask {
        (0..N * N).map(|n| inside(n % N, n / N)).collect()
    }

    fn block(i: usize, j: usize, [left, top, side]: [usize; 3]) -> bool {
        (left..left + side).contains(&i) && (top..top + side).contains(&j)
    }

    #[test]
    fn a_part_that_one_slice_has_not_is_found_and_no_other() {
        let both = mask(|i, j| block(i, j, [3, 4, 6]) || block(i, j, [20, 10, 12]));
        let moved = mask(|i, j| block(i, j, [4, 5, 6]) || block(i, j, [21, 12, 12]));
        let one = mask(|i, j| block(i, j, [20, 10, 12]));
        let found = forgotten_part([&both, &one, &moved], N);
        assert_eq!(found, Some(Forgotten { pixels: 25, at: [6, 5] }));
        assert_eq!(forgotten_part([&both, &moved, &both], N), None);
        // A cavity is no part, nor is what only touches what the slice has.
        let hollow = mask(|i, j| block(i, j, [3, 4, 6]) || block(i, j, [20, 10, 12]) && !block(i, j, [22, 12, 8]));
        assert_eq!(forgotten_part([&both, &hollow, &both], N), None);
        // Specks are let be; without a slice between all of the largest is missing.
        let specks = mask(|i, j| block(i, j, [30, 30, 3]));
        assert_eq!(forgotten_part([&specks, &one, &specks], N), None);
        assert_eq!(forgotten_part([&both, &mask(|_, _| false), &both], N).map(|f| f.pixels), Some(144));
    }

    #[test]
    fn a_hole_that_one_slice_has_not_is_found_and_no_other() {
        let with = |holes: &[[usize; 3]]| {
            let holes = holes.to_vec();
            mask(move |i, j| block(i, j, [4, 4, 30]) && !holes.iter().any(|hole| block(i, j, *hole)))
        };
        let (two, moved) = (with(&[[8, 8, 6], [20, 20, 10]]), with(&[[9, 9, 6], [21, 20, 10]]));
        let one = with(&[[20, 20, 10]]);
        assert_eq!(forgotten_hole([&two, &one, &moved], N), Some(Forgotten { pixels: 25, at: [11, 9] }));
        assert_eq!(forgotten_hole([&two, &moved, &two], N), None);
        assert_eq!(forgotten_hole([&two, &with(&[]), &moved], N).map(|f| f.pixels), Some(90), "the larger of two");
        // Part of a hole is enough; a bay, the outside and specks are no holes.
        assert_eq!(forgotten_hole([&two, &with(&[[10, 10, 2], [20, 20, 2]]), &moved], N), None);
        let bay = with(&[[4, 8, 6]]);
        assert_eq!(forgotten_hole([&bay, &with(&[]), &bay], N), None);
        let all = mask(|_, _| true);
        assert_eq!(forgotten_hole([&with(&[]), &all, &with(&[])], N), None);
        let speck = with(&[[8, 8, 3]]);
        assert_eq!(forgotten_hole([&speck, &all, &speck], N), None);
        // What only touches the last row or column is open, too.
        for open in [[37, 20, 3], [20, 37, 3], [0, 20, 4], [20, 0, 4]] {
            let notch = mask(|i, j| !block(i, j, open) && !block(i, j, [10, 10, 5]));
            assert_eq!(forgotten_hole([&notch, &all, &notch], N).map(|f| f.pixels), Some(25), "{open:?}");
        }
    }

    #[test]
    fn what_is_common_is_what_pixel_by_pixel_is() {
        for seed in 0..60u32 {
            let noise = |salt: u32| {
                let hash = move |n: usize| (n as u32 / (1 + seed % 5)).wrapping_mul(2654435761 ^ salt) >> 16;
                mask(|i, j| hash(j * N + i + seed as usize) % 7 < 5)
            };
            let (a, b) = (noise(17), noise(4242));
            let expected: Vec<usize> = (0..N * N).filter(|&n| a.at(n) && b.at(n)).collect();
            let runs: Vec<Range<usize>> = common(a.rows(N), b.rows(N)).collect();
            assert!(runs.iter().all(|run| run.start / N == (run.end - 1) / N), "no run goes on in the next row");
            assert_eq!(runs.into_iter().flatten().collect::<Vec<_>>(), expected);
        }
    }
}
