//! Connected components of a mask.

use std::ops::Range;

/// Labelled parts of a mask.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Components {
    /// Part of each pixel, numbered from 1 in row order of the first pixel; 0 where the mask is off.
    pub labels: Vec<u32>,
    /// Number of parts.
    pub count: usize,
}

/// Parts joined through edges (the rule for solids).
pub fn label4(mask: &[bool], dims: [usize; 2]) -> Components {
    Parts::of(mask, dims, 0).labelled(mask.len())
}

/// Parts joined through edges and corners (the rule for the background).
pub fn label8(mask: &[bool], dims: [usize; 2]) -> Components {
    Parts::of(mask, dims, 1).labelled(mask.len())
}

/// Number of parts, joined through edges or through `corners` too, of the runs of an image `nx` wide in row order, none of which goes on in the next row.
pub fn count_of_runs(runs: impl Iterator<Item = Range<usize>>, nx: usize, corners: bool) -> usize {
    Parts::joined(runs, nx.max(1), usize::from(corners)).roots().count()
}

/// Number of parts joined through edges and corners.
pub fn count8(mask: &[bool], dims: [usize; 2]) -> usize {
    Parts::of(mask, dims, 1).roots().count()
}

/// Parts, joined through edges or through `corners` too, of the runs of an image `nx` wide in row order, none of which goes on in the next row: for each
/// run the number of the first of its part.
pub fn parts_of_runs(runs: impl Iterator<Item = Range<usize>>, nx: usize, corners: bool) -> Vec<usize> {
    let mut parts = Parts::joined(runs, nx.max(1), usize::from(corners));
    (0..parts.runs.len()).map(|run| parts.root(run)).collect()
}

/// Runs of a mask's pixels along its rows, in row order, and for each the number of one of its part, itself or an earlier one: of a part's first
/// run itself.
struct Parts {
    runs: Vec<(Range<usize>, usize)>,
}

impl Parts {
    /// Finds the runs, and joins those of neighbouring rows that overlap, or would if they were longer by `reach` on either side.
    fn of(mask: &[bool], [nx, _]: [usize; 2], reach: usize) -> Self {
        let rows = mask.chunks_exact(nx.max(1)).enumerate();
        let runs = rows.flat_map(|(j, row)| {
            let mut begin = length(row, 0, false);
            std::iter::from_fn(move || {
                (begin < nx).then(|| {
                    let end = length(row, begin, true);
                    let run = j * nx + begin..j * nx + end;
                    begin = length(row, end, false);
                    run
                })
            })
        });
        Parts::joined(runs, nx, reach)
    }

    /// Joins runs in row order, none of which goes on in the next row.
    fn joined(runs: impl Iterator<Item = Range<usize>>, nx: usize, reach: usize) -> Self {
        let mut parts = Parts { runs: runs.enumerate().map(|(k, run)| (run, k)).collect() };
        let (mut below, mut before, mut first) = (0..0, 0, 0);
        while first < parts.runs.len() {
            let row = parts.runs[first].0.start / nx;
            if row > before + 1 {
                below = 0..0;
            }
            let end = first + parts.runs[first..].iter().take_while(|(run, _)| run.start < (row + 1) * nx).count();
            let mut k = below.start;
            for run in first..end {
                let Range { start, end } = parts.runs[run].0;
                // The row below, as if it lay here.
                while k < below.end && parts.runs[k].0.end + nx + reach <= start {
                    k += 1;
                }
                let mut other = k;
                while other < below.end && parts.runs[other].0.start + nx < end + reach {
                    parts.join(other, run);
                    other += 1;
                }
            }
            (below, before, first) = (first..end, row, end);
        }
        parts
    }

    /// First run of the part of a run.
    fn root(&mut self, mut run: usize) -> usize {
        while self.runs[run].1 != run {
            let next = self.runs[run].1;
            self.runs[run].1 = self.runs[next].1;
            run = next;
        }
        run
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.runs[a.max(b)].1 = a.min(b);
    }

    /// First runs of all parts.
    fn roots(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().enumerate().filter(|(k, (_, part))| k == part).map(|(k, _)| k)
    }

    /// The parts' numbers on `pixels` pixels.
    fn labelled(mut self, pixels: usize) -> Components {
        let mut labels = vec![0; pixels];
        let mut numbers: Vec<u32> = Vec::with_capacity(self.runs.len());
        let mut count = 0;
        for k in 0..self.runs.len() {
            let root = self.root(k);
            let number = if root == k { count + 1 } else { numbers[root] };
            count = count.max(number);
            numbers.push(number);
            labels[self.runs[k].0.clone()].fill(number);
        }
        Components { labels, count: count as usize }
    }
}

/// Pixels that are looked at together.
const LANES: usize = 32;

/// The first pixel from `from` on that is not `value`; the row's length where all are.
fn length(row: &[bool], mut from: usize, value: bool) -> usize {
    while let Some(lanes) = row.get(from..from + LANES) {
        if lanes.iter().fold(false, |other, pixel| other | (*pixel != value)) {
            break;
        }
        from += LANES;
    }
    row[from..].iter().position(|pixel| *pixel != value).map_or(row.len(), |more| from + more)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Parts from pixel to pixel.
    fn from_pixel_to_pixel(mask: &[bool], [nx, ny]: [usize; 2], corners: bool) -> Components {
        let (mut labels, mut count) = (vec![0; mask.len()], 0);
        for start in 0..mask.len() {
            if !mask[start] || labels[start] != 0 {
                continue;
            }
            count += 1;
            labels[start] = count;
            let mut open = vec![start];
            while let Some(n) = open.pop() {
                let (i, j) = (n % nx, n / nx);
                for (x, y) in (0..9).map(|k| (i + k % 3, j + k / 3)) {
                    let inside = x > 0 && y > 0 && x <= nx && y <= ny;
                    let corner = x != i + 1 && y != j + 1;
                    if inside && (corners || !corner) {
                        let other = (y - 1) * nx + x - 1;
                        if mask[other] && labels[other] == 0 {
                            labels[other] = count;
                            open.push(other);
                        }
                    }
                }
            }
        }
        Components { labels, count: count as usize }
    }

    proptest! {
        #[test]
        fn parts_are_those_from_pixel_to_pixel(nx in 1usize..90, ny in 1usize..9, rare in 1u32..40, seed in any::<u64>()) {
            // From noise to long runs.
            let mut state = seed | 1;
            let mut value = false;
            let mask: Vec<bool> = (0..nx * ny)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    value ^= ((state >> 33) as u32).is_multiple_of(rare);
                    value
                })
                .collect();
            prop_assert_eq!(label4(&mask, [nx, ny]), from_pixel_to_pixel(&mask, [nx, ny], false));
            let corners = from_pixel_to_pixel(&mask, [nx, ny], true);
            prop_assert_eq!(count8(&mask, [nx, ny]), corners.count);
            prop_assert_eq!(label8(&mask, [nx, ny]), corners);
        }
    }
}
