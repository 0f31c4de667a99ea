//! Nearness of pixels of a layer to its surface, by the v that is averaged.

use std::ops::Range;

use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::grid::spline::smoothstep;

/// Pixels with a smaller |v| / B are wholly near the surface, those with a larger than SATURATED not at all.
const NEAR: f32 = 0.4;
pub const SATURATED: f32 = 0.85;
/// At a contour the difference fades out between these: layers beside it read it there, near their own surface.
const FADE: [f32; 2] = [0.82, 0.88];

/// Pixels that are passed over at once.
const RUN: usize = 16;

/// Nearness to the surface of a pixel at `|v| / B`, 1 to 0.
#[inline(always)]
pub fn nearness(ratio: f32) -> f64 {
    smoothstep(f64::from((SATURATED - ratio) / (SATURATED - NEAR)))
}

/// Share of a contour's difference that counts at a pixel at `|v| / B`, 1 to 0.
pub fn fade(ratio: f32) -> f64 {
    smoothstep(f64::from((FADE[1] - ratio) / (FADE[1] - FADE[0])))
}

/// The largest `|v| / B` at which the difference of a layer is known, of one at a contour or of another.
pub fn widest(at_contour: bool) -> f32 {
    if at_contour { FADE[1] } else { SATURATED }
}

/// The stretches of a row of v that are nearer the surface than `far`.
pub fn nearer(v: &[f32], far: f32) -> impl Iterator<Item = Range<usize>> {
    let mut at = 0;
    let is = move |v: &f32| v.abs() < far;
    std::iter::from_fn(move || {
        // Most of a row is far: whole runs at a time.
        let some = v[at..].chunks(RUN).take_while(|run| !run.iter().fold(false, |any, v| any | is(v)));
        at += some.map(<[f32]>::len).sum::<usize>();
        let begin = at + v[at..].iter().position(is)?;
        at = v[begin..].iter().position(|v| !is(v)).map_or(v.len(), |count| begin + count);
        Some(begin..at)
    })
}

/// Where a layer of v may be near its surface: for each row of squares the stretches of columns whose squares are not far as a whole.
#[derive(Debug, Clone, Default)]
pub struct NearSquares {
    stretches: Vec<Vec<Range<usize>>>,
}

impl NearSquares {
    /// Those of `v` with values nearer than `far`.
    pub fn new(v: &SparseImage<f32>, far: f32) -> Self {
        let (nx, [columns, rows]) = (v.dims()[0], v.squares());
        let of = |row: usize| {
            let mut stretches: Vec<Range<usize>> = Vec::new();
            for column in (0..columns).filter(|&c| v.whole([c, row]).is_none_or(|v| v.abs() < far)) {
                let pixels = column * SQUARE..((column + 1) * SQUARE).min(nx);
                match stretches.last_mut().filter(|last| last.end == pixels.start) {
                    Some(last) => last.end = pixels.end,
                    None => stretches.push(pixels),
                }
            }
            stretches
        };
        NearSquares { stretches: (0..rows).map(of).collect() }
    }

    /// Whether the square in that column and row of squares is far as a whole.
    pub fn is_far(&self, [column, row]: [usize; 2]) -> bool {
        let stretches = &self.stretches[row];
        let next = stretches.partition_point(|stretch| stretch.end <= column * SQUARE);
        stretches.get(next).is_none_or(|stretch| stretch.start > column * SQUARE)
    }

    /// Reads row `j` of `v` where it may be near, into its places of `row`, and gives the stretches of pixels nearer than `far`, by the same `far` as
    /// [`NearSquares::new`] had or a smaller one.
    pub fn of_row(&self, v: &SparseImage<f32>, j: usize, far: f32, row: &mut [f32]) -> Vec<Range<usize>> {
        let mut near = Vec::new();
        for stretch in &self.stretches[j / SQUARE] {
            v.read(stretch.start, j, &mut row[stretch.clone()]);
            let found = nearer(&row[stretch.clone()], far);
            near.extend(found.map(|pixels| pixels.start + stretch.start..pixels.end + stretch.start));
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_those_of_the_pixels_that_are_near() {
        for seed in 0..50u32 {
            let length = seed as usize * 5;
            // Now and then a stretch, some at either end.
            let value =
                |k: usize| if (k as u32 / (1 + seed % 7)).wrapping_mul(2654435761) >> 29 < 2 { 0.1 } else { -0.9 };
            let v: Vec<f32> = (0..length).map(value).collect();
            let found: Vec<Range<usize>> = nearer(&v, 0.5).collect();
            let near: Vec<usize> = found.iter().cloned().flatten().collect();
            assert_eq!(near, (0..length).filter(|&k| v[k].abs() < 0.5).collect::<Vec<_>>());
            assert!(found.windows(2).all(|pair| pair[0].end < pair[1].start), "whole stretches: {found:?}");
        }
    }
}
