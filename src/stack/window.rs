//! A stack seen through a window: the box around everything that is drawn, wherever in the image it lies.
//!
//! A computation in the window knows nothing of the image around it: a body costs the same and comes out the same in an image of any size and
//! wherever it is shifted to.

use crate::grid::sparse_image::SparseImage;

use super::{ContourStack, LevelSlice, Mask, Slice, SliceContent};

/// A box of pixels on a plane of which the image is a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Its first pixel, counted from the image's.
    pub origin: [isize; 2],
    /// Its pixels.
    pub dims: [usize; 2],
}

impl Window {
    /// The box around what is drawn on any slice and `around` pixels more to every side; the whole image where nothing is.
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
            return Window { origin: [0; 2], dims: stack.dims };
        }
        Window {
            origin: [0, 1].map(|a| low[a] as isize - around[a] as isize),
            dims: [0, 1].map(|a| high[a] - low[a] + 1 + 2 * around[a]),
        }
    }

    /// Columns of the window that are columns of an image of `dims` pixels, likewise rows.
    fn shared(&self, dims: [usize; 2]) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|a| {
            let clamped = |n: isize| n.clamp(0, self.dims[a] as isize) as usize;
            let (start, end) = (clamped(-self.origin[a]), clamped(dims[a] as isize - self.origin[a]));
            start..end.max(start)
        })
    }

    /// Place on the image of pixel `(i, j)` of the window.
    fn place(&self, i: usize, j: usize, dims: [usize; 2]) -> usize {
        let of = |a: usize, n: usize| (n as isize + self.origin[a]) as usize;
        of(1, j) * dims[0] + of(0, i)
    }

    /// The stack through the window; beyond the image is outside.
    pub fn of(&self, stack: &ContourStack) -> ContourStack {
        let content = |content: &SliceContent| match content {
            SliceContent::Mask(mask) => SliceContent::Mask(self.mask(mask, stack.dims)),
            SliceContent::Level(level) => SliceContent::Level(self.level(level, stack.dims)),
        };
        let slices = stack.slices.iter().map(|s| Slice { name: s.name.clone(), content: content(&s.content), ..*s });
        ContourStack { dims: self.dims, slices: slices.collect(), unit: stack.unit.clone(), ..*stack }
    }

    fn mask(&self, mask: &Mask, dims: [usize; 2]) -> Mask {
        let [columns, rows] = self.shared(dims);
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

    fn level(&self, level: &LevelSlice, dims: [usize; 2]) -> LevelSlice {
        let near = level.near().iter().filter_map(|&(n, v)| {
            let at: [isize; 2] = [(n % dims[0]) as isize - self.origin[0], (n / dims[0]) as isize - self.origin[1]];
            let within = (0..2).all(|a| (0..self.dims[a] as isize).contains(&at[a]));
            within.then(|| (at[1] as usize * self.dims[0] + at[0] as usize, v))
        });
        level.with(self.mask(level.sides(), dims), near.collect())
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
        }
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
            let seen = window.of(&own);
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
