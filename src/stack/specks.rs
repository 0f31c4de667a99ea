//! Specks: parts of a few pixels that touch nothing of the slices beside theirs.

use std::collections::BTreeMap;
use std::ops::Range;

use super::mask::Mask;
use crate::grid::components::parts_of_runs;

/// Larger parts are none, px.
const MOST: usize = 3;
/// Nor are those with more than this share of their slice's pixels: a thin body is all of it.
const SHARE: f64 = 0.01;

/// Such a part of a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Speck {
    /// Its pixels.
    pub pixels: usize,
    /// Column and row of its first one.
    pub at: [usize; 2],
}

/// The pixels of a run of a row and those up to `reach` px around it, on images of `dims` pixels.
pub(super) fn around(run: &Range<usize>, [nx, ny]: [usize; 2], reach: usize) -> impl Iterator<Item = usize> {
    let (columns, row) = (run.start % nx..run.start % nx + run.len(), run.start / nx);
    let columns = columns.start.saturating_sub(reach)..(columns.end + reach).min(nx);
    let rows = row.saturating_sub(reach)..(row + reach + 1).min(ny);
    rows.flat_map(move |row| columns.clone().map(move |column| row * nx + column))
}

/// The specks of a slice of which those `beside` it are known, on images `nx` wide.
pub fn specks(here: &Mask, beside: &[&Mask], nx: usize) -> Vec<Speck> {
    let nx = nx.max(1);
    let least = here.count() as f64 * SHARE;
    if least < 1.0 {
        return Vec::new();
    }
    let runs: Vec<Range<usize>> = here.rows(nx).collect();
    let mut parts: BTreeMap<usize, (usize, Vec<Range<usize>>)> = BTreeMap::new();
    for (run, part) in runs.iter().zip(parts_of_runs(runs.iter().cloned(), nx, true)) {
        let (pixels, own) = parts.entry(part).or_default();
        *pixels += run.len();
        // Of a larger one nothing is asked.
        if *pixels <= MOST {
            own.push(run.clone());
        }
    }
    let dims = [nx, here.len() / nx];
    let touches = |run: &Range<usize>| around(run, dims, 1).any(|node| beside.iter().any(|mask| mask.at(node)));
    let small = parts.into_values().filter(|(pixels, _)| *pixels <= MOST && *pixels as f64 <= least);
    let alone = small.filter(|(_, runs)| !runs.iter().any(touches));
    alone.map(|(pixels, runs)| Speck { pixels, at: [runs[0].start % nx, runs[0].start / nx] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    fn mask(inside: impl Fn(usize, usize) -> bool) -> Mask {
        (0..N * N).map(|n| inside(n % N, n / N)).collect()
    }

    #[test]
    fn a_few_pixels_by_themselves_are_a_speck() {
        let body = |i: usize, j: usize| (10..30).contains(&i) && (10..30).contains(&j);
        let plain = mask(body);
        // One pixel, three in a corner, and four in a row.
        let speckled = mask(|i, j| {
            body(i, j) || [[3, 5], [39, 39], [38, 39], [39, 38]].contains(&[i, j]) || (j == 35 && (20..24).contains(&i))
        });
        let found = [Speck { pixels: 1, at: [3, 5] }, Speck { pixels: 3, at: [39, 38] }];
        assert_eq!(specks(&speckled, &[&plain], N), found);
        assert_eq!(specks(&speckled, &[&plain, &mask(|i, j| [i, j] == [38, 37])], N), found[..1], "it is near one");
        assert_eq!(specks(&plain, &[&speckled], N), []);
        // Of a thin body nothing is a speck.
        assert_eq!(specks(&mask(|i, j| j == 9 && i % 3 == 0), &[&plain], N), []);
    }
}
