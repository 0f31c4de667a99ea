//! The same body, lying otherwise.

use interslice::Settings;
use interslice::settings::EndRule;
use interslice::stack::{ContourStack, LevelSlice, Slice, SliceContent};

/// How a body is moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Turn {
    /// By 90 degrees in the plane.
    Quarter,
    MirrorX,
    MirrorY,
    Transposed,
    /// By whole pixels, in an image larger by as many.
    Shifted([usize; 2]),
    /// Heights times this.
    Heights(f64),
    UpsideDown,
}

/// All of them.
pub const TURNS: [Turn; 9] = [
    Turn::Quarter,
    Turn::MirrorX,
    Turn::MirrorY,
    Turn::Transposed,
    Turn::Shifted([1, 0]),
    Turn::Shifted([3, 5]),
    Turn::Heights(0.1),
    Turn::Heights(10.0),
    Turn::UpsideDown,
];

impl Turn {
    /// Pixel of the turned image that pixel (i, j) becomes.
    pub fn pixel(self, [nx, ny]: [usize; 2], [i, j]: [usize; 2]) -> [usize; 2] {
        match self {
            Turn::Quarter => [ny - 1 - j, i],
            Turn::MirrorX => [nx - 1 - i, j],
            Turn::MirrorY => [i, ny - 1 - j],
            Turn::Transposed => [j, i],
            Turn::Shifted([a, b]) => [i + a, j + b],
            Turn::Heights(_) | Turn::UpsideDown => [i, j],
        }
    }

    /// The turned image's pixels.
    pub fn dims(self, [nx, ny]: [usize; 2]) -> [usize; 2] {
        match self {
            Turn::Quarter | Turn::Transposed => [ny, nx],
            Turn::Shifted([a, b]) => [nx + a, ny + b],
            _ => [nx, ny],
        }
    }

    /// The turned height, of a body between `ends`.
    pub fn height(self, ends: [f64; 2], z: f64) -> f64 {
        match self {
            Turn::Heights(by) => by * z,
            Turn::UpsideDown => ends[0] + ends[1] - z,
            _ => z,
        }
    }

    /// The heights, increasing.
    pub fn heights(self, ends: [f64; 2], heights: &[f64]) -> Vec<f64> {
        let mut heights: Vec<f64> = heights.iter().map(|z| self.height(ends, *z)).collect();
        heights.sort_by(f64::total_cmp);
        heights
    }

    pub fn stack(self, stack: &ContourStack, ends: [f64; 2]) -> ContourStack {
        let dims = self.dims(stack.dims);
        let [nx, ny] = stack.dims;
        let places: Vec<usize> = (0..nx * ny)
            .map(|n| {
                let [i, j] = self.pixel(stack.dims, [n % nx, n / nx]);
                j * dims[0] + i
            })
            .collect();
        let content = |content: &SliceContent| match content {
            SliceContent::Mask(mask) => {
                let mut out = vec![false; dims[0] * dims[1]];
                mask.iter().zip(&places).for_each(|(m, n)| out[*n] = m);
                SliceContent::Mask(out.into_iter().collect())
            }
            SliceContent::Level(level) => {
                let mut out = vec![level.largest(); dims[0] * dims[1]];
                level.values().iter().zip(&places).for_each(|(v, n)| out[*n] = *v);
                SliceContent::Level(LevelSlice::new(&out, dims[0]))
            }
        };
        let slice = |s: &Slice| Slice { z: self.height(ends, s.z), content: content(&s.content), ..s.clone() };
        let mut slices: Vec<Slice> = stack.slices.iter().map(slice).collect();
        slices.sort_by(|a, b| a.z.total_cmp(&b.z));
        let spacing = if dims == [ny, nx] && matches!(self, Turn::Quarter | Turn::Transposed) {
            [stack.spacing[1], stack.spacing[0]]
        } else {
            stack.spacing
        };
        ContourStack { dims, spacing, slices, ..stack.clone() }
    }

    pub fn settings(self, settings: &Settings, ends: [f64; 2]) -> Settings {
        let rule = |rule: EndRule| match rule {
            EndRule::Peak(z) => EndRule::Peak(self.height(ends, z)),
            rule => rule,
        };
        let (bottom, top) = (rule(settings.end_bottom), rule(settings.end_top));
        let (end_bottom, end_top) = if self == Turn::UpsideDown { (top, bottom) } else { (bottom, top) };
        Settings { end_bottom, end_top, ..settings.clone() }
    }
}
