//! A scalar field on a tile of pixels, and how it is read between pixels.
//!
//! Pixel space: a position `x` counts pixels, pixel `(i, j)` has its centre at `(i, j)`, `node = j * nx + i`. Lengths (values
//! of distance fields, normals, speeds) are in pixels of the larger pixel side; `h = [hx, hy]`, the sides of one pixel in that unit,
//! has a 1 in it and nothing larger.

use glam::DVec2;

use crate::storage::spill::{Array, Large};

/// Value farther than any distance on an image.
pub const FAR: f64 = 1e30;

/// Values of a field that are worth a thread.
pub const VALUES_OF_A_THREAD: usize = 1 << 14;

/// A scalar field on a tile, row-major.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Field {
    /// Pixels `[nx, ny]`.
    pub dims: [usize; 2],
    /// Values, `nx * ny`.
    pub data: Vec<f64>,
}

impl Large for Field {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        vec![&mut self.data]
    }
}

impl Field {
    /// A field of one value.
    pub fn filled(dims: [usize; 2], value: f64) -> Self {
        Field { dims, data: vec![value; dims[0] * dims[1]] }
    }

    /// A field from a function of the pixel `(i, j)`.
    pub fn from_fn(dims: [usize; 2], mut f: impl FnMut(usize, usize) -> f64) -> Self {
        let mut data = Vec::with_capacity(dims[0] * dims[1]);
        for j in 0..dims[1] {
            data.extend((0..dims[0]).map(|i| f(i, j)));
        }
        Field { dims, data }
    }

    /// Whether any pixel is inside.
    pub fn has_inside(&self) -> bool {
        self.data.iter().any(|&v| v < 0.0)
    }

    /// Pixels that are inside.
    pub fn inside(&self) -> Vec<bool> {
        self.data.iter().map(|&v| v < 0.0).collect()
    }

    /// Bilinear value at `x`; positions beyond the tile read its edge.
    #[inline(always)]
    pub fn sample(&self, x: DVec2) -> f64 {
        sample(&self.data, self.dims, x)
    }

    /// Catmull-Rom value at `x`, C1 in x; positions beyond the tile read its edge.
    #[inline(always)]
    pub fn sample_smooth(&self, x: DVec2) -> f64 {
        sample_smooth(&self.data, self.dims, x)
    }

    /// Unit normal `grad / |grad|` at `x`: bilinear mean of the central differences at the four pixels around, zero where the
    /// gradient vanishes.
    pub fn normal(&self, x: DVec2, h: [f64; 2]) -> DVec2 {
        let ([i, j], [fx, fy]) = cell(self.dims, x, 1);
        let row = |k: usize| &self.data[(j + k - 1) * self.dims[0] + i - 1..][..4];
        let rows = [row(0), row(1), row(2), row(3)];
        let weights = [[(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)], [(1.0 - fx) * fy, fx * fy]];
        let mut g = DVec2::ZERO;
        for (b, weights) in weights.iter().enumerate() {
            for (a, w) in weights.iter().enumerate() {
                g.x += w * (0.5 * (rows[b + 1][a + 2] - rows[b + 1][a]) / h[0]);
                g.y += w * (0.5 * (rows[b + 2][a + 1] - rows[b][a + 1]) / h[1]);
            }
        }
        let length = g.length();
        if length < 1e-9 { DVec2::ZERO } else { g / length }
    }

    /// Gradient at a pixel that has four neighbours, by central differences.
    #[inline(always)]
    pub fn gradient(&self, node: usize, h: [f64; 2]) -> DVec2 {
        let (a, nx) = (&self.data, self.dims[0]);
        DVec2::new(0.5 * (a[node + 1] - a[node - 1]) / h[0], 0.5 * (a[node + nx] - a[node - nx]) / h[1])
    }

    /// Whether the contour passes between pixel `node` and one of its four neighbours.
    #[inline(always)]
    pub fn at_contour(&self, node: usize) -> bool {
        let (a, nx) = (&self.data, self.dims[0]);
        let inside = a[node] < 0.0;
        (a[node - 1] < 0.0) != inside
            || (a[node + 1] < 0.0) != inside
            || (a[node - nx] < 0.0) != inside
            || (a[node + nx] < 0.0) != inside
    }

    /// Contour point closest to pixel `node`: `x - phi n`, in pixels.
    pub fn closest_point(&self, node: usize, h: [f64; 2]) -> DVec2 {
        let g = self.gradient(node, h);
        let scale = self.data[node] / (g.length() + 1e-9);
        position(node, self.dims[0]) - scale * g / DVec2::from(h)
    }
}

/// Bilinear value at `x` of values on a tile, see [`Field::sample`].
#[inline(always)]
pub fn sample<T: Copy + Into<f64>>(a: &[T], dims: [usize; 2], x: DVec2) -> f64 {
    let ([i, j], place) = cell(dims, x, 0);
    let (nx, node) = (dims[0], j * dims[0] + i);
    bilinear([a[node].into(), a[node + 1].into(), a[node + nx].into(), a[node + nx + 1].into()], place)
}

/// Catmull-Rom value at `x` of values on a tile, see [`Field::sample_smooth`].
#[inline(always)]
pub fn sample_smooth<T: Copy + Into<f64>>(a: &[T], dims: [usize; 2], x: DVec2) -> f64 {
    let ([i, j], [fx, fy]) = cell(dims, x, 1);
    let (nx, node) = (dims[0], j * dims[0] + i);
    let (wx, wy) = (catmull_rom(fx), catmull_rom(fy));
    // Loops: closures are not inlined into kernels of other targets.
    let mut columns = [0.0; 4];
    for (row, w) in wy.iter().enumerate() {
        let values = &a[node + row * nx - nx - 1..][..4];
        for (sum, v) in columns.iter_mut().zip(values) {
            *sum += w * (*v).into();
        }
    }
    wx[0] * columns[0] + wx[1] * columns[1] + wx[2] * columns[2] + wx[3] * columns[3]
}

/// Positions that are read at once.
pub const READ_AT_ONCE: usize = 16;

/// Catmull-Rom values at some positions, `[along x, along y]`, each as [`Field::sample_smooth`] gives it.
#[inline(always)]
pub fn sample_smooth_lanes(field: &Field, x: &[[f64; READ_AT_ONCE]; 2]) -> [f64; READ_AT_ONCE] {
    let dims = field.dims;
    let (mut corners, mut places) = ([[0u32; READ_AT_ONCE]; 2], [[0.0; READ_AT_ONCE]; 2]);
    for axis in 0..2 {
        let last = (dims[axis] - 3) as f64;
        for k in 0..READ_AT_ONCE {
            let at = x[axis][k].clamp(1.0, last + 1.0);
            let corner = at.floor().min(last);
            // The last bits of such a sum are the whole number: other conversions are done one by one.
            corners[axis][k] = (corner + WHOLE).to_bits() as u32;
            places[axis][k] = at - corner;
        }
    }
    let mut down = [[0.0; 4]; READ_AT_ONCE];
    for k in 0..READ_AT_ONCE {
        down[k] = catmull_rom(places[1][k]);
    }
    let mut columns = [[0.0; 4]; READ_AT_ONCE];
    for k in 0..READ_AT_ONCE {
        let first = (corners[1][k] as usize - 1) * dims[0] + corners[0][k] as usize - 1;
        for (row, w) in down[k].iter().enumerate() {
            let values = &field.data[first + row * dims[0]..][..4];
            for (sum, v) in columns[k].iter_mut().zip(values) {
                *sum += w * v;
            }
        }
    }
    let mut out = [0.0; READ_AT_ONCE];
    for k in 0..READ_AT_ONCE {
        let (wx, columns) = (catmull_rom(places[0][k]), &columns[k]);
        out[k] = wx[0] * columns[0] + wx[1] * columns[1] + wx[2] * columns[2] + wx[3] * columns[3];
    }
    out
}

/// Of numbers from here on up to twice as much the last bit is 1.
pub const WHOLE: f64 = (1u64 << 52) as f64;

/// Lower corner of the cell around `x`, kept `rim` pixels off the edge of the tile, and the place in it.
#[inline(always)]
pub fn cell(dims: [usize; 2], x: DVec2, rim: usize) -> ([usize; 2], [f64; 2]) {
    let mut corner = [0; 2];
    let mut place = [0.0; 2];
    for axis in 0..2 {
        let last = dims[axis] - 2 - rim;
        let at = x[axis].clamp(rim as f64, (last + 1) as f64);
        // Through u32: cheaper than to usize.
        corner[axis] = (at as u32 as usize).min(last);
        place[axis] = at - corner[axis] as f64;
    }
    (corner, place)
}

/// The value at a place in a cell, from those at its corners, row by row.
#[inline(always)]
pub fn bilinear([a, b, c, d]: [f64; 4], [fx, fy]: [f64; 2]) -> f64 {
    (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d)
}

/// Weights of four values in a row at place `f` between the middle two (Catmull and Rom 1974).
#[inline(always)]
fn catmull_rom(f: f64) -> [f64; 4] {
    [
        ((-0.5 * f + 1.0) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((-1.5 * f + 2.0) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    ]
}

/// A pixel and those around it, over edges and corners, row by row.
pub fn around(node: usize, [nx, ny]: [usize; 2]) -> impl Iterator<Item = usize> + use<> {
    let (i, j) = (node % nx, node / nx);
    let rows = j.saturating_sub(1)..(j + 2).min(ny);
    rows.flat_map(move |j| (i.saturating_sub(1)..(i + 2).min(nx)).map(move |i| j * nx + i))
}

/// Position of pixel `node` of a tile `nx` pixels wide.
#[inline(always)]
pub fn position(node: usize, nx: usize) -> DVec2 {
    DVec2::new((node % nx) as f64, (node / nx) as f64)
}

/// Length of the step from `a` to `b`, of which neither square is out of range: cheaper than `hypot`.
pub fn distance(a: DVec2, b: DVec2, h: [f64; 2]) -> f64 {
    ((a - b) * DVec2::from(h)).length()
}

/// Share of a pixel that is inside where its signed distance is `phi` px.
pub fn covered(phi: f64) -> f64 {
    (0.5 - phi).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_read_what_each_position_reads() {
        for dims in [[4, 4], [5, 9], [40, 33]] {
            let field = Field::from_fn(dims, |i, j| ((i * 7 + j * 13) as f64).sin());
            for part in 0..20 {
                // Within the image, at pixels, and beyond it on all sides.
                let far = |a: usize, k: usize| (0.5 + 0.8 * ((k * (a + 2) + part) as f64 * 0.9).sin()) * dims[a] as f64;
                let at = |a: usize, k: usize| if k.is_multiple_of(5) { far(a, k).round() } else { far(a, k) };
                let x = [0, 1].map(|a| std::array::from_fn(|k| at(a, k)));
                let read = sample_smooth_lanes(&field, &x);
                for k in 0..READ_AT_ONCE {
                    let alone = field.sample_smooth(DVec2::new(x[0][k], x[1][k]));
                    assert_eq!(read[k].to_bits(), alone.to_bits(), "{dims:?}, {} {}", x[0][k], x[1][k]);
                }
            }
        }
    }

    #[test]
    fn a_normal_is_the_unit_gradient_wherever_it_is_read() {
        // Of a parabola central differences are exact, and so is the bilinear mean of its gradient.
        let h = [1.0, 0.5];
        let field = Field::from_fn([12, 16], |i, j| {
            let (x, y) = (i as f64 * h[0], j as f64 * h[1]);
            0.3 * x * x - 0.2 * y * y + 0.4 * x * y - x
        });
        for place in [[4.0, 6.0], [4.25, 6.0], [5.0, 7.75], [6.3, 8.6], [3.9, 9.1]].map(DVec2::from) {
            let x = place * DVec2::from(h);
            let gradient = DVec2::new(0.6 * x.x + 0.4 * x.y - 1.0, -0.4 * x.y + 0.4 * x.x);
            assert!(field.normal(place, h).distance(gradient.normalize()) < 1e-12, "at {place}");
        }
        assert_eq!(Field::filled([8; 2], 3.0).normal(DVec2::splat(3.5), h), DVec2::ZERO);
    }
}
