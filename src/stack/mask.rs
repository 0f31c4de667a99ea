//! Mask of a slice: which pixels are inside, kept as runs: memory follows the contour, not the image.

use std::iter::repeat_n;
use std::ops::Range;

/// A mask, row-major: pixels from the first change to before the second are inside, and so on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Mask {
    len: usize,
    /// Pixels at which the side changes, increasing; before the first is outside.
    changes: Vec<usize>,
}

impl Mask {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it has no pixels at all.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether no pixel is inside.
    pub fn is_blank(&self) -> bool {
        self.changes.is_empty()
    }

    /// Number of pixels inside.
    pub fn count(&self) -> usize {
        self.runs().map(|run| run.len()).sum()
    }

    /// Pixels inside, run by run: one may go on in the next row.
    pub fn runs(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let ends = self.changes.iter().skip(1).step_by(2).copied().chain([self.len]);
        self.changes.iter().step_by(2).zip(ends).map(|(start, end)| *start..end)
    }

    /// Whether pixel `node` is inside; what lies beyond the last pixel is not.
    pub fn at(&self, node: usize) -> bool {
        node < self.len && self.side(node)
    }

    /// Pixels inside of an image `nx` wide, run by run within rows.
    pub fn rows(&self, nx: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        within_rows(self.runs(), nx)
    }

    /// Pixels outside of an image `nx` wide, run by run within rows.
    pub fn rows_outside(&self, nx: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let starts = [0].into_iter().chain(self.changes.iter().skip(1).step_by(2).copied());
        let ends = self.changes.iter().step_by(2).copied().chain([self.len]);
        within_rows(starts.zip(ends).map(|(start, end)| start..end).filter(|run| !run.is_empty()), nx)
    }

    /// Sides between a pixel inside and one outside of an image `nx` wide.
    pub fn inner_sides(&self, nx: usize) -> usize {
        let nx = nx.max(1);
        let upright = self.changes.iter().filter(|change| *change % nx != 0).count();
        // The pixels that differ from those a row before lie between every second of both rows' changes.
        let mut both: Vec<usize> = self.changes.iter().flat_map(|change| [*change, change + nx]).collect();
        both.sort_unstable();
        let level =
            |pair: &[usize]| pair.get(1).map_or(self.len, |end| self.len.min(*end)).saturating_sub(pair[0].max(nx));
        upright + both.chunks(2).map(level).sum::<usize>()
    }

    /// The pixels in order.
    pub fn iter(&self) -> impl Iterator<Item = bool> + '_ {
        let ends = self.changes.iter().copied().chain([self.len]);
        let starts = [0].into_iter().chain(self.changes.iter().copied());
        starts.zip(ends).enumerate().flat_map(|(k, (start, end))| repeat_n(k % 2 == 1, end - start))
    }

    /// The pixels from `first` on.
    pub fn read(&self, first: usize, out: &mut [bool]) {
        let next = self.changes.partition_point(|&c| c <= first);
        let (mut at, mut inside) = (0, next % 2 == 1);
        for change in &self.changes[next..] {
            let end = (change - first).min(out.len());
            out[at..end].fill(inside);
            if end == out.len() {
                return;
            }
            (at, inside) = (end, !inside);
        }
        out[at..].fill(inside);
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.changes)
    }

    fn side(&self, node: usize) -> bool {
        self.changes.partition_point(|&c| c <= node) % 2 == 1
    }
}

/// Runs, cut at the ends of rows.
fn within_rows(runs: impl Iterator<Item = Range<usize>>, nx: usize) -> impl Iterator<Item = Range<usize>> {
    let nx = nx.max(1);
    runs.flat_map(move |run| {
        let rows = run.start / nx..run.end.div_ceil(nx);
        rows.map(move |row| run.start.max(row * nx)..run.end.min((row + 1) * nx))
    })
}

impl FromIterator<bool> for Mask {
    fn from_iter<I: IntoIterator<Item = bool>>(pixels: I) -> Self {
        let mut mask = Mask::default();
        let mut inside = false;
        for pixel in pixels {
            if pixel != inside {
                mask.changes.push(mask.len);
                inside = pixel;
            }
            mask.len += 1;
        }
        mask.changes.shrink_to_fit();
        mask
    }
}

/// A mask while it is drawn, a bit per pixel.
#[derive(Debug, Clone)]
pub(crate) struct MaskBits {
    len: usize,
    words: Vec<u64>,
}

impl MaskBits {
    /// All outside.
    pub fn new(len: usize) -> Self {
        MaskBits { len, words: vec![0; len.div_ceil(64)] }
    }

    /// Puts a pixel on a side.
    pub fn set(&mut self, node: usize, inside: bool) {
        let (word, bit) = (&mut self.words[node / 64], 1 << (node % 64));
        *word = if inside { *word | bit } else { *word & !bit };
    }

    /// The mask that was drawn.
    pub fn finish(self) -> Mask {
        (0..self.len).map(|n| self.words[n / 64] >> (n % 64) & 1 == 1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_gives_back_the_pixels_it_was_made_of() {
        for k in 0..200u32 {
            let pixels: Vec<bool> = (0..130u32).map(|n| (n * n / 7 + k) % (2 + k % 9) == 0 && k != 7).collect();
            let mut drawing = MaskBits::new(pixels.len());
            pixels.iter().enumerate().for_each(|(n, inside)| drawing.set(n, *inside));
            let mask: Mask = pixels.iter().copied().collect();
            assert_eq!(drawing.finish(), mask);
            assert!(mask.iter().eq(pixels.iter().copied()));
            assert!((0..pixels.len()).all(|n| mask.at(n) == pixels[n]));
            assert_eq!(mask.is_blank(), !pixels.contains(&true));
            assert_eq!(mask.count(), pixels.iter().filter(|inside| **inside).count());
            let sides = |apart: usize, row: bool| {
                (apart..130).filter(|n| (row || n % 13 > 0) && pixels[*n] != pixels[n - apart]).count()
            };
            assert_eq!(mask.inner_sides(13), sides(1, false) + sides(13, true));
            for (first, count) in [(0, 130), (1, 64), (77, 53), (129, 1), (40, 0)] {
                let mut out = vec![false; count];
                mask.read(first, &mut out);
                assert_eq!(out, pixels[first..first + count]);
            }
        }
    }
}
