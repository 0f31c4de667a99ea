//! A stack seen through a window: the box around everything that is drawn, wherever in the image it lies.
//!
//! A computation in the window knows nothing of the image around it: a body costs the same and comes out the same in an image of any size and
//! wherever it is shifted to. Bodies that the border cuts go on beyond it for some pixels ([`beyond`]); layers end at the border again.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::grid::tile::{Tile, to_rectangle};

use super::beyond::beyond;
use super::mask::MaskBits;
use super::{ContourStack, LevelSlice, Mask, Slice, SliceContent};

/// A box of pixels on a plane of which the image is a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Its first pixel, counted from the image's.
    pub origin: [isize; 2],
    /// Its pixels.
    pub dims: [usize; 2],
    /// Whether a slice goes on beyond the image.
    pub beyond: bool,
}

impl Window {
    /// The box around what is drawn on any slice, what goes on beyond the border included, and `around` pixels more to every side; the whole image
    /// where nothing is.
    pub fn around(stack: &ContourStack, around: [usize; 2]) -> Self {
        let [nx, ny] = stack.dims;
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        let mut row = vec![false; nx];
        for slice in stack.slices.iter().filter(|slice| !slice.content.is_empty()) {
            for j in 0..ny {
                slice.content.read(j * nx, &mut row);
                let ends = row.iter().position(|inside| *inside).zip(row.iter().rposition(|inside| *inside));
                if let Some((first, last)) = ends {
                    low = [low[0].min(first), low[1].min(j)];
                    high = [high[0].max(last), high[1].max(j)];
                }
            }
        }
        if low[0] > high[0] {
            return Window { origin: [0; 2], dims: stack.dims, beyond: false };
        }
        let at_border = (0..2).any(|a| low[a] == 0 || high[a] == stack.dims[a] - 1);
        let [mut low, mut high] = [low, high].map(|corner| corner.map(|n| n as isize));
        let mut is_beyond = false;
        let more = (0..stack.slices.len()).filter(|_| at_border).flat_map(|k| beyond(stack, k));
        for ([i, j], _) in more.filter(|(_, v)| *v < 0.0) {
            is_beyond = true;
            low = [low[0].min(i), low[1].min(j)];
            high = [high[0].max(i), high[1].max(j)];
        }
        Window {
            origin: [0, 1].map(|a| low[a] - around[a] as isize),
            dims: [0, 1].map(|a| (high[a] - low[a]) as usize + 1 + 2 * around[a]),
            beyond: is_beyond,
        }
    }

    /// Columns of the window that are columns of these pixels of the image, likewise rows.
    pub fn part(&self, pixels: Tile) -> [Range<usize>; 2] {
        [0, 1].map(|a| {
            let first = pixels.origin[a] as isize - self.origin[a];
            let clamped = |n: isize| n.clamp(0, self.dims[a] as isize) as usize;
            let (start, end) = (clamped(first), clamped(first + pixels.dims[a] as isize));
            start..end.max(start)
        })
    }

    /// The same in the window with `pad` pixels around it.
    pub fn padded_part(&self, pixels: Tile, pad: [usize; 2]) -> [Range<usize>; 2] {
        let part = self.part(pixels);
        [0, 1].map(|a| part[a].start + pad[a]..part[a].end + pad[a])
    }

    /// Columns and rows of the whole image, counted from the window's first pixel.
    pub fn rectangle(&self, dims: [usize; 2]) -> [Range<isize>; 2] {
        [0, 1].map(|a| -self.origin[a]..dims[a] as isize - self.origin[a])
    }

    /// Place on the image of pixel `(i, j)` of the window.
    fn place(&self, i: usize, j: usize, dims: [usize; 2]) -> usize {
        let of = |a: usize, n: usize| (n as isize + self.origin[a]) as usize;
        of(1, j) * dims[0] + of(0, i)
    }

    /// These slices of a stack through the window; beyond the image is outside but for what goes on there.
    pub fn of(&self, stack: &ContourStack, slices: Range<usize>) -> ContourStack {
        let slice = |k: usize| {
            let own = &stack.slices[k];
            let more = if self.beyond { self.going_on(stack, k) } else { BTreeMap::new() };
            let content = match &own.content {
                SliceContent::Mask(mask) => SliceContent::Mask(self.with(self.mask(mask, stack.dims), &more)),
                SliceContent::Level(level) => SliceContent::Level(self.level(level, stack.dims, more)),
            };
            Slice { name: own.name.clone(), content, ..*own }
        };
        ContourStack {
            dims: self.dims,
            slices: slices.into_par_iter().map(slice).collect(),
            unit: stack.unit.clone(),
            ..*stack
        }
    }

    /// Values beyond the border where slice `slice` goes on.
    fn going_on(&self, stack: &ContourStack, slice: usize) -> BTreeMap<usize, f32> {
        let mut values = BTreeMap::new();
        for (at, v) in beyond(stack, slice) {
            let [i, j] = [0, 1].map(|a| (at[a] - self.origin[a]) as usize);
            let least: &mut f32 = values.entry(j * self.dims[0] + i).or_insert(v);
            *least = least.min(v);
        }
        values
    }

    /// A mask on the window and the pixels on which it goes on.
    fn with(&self, mask: Mask, more: &BTreeMap<usize, f32>) -> Mask {
        if more.is_empty() {
            return mask;
        }
        let mut pixels = MaskBits::new(mask.len());
        mask.iter().enumerate().filter(|(_, inside)| *inside).for_each(|(n, _)| pixels.set(n, true));
        more.iter().filter(|(_, v)| **v < 0.0).for_each(|(n, _)| pixels.set(*n, true));
        pixels.finish()
    }

    /// Ends a layer on the window at the image's border, half a pixel beyond the outermost pixels: `phi <- max(phi, R)` with the signed distance R
    /// to that rectangle, up to `limit`; only beyond the border where no slice goes on there. No pixel of the image changes its side, and what lies
    /// beyond holds nothing together.
    pub fn end_at_border(&self, phi: &mut SparseImage<f32>, image: [usize; 2], spacing: [f64; 2], limit: f32) {
        let image = self.rectangle(image);
        let edge = |i: usize, j: usize| {
            let r = (to_rectangle(&image, spacing, [i, j]) as f32).min(limit);
            if self.beyond || r > 0.0 { r } else { -limit }
        };
        for square in phi.each_square() {
            let (first, size) = (square.map(|k| k * SQUARE), phi.size_of_square(square));
            let corners = [0, 1].map(|a| [first[a], first[a] + size[a] - 1]);
            let largest = corners[0].into_iter().flat_map(|i| corners[1].map(|j| edge(i, j))).fold(-limit, f32::max);
            if largest <= -limit || phi.whole(square).is_some_and(|v| v >= largest) {
                continue;
            }
            let values = phi.square_mut(square);
            for (n, v) in values.iter_mut().enumerate() {
                *v = v.max(edge(first[0] + n % SQUARE, first[1] + n / SQUARE));
            }
        }
    }

    fn mask(&self, mask: &Mask, dims: [usize; 2]) -> Mask {
        let [columns, rows] = self.part(Tile::all(dims));
        let mut row = vec![false; self.dims[0]];
        let of_row = |j: usize| {
            row.fill(false);
            if rows.contains(&j) && !columns.is_empty() {
                mask.read(self.place(columns.start, j, dims), &mut row[columns.clone()]);
            }
            row.clone()
        };
        (0..self.dims[1]).flat_map(of_row).collect()
    }

    fn level(&self, level: &LevelSlice, dims: [usize; 2], more: BTreeMap<usize, f32>) -> LevelSlice {
        let near = level.near().iter().filter_map(|&(n, v)| {
            let at: [isize; 2] = [(n % dims[0]) as isize - self.origin[0], (n / dims[0]) as isize - self.origin[1]];
            let within = (0..2).all(|a| (0..self.dims[a] as isize).contains(&at[a]));
            within.then(|| (at[1] as usize * self.dims[0] + at[0] as usize, v))
        });
        let sides = self.with(self.mask(level.sides(), dims), &more);
        if more.is_empty() {
            return level.with(sides, near.collect());
        }
        let largest = level.largest();
        let mut values: BTreeMap<usize, f32> = more.into_iter().map(|(n, v)| (n, v.clamp(-largest, largest))).collect();
        values.extend(near);
        let nx = self.dims[0];
        // All that is inside lies well within the window.
        let is_near = |n: usize| [n - 1, n + 1, n - nx, n + nx].iter().any(|m| sides.at(*m) != sides.at(n));
        let near = values.into_iter().filter(|(n, _)| is_near(*n)).collect();
        level.with(sides, near)
    }

    /// A layer on the image from one on the window; `outside` is what lies around.
    pub fn image(&self, layer: &SparseImage<f32>, dims: [usize; 2], outside: f32) -> SparseImage<f32> {
        layer.window(self.origin.map(|n| -n), dims, outside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(dims: [usize; 2], inside: impl Fn(usize, usize) -> bool, level: bool) -> ContourStack {
        let pixels = (0..dims[0] * dims[1]).map(|n| inside(n % dims[0], n / dims[0]));
        let content = match level {
            false => SliceContent::Mask(pixels.collect()),
            true => {
                let values: Vec<f32> = pixels.enumerate().map(|(n, i)| if i { -1.0 } else { 1.0 + n as f32 }).collect();
                SliceContent::Level(LevelSlice::new(&values, dims[0]))
            }
        };
        let slice = |z: f64| Slice { name: "a".into(), z, extra: false, content: content.clone() };
        ContourStack {
            dims,
            spacing: [1.0; 2],
            unit: "px".into(),
            slices: vec![slice(0.0), slice(1.0)],
            z_out: None,
            geometry: Default::default(),
            known: None,
        }
    }

    #[test]
    fn a_body_that_the_border_cuts_goes_on_in_the_window_and_ends_on_the_image() {
        let (dims, spacing) = ([40, 30], [1.0, 1.0]);
        let own = stack(dims, |i, j| i < 20 && (10..18).contains(&j), false);
        let window = Window::around(&own, [5, 2]);
        assert!(window.beyond && window.origin == [-9, 8] && window.dims == [34, 12], "{window:?}");
        let seen = window.of(&own, 1..2);
        assert_eq!((seen.slices.len(), seen.slices[0].z), (1, 1.0));
        let sides = seen.slices[0].content.sides();
        assert_eq!(sides.iter().filter(|inside| **inside).count(), 24 * 8);
        let mut phi =
            SparseImage::of(window.dims, &sides.iter().map(|s| if *s { -3.0 } else { 3.0 }).collect::<Vec<_>>());
        window.end_at_border(&mut phi, dims, spacing, 5.0);
        for (n, v) in phi.iter().enumerate() {
            let [i, j] = [(n % 34) as isize - 9, (n / 34) as isize + 8];
            let before = if (-4..20).contains(&i) && (10..18).contains(&j) { -3.0 } else { 3.0 };
            let expected = f32::max(before, (-0.5 - i as f32).min(5.0));
            assert_eq!(*v, expected, "({i}, {j})");
        }
    }

    #[test]
    fn what_a_layer_has_beyond_the_border_is_not_there_though_no_slice_goes_on() {
        let own = stack([40, 30], |i, j| (1..20).contains(&i) && (10..18).contains(&j), false);
        let window = Window::around(&own, [5, 2]);
        assert!(!window.beyond && window.origin == [-4, 8]);
        let mut phi = SparseImage::of(window.dims, &vec![-3.0; window.dims[0] * window.dims[1]]);
        window.end_at_border(&mut phi, own.dims, own.spacing, 5.0);
        let nx = window.dims[0];
        let expected = |n: usize| if n % nx < 4 { 3.5 - (n % nx) as f32 } else { -3.0 };
        assert!(phi.iter().enumerate().all(|(n, v)| *v == expected(n)), "{phi:?}");
    }

    #[test]
    fn a_level_set_that_the_border_cuts_goes_on_straight_in_the_window() {
        // A bar that turns as it leaves the image.
        let value = |x: f64, y: f64| (3.0 * (8.3 + 0.4 * x - y)).max(0.7 * (y - 17.6 + 0.15 * x)).max(x - 20.2);
        let values: Vec<f32> = (0..40 * 30).map(|n| value((n % 40) as f64, (n / 40) as f64) as f32).collect();
        let mut own = stack([40, 30], |_, _| false, true);
        own.slices.iter_mut().for_each(|s| s.content = SliceContent::Level(LevelSlice::new(&values, 40)));
        let window = Window::around(&own, [5, 2]);
        assert!(window.beyond && window.origin == [-9, 5], "{window:?}");
        let seen = window.of(&own, 0..1);
        let SliceContent::Level(seen) = &seen.slices[0].content else { panic!("a level set stays one") };
        let nx = window.dims[0];
        let side = |n: usize| seen.sides().at(n);
        let is_near = |n: usize| [n - 1, n + 1, n - nx, n + nx].iter().any(|m| side(*m) != side(n));
        let inner = (nx..seen.sides().len() - nx).filter(|n| is_near(*n));
        for n in inner {
            let [x, y] = [(n % nx) as f64 - 9.0, (n / nx) as f64 + 5.0];
            assert_eq!(side(n), x > -4.5 && value(x, y) < 0.0, "({x}, {y})");
            let kept = seen.near().iter().find(|(m, _)| *m == n);
            // Where what goes on ends there are no values but the sides.
            let Some((_, v)) = kept else {
                assert!(x < -4.5, "({x}, {y}) has no value");
                continue;
            };
            let expected = value(x, y).clamp(-f64::from(seen.largest()), f64::from(seen.largest()));
            assert!((f64::from(*v) - expected).abs() < 1e-4, "({x}, {y}): {v}, not {expected}");
        }
        assert!(seen.near().iter().all(|(n, v)| side(*n) == (*v < 0.0) && is_near(*n)));
    }

    #[test]
    fn a_window_lies_around_what_is_drawn_and_gives_it_back() {
        // In the middle, and cut by the image's border.
        for (corner, level) in [([9, 5], false), ([0, 0], false), ([26, 17], true), ([9, 5], true)] {
            let dims = [30, 20];
            let inside = |i: usize, j: usize| {
                i >= corner[0] && i < corner[0] + 4 && j >= corner[1] && j < corner[1] + 3 && !(i + j).is_multiple_of(3)
            };
            let own = stack(dims, inside, level);
            let window = Window::around(&own, [5, 2]);
            assert_eq!(window.dims, [14, 7]);
            assert_eq!(window.origin, [corner[0] as isize - 5, corner[1] as isize - 2]);
            let seen = window.of(&own, 0..2);
            let phi: Vec<f32> =
                seen.slices[0].content.sides().iter().map(|inside| if *inside { -1.0 } else { 2.0 }).collect();
            let back = window.image(&SparseImage::of(window.dims, &phi), dims, 7.0).unpack();
            for (n, v) in back.iter().enumerate() {
                assert_eq!(*v < 0.0, inside(n % 30, n / 30), "pixel {n}");
                let distant = (n % 30) + 5 < corner[0] || n / 30 > corner[1] + 4;
                assert!(!distant || *v == 7.0, "pixel {n}: {v}");
            }
            if let [SliceContent::Level(a), SliceContent::Level(b)] = [&own, &seen].map(|s| &s.slices[0].content) {
                assert_eq!(a.largest(), b.largest());
                let sum = |u: &LevelSlice| u.near().iter().map(|(_, v)| v).sum::<f32>();
                assert!(sum(a) == sum(b) && a.near().len() == b.near().len());
            }
        }
    }
}
