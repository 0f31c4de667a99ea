//! Slices of a volume that stand alone across an axis: painted planes with nothing painted beside them.

use crate::stack::axis::NAMES;

/// Fewest voxels of such a plane that have neighbours along both of its own axes: less is a line or a speck.
const LEAST: u64 = 16;
/// Share of the paint that must lie in planes before it is taken for planes in several directions, and not for a body with thin walls.
const ALL: f64 = 0.95;
/// Slices that a message names.
const NAMED: usize = 12;

/// Painted voxels by slices of each axis.
#[derive(Debug, Clone, Default)]
pub struct Sheets {
    /// Voxels of each slice,
    painted: [Vec<u64>; 3],
    /// and those of them with nothing painted on either side along the axis, and something along both others.
    alone: [Vec<u64>; 3],
}

impl Sheets {
    /// Slices across `axis` that stand alone: more than half of their voxels do.
    pub fn across(&self, axis: usize) -> Vec<usize> {
        let slices = self.alone[axis].iter().zip(&self.painted[axis]).enumerate();
        slices.filter(|(_, (alone, painted))| **alone >= LEAST && 2 * **alone > **painted).map(|(k, _)| k).collect()
    }

    /// Message where all paint lies in planes across several axes.
    pub fn crossing(&self) -> Option<String> {
        let across: [Vec<usize>; 3] = std::array::from_fn(|axis| self.across(axis));
        let axes: Vec<usize> = (0..3).filter(|axis| !across[*axis].is_empty()).collect();
        let all: u64 = self.painted[0].iter().sum();
        let within = |a: usize| across[a].iter().map(|&k| self.painted[a][k]).sum::<u64>();
        let together: u64 = axes.iter().map(|&a| within(a)).sum();
        // Where one axis' planes hold all there is, a thin part of theirs is no plane.
        let is_one = axes.iter().any(|&a| within(a) == all);
        if axes.len() < 2 || is_one || (together as f64) < ALL * all as f64 {
            return None;
        }
        let listed = |axis: usize| {
            let named: Vec<String> = across[axis].iter().take(NAMED).map(usize::to_string).collect();
            let more = if across[axis].len() > NAMED { ", .." } else { "" };
            format!("{}{more}", named.join(","))
        };
        let planes: Vec<String> = axes.iter().map(|&a| format!("across {} on {}", NAMES[a], listed(a))).collect();
        let &best = axes.iter().max_by_key(|&&a| (across[a].len(), a))?;
        Some(format!(
            "is painted on slices in several directions: {}; slices must be parallel: take some with `--axis {} --slices {}` or erase \
             the others (`--keep 1` takes the volume as painted throughout)",
            planes.join(", "),
            NAMES[best],
            listed(best)
        ))
    }
}

/// Counts while a volume is read in the order of its file, with three of its slabs in memory, a bit a voxel.
#[derive(Debug)]
pub(crate) struct Counting {
    /// The axes as the file runs through them.
    stored: [usize; 3],
    /// Voxels of a row, and rows of a slab.
    dims: [usize; 2],
    /// The slab that is read, and what is painted on it and the two before.
    at: usize,
    slabs: [Vec<u64>; 3],
    /// Painted stretches of the slab that is read and the one before: first voxel and number.
    stretches: [Vec<(usize, usize)>; 2],
    sheets: Sheets,
}

impl Counting {
    /// Nothing yet of a volume with `dims` voxels, which its file stores in the order `stored`.
    pub fn new(dims: [usize; 3], stored: [usize; 3]) -> Self {
        let counts = || dims.map(|n| vec![0; n]);
        let of_slab = [dims[stored[0]], dims[stored[1]]];
        let words = (of_slab[0] * of_slab[1]).div_ceil(64);
        Counting {
            stored,
            dims: of_slab,
            at: 0,
            slabs: std::array::from_fn(|_| vec![0; words]),
            stretches: Default::default(),
            sheets: Sheets { painted: counts(), alone: counts() },
        }
    }

    /// Notes `count` painted voxels of a row that begin at `first`.
    pub fn paint(&mut self, first: [usize; 3], count: usize) {
        let [i, j, k] = self.stored.map(|axis| first[axis]);
        while self.at < k {
            self.next();
        }
        let start = j * self.dims[0] + i;
        (start..start + count).for_each(|n| self.slabs[2][n / 64] |= 1 << (n % 64));
        self.stretches[1].push((start, count));
    }

    /// All that was counted.
    pub fn finish(mut self) -> Sheets {
        self.next();
        self.next();
        self.sheets
    }

    /// Counts the slab before the one that was read, and goes on.
    fn next(&mut self) {
        let [row, rows] = self.dims;
        let is = |slab: usize, n: usize| self.slabs[slab][n / 64] >> (n % 64) & 1 == 1;
        for &(start, count) in &self.stretches[0] {
            for n in start..start + count {
                let (i, j) = (n % row, n / row);
                let beside = [
                    (i > 0 && is(1, n - 1)) || (i + 1 < row && is(1, n + 1)),
                    (j > 0 && is(1, n - row)) || (j + 1 < rows && is(1, n + row)),
                    is(0, n) || is(2, n),
                ];
                let alone = beside.iter().filter(|b| !**b).count() == 1;
                for ((axis, at), beside) in self.stored.into_iter().zip([i, j, self.at - 1]).zip(beside) {
                    self.sheets.painted[axis][at] += 1;
                    self.sheets.alone[axis][at] += u64::from(alone && !beside);
                }
            }
        }
        self.stretches.rotate_left(1);
        self.slabs.rotate_left(1);
        self.slabs[2].fill(0);
        self.stretches[1].clear();
        self.at += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIMS: [usize; 3] = [60, 40, 9];

    fn sheets(painted: impl Fn(usize, usize, usize) -> bool) -> Sheets {
        let mut counting = Counting::new(DIMS, [0, 1, 2]);
        for k in 0..DIMS[2] {
            for j in 0..DIMS[1] {
                (0..DIMS[0]).filter(|&i| painted(i, j, k)).for_each(|i| counting.paint([i, j, k], 1));
            }
        }
        counting.finish()
    }

    fn disc(i: usize, j: usize, at: usize) -> bool {
        i.abs_diff(at).pow(2) + j.abs_diff(20).pow(2) < 64
    }

    #[test]
    fn a_thin_part_of_slices_is_no_plane_across_them() {
        // Discs that go far from slice to slice, and a line that stays.
        let thin =
            |i: usize, j: usize, k: usize| k < 3 && (disc(i, j, 8 + 17 * k) || (i == 58 && (10..30).contains(&j)));
        let found = sheets(thin);
        assert!(found.across(0) == [58] && found.across(2) == [0, 1, 2], "{found:?}");
        assert_eq!(found.crossing(), None);
    }

    #[test]
    fn planes_across_two_axes_cross() {
        let found = sheets(|i, j, k| disc(i, j, 30) && (k % 4 == 0 || i == 30));
        let message = found.crossing().expect("they cross");
        assert!(message.contains("across x on 30, across z on 0,4,8"), "{message}");
    }
    #[test]
    fn every_voxel_is_counted_with_those_beside_it() {
        let dims = [70, 13, 5];
        let painted = |[i, j, k]: [usize; 3]| (i * 7 + j * 11 + k * 5 + i * j * (k + 3)) % 5 < 3;
        for stored in [[0, 1, 2], [2, 0, 1], [1, 2, 0]] {
            let mut counting = Counting::new(dims, stored);
            let mut wanted = Counting::new(dims, stored).sheets;
            let n = stored.map(|axis| dims[axis]);
            for (c, b, a) in (0..n[2]).flat_map(|c| (0..n[1]).flat_map(move |b| (0..n[0]).map(move |a| (c, b, a)))) {
                let mut at = [0; 3];
                [a, b, c].into_iter().zip(stored).for_each(|(place, axis)| at[axis] = place);
                if !painted(at) {
                    continue;
                }
                counting.paint(at, 1);
                let beside = |axis: usize| {
                    let (mut low, mut high) = (at, at);
                    low[axis] = at[axis].wrapping_sub(1);
                    high[axis] += 1;
                    (at[axis] > 0 && painted(low)) || (high[axis] < dims[axis] && painted(high))
                };
                let lonely: Vec<usize> = (0..3).filter(|axis| !beside(*axis)).collect();
                (0..3).for_each(|axis| wanted.painted[axis][at[axis]] += 1);
                if let [axis] = lonely[..] {
                    wanted.alone[axis][at[axis]] += 1;
                }
            }
            let found = counting.finish();
            assert_eq!((found.painted, found.alone), (wanted.painted, wanted.alone), "{stored:?}");
        }
    }
}
