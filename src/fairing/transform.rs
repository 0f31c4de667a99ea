//! Quantity of a layer that is averaged: `v = B tanh(u / (n B))` of its distances u, with the 3D gradient `n = max(|grad u|, 0.3)`.

use multiversion::multiversion;

use super::flatness::{self, Around};
use super::near::{NearSquares, SATURATED, nearer};
use crate::grid::sparse_image::SparseImage;

/// Least gradient: flat places must not be blown up.
const LEAST_GRADIENT: f32 = 0.3;
/// Beyond this `u / (n B)` tanh stays as it is.
const FLAT: f32 = 6.0;

/// Lengths that the transformation of a layer depends on.
#[derive(Debug, Clone, Copy)]
pub struct Lengths {
    /// Pixel sides.
    pub spacing: [f64; 2],
    /// B.
    pub bound: f32,
    /// Height between the layers below and above.
    pub rise: f32,
}

/// v of a layer from itself and those below and above it, and n near the surface, less where it lies flat, 0 elsewhere.
pub fn transform(layers: [&SparseImage<f32>; 3], lengths: Lengths) -> [SparseImage<f32>; 2] {
    let [below, here, above] = layers;
    let dims @ [nx, ny] = here.dims();
    let [dx, dy] = lengths.spacing.map(|s| s as f32);
    let squares = here.squares();
    // Where nothing changes all pixels are as one of them.
    let whole = |square: [usize; 2]| {
        let [own, lower, higher] = [here, below, above].map(|layer| layer.whole(square));
        let (own, lower, higher) = (own?, lower?, higher?);
        let like = |axis: usize, step: isize| {
            let mut beside = square;
            beside[axis] = (square[axis] as isize + step).clamp(0, squares[axis] as isize - 1) as usize;
            here.whole(beside).is_some_and(|v| v.to_bits() == own.to_bits())
        };
        if !(like(0, -1) && like(0, 1) && like(1, -1) && like(1, 1)) {
            return None;
        }
        let mut out = [[0.0]; 3];
        let lines = [[own; 3], [own; 3], [own; 3], [lower; 3], [higher; 3]];
        let per = [0.5 / dx, 1.0 / dy, 1.0 / lengths.rise];
        transform_row(
            lines.each_ref().map(|line| line.as_slice()),
            per,
            lengths.bound,
            out.each_mut().map(|v| &mut v[..]),
        );
        Some(out.map(|[v]| v))
    };
    let fill = |[left, first]: [usize; 2], width: usize, [v, gradient, sideways]: [&mut [f32]; 3]| {
        let mut lines = [const { Vec::new() }; 5];
        lines.iter_mut().for_each(|line: &mut Vec<f32>| line.resize(width + 2, 0.0));
        let rows =
            v.chunks_exact_mut(width).zip(gradient.chunks_exact_mut(width)).zip(sideways.chunks_exact_mut(width));
        // A pixel more at either end, where there is one.
        let read = left.saturating_sub(1)..(left + width + 1).min(nx);
        let to = read.start + 1 - left..read.end + 1 - left;
        for (j, ((v, gradient), sideways)) in (first..).zip(rows) {
            let (down, up) = (j.saturating_sub(1), (j + 1).min(ny - 1));
            let sources = [(here, j), (here, down), (here, up), (below, j), (above, j)];
            for (line, (layer, j)) in lines.iter_mut().zip(sources) {
                layer.read(read.start, j, &mut line[to.clone()]);
            }
            // One-sided differences at the edges.
            let (line, next) = (&mut lines[0], 2.min(nx));
            if left == 0 {
                line[0] = 2.0 * line[1] - line[next];
            }
            if left + width == nx {
                line[width + 1] = 2.0 * line[width] - line[width + 1 - next];
            }
            let per = [0.5 / dx, 1.0 / (dy * (up - down).max(1) as f32), 1.0 / lengths.rise];
            transform_row(lines.each_ref().map(Vec::as_slice), per, lengths.bound, [v, gradient, sideways]);
        }
    };
    let [v, gradient, sideways] = SparseImage::of_stretches(dims, whole, fill);
    let near = NearSquares::new(&v, SATURATED * lengths.bound);
    let around = Around::new([&sideways, &v], &near, lengths.bound, lengths.spacing);
    let nowhere = |square: [usize; 2]| near.is_far(square).then(|| gradient.whole(square).map(|n| [n]))?;
    let [gradient] = SparseImage::of_stretches(dims, nowhere, |[left, first], width, [rows]: [&mut [f32]; 1]| {
        let mut own = vec![0.0; width];
        for (j, row) in (first..).zip(rows.chunks_exact_mut(width)) {
            gradient.read(left, j, row);
            v.read(left, j, &mut own);
            for pixels in nearer(&own, SATURATED * lengths.bound) {
                around.scale(j, left + pixels.start, &mut row[pixels]);
            }
        }
    });
    [v, gradient]
}

/// v, n as each pixel asks by itself, and how far the surface goes sideways per height (the latter two 0 where it is not near), of a row from
/// itself, those beside it, and those below and above it, each with one value more at either end; `per` is what differences are divided by.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn transform_row(lines: [&[f32]; 5], per: [f32; 3], bound: f32, [v, gradient, sideways]: [&mut [f32]; 3]) {
    let nx = v.len();
    let [u, south, north, lower, higher] = lines.map(|line| &line[..nx + 2]);
    let (gradient, sideways) = (&mut gradient[..nx], &mut sideways[..nx]);
    for i in 0..nx {
        let gx = (u[i + 2] - u[i]) * per[0];
        let gy = (north[i + 1] - south[i + 1]) * per[1];
        let gz = (higher[i + 1] - lower[i + 1]) * per[2];
        let along = gx * gx + gy * gy;
        let steep = gz.abs() / along.sqrt().max(LEAST_GRADIENT);
        let n = (along + gz * gz).sqrt().max(LEAST_GRADIENT);
        let ratio = tanh(u[i + 1] / (n * bound));
        let alone = flatness::alone(f64::from(steep)) as f32;
        let near = ratio.abs() < SATURATED;
        v[i] = bound * ratio;
        gradient[i] = if near { n * alone } else { 0.0 };
        sideways[i] = if near { steep } else { 0.0 };
    }
}

/// tanh by Lambert's continued fraction cut after x^9, to 1e-5, a constant beyond FLAT. Unlike the system's it is computed for many pixels at once.
#[inline(always)]
pub fn tanh(x: f32) -> f32 {
    let x = x.clamp(-FLAT, FLAT);
    let s = x * x;
    let p = x * ((((s + 990.0) * s + 135_135.0) * s + 4_729_725.0) * s + 34_459_425.0);
    let q = (((45.0 * s + 13_860.0) * s + 945_945.0) * s + 16_216_200.0) * s + 34_459_425.0;
    (p / q).clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layer clamped at 4 around some discs, with a plate over whole squares, and the same with every square stored.
    fn discs(dims: [usize; 2], shift: f32) -> [SparseImage<f32>; 2] {
        let value = |n: usize| {
            let (x, y) = ((n % dims[0]) as f32, (n / dims[0]) as f32);
            if (64.0..96.0).contains(&x) && (96.0..112.0).contains(&y) {
                return -1.0;
            }
            let to = |[cx, cy, r]: [f32; 3]| (x - cx - shift).hypot(y - cy) - r;
            [[12.0, 60.0, 9.0], [70.0, 20.0, 40.0], [150.0, 90.0, 14.5]]
                .map(to)
                .into_iter()
                .fold(4.0, f32::min)
                .max(-4.0)
        };
        let sparse = SparseImage::of(dims, &(0..dims[0] * dims[1]).map(value).collect::<Vec<f32>>());
        let mut dense = sparse.clone();
        sparse.each_square().for_each(|square| _ = dense.square_mut(square));
        [sparse, dense]
    }

    #[test]
    fn whole_squares_are_as_their_pixels() {
        for (dims, rise) in [([200, 120], 3.0), ([177, 97], 0.1)] {
            let [below, here, above] = [-2.5, 0.0, 40.0].map(|shift| discs(dims, shift));
            assert!(here[0].each_square().filter(|s| here[0].whole(*s).is_some()).count() > 20);
            let lengths = Lengths { spacing: [1.0, 0.5], bound: 2.0, rise };
            let of = |k: usize| transform([&below[k], &here[k], &above[k]], lengths).map(|v| v.unpack());
            let [sparse, dense] = [0, 1].map(of);
            for (a, b) in sparse.iter().flatten().zip(dense.iter().flatten()) {
                assert_eq!(a.to_bits(), b.to_bits());
            }
        }
    }

    #[test]
    fn a_plane_has_its_gradient_at_every_pixel() {
        let (dims, spacing, slope) = ([37, 21], [0.5, 2.0], [0.6f32, 0.48, 0.3]);
        let value = |z: f32, n: usize| {
            let (x, y) = ((n % dims[0]) as f32 * 0.5, (n / dims[0]) as f32 * 2.0);
            slope[0] * (x - 9.0) + slope[1] * (y - 20.0) + slope[2] * z
        };
        let layer = |z: f32| SparseImage::of(dims, &(0..dims[0] * dims[1]).map(|n| value(z, n)).collect::<Vec<f32>>());
        let layers = [layer(-1.5), layer(0.0), layer(0.5)];
        let lengths = Lengths { spacing, bound: 2.0, rise: 2.0 };
        let [v, gradient] = transform(layers.each_ref(), lengths).map(|of| of.unpack());
        let n = slope.iter().map(|s| s * s).sum::<f32>().sqrt();
        for (k, (v, gradient)) in v.iter().zip(&gradient).enumerate() {
            let ratio = (value(0.0, k) / (n * 2.0)).tanh();
            assert!((v - 2.0 * ratio).abs() < 1e-4, "v of pixel {k}: {v}");
            let expected = if ratio.abs() < SATURATED { n } else { 0.0 };
            assert!(
                (gradient - expected).abs() < 1e-4 || (ratio.abs() - SATURATED).abs() < 1e-4,
                "n of pixel {k}: {gradient}"
            );
        }
        assert!(gradient.iter().filter(|n| **n > 0.0).count() > 100);
    }

    #[test]
    fn what_lies_flat_counts_less_by_how_flat_it_is() {
        let bound = 2.0;
        for [gx, gy, gz] in [[0.3f32, 0.4, 0.1], [0.3, -0.4, 2.0], [0.03, 0.04, 1.0], [0.0, 0.1, -0.7], [0.4, 0.0, 2.6]]
        {
            let row: Vec<f32> = (0..8).map(|i| 0.1 + gx * (i as f32 - 3.0)).collect();
            let [south, north, lower, higher] =
                [-gy, gy, -gz, gz].map(|g| row.iter().map(|v| v + g).collect::<Vec<_>>());
            let [mut v, mut gradient, mut sideways] = [[0.0; 6]; 3];
            let lines = [&row, &south, &north, &lower, &higher].map(Vec::as_slice);
            transform_row(lines, [0.5; 3], bound, [&mut v, &mut gradient, &mut sideways]);
            let n = (gx * gx + gy * gy + gz * gz).sqrt().max(LEAST_GRADIENT);
            let steep = gz.abs() / gx.hypot(gy).max(LEAST_GRADIENT);
            // At the pixel whose distance is 0.1.
            let pixel = 2;
            assert!((row[pixel + 1] - 0.1).abs() < 1e-6);
            assert!((v[pixel] - bound * (0.1 / (n * bound)).tanh()).abs() < 1e-4, "v is {}", v[pixel]);
            assert!((sideways[pixel] - steep).abs() < 1e-4, "{}, not {steep}", sideways[pixel]);
            let upright = flatness::alone(f64::from(steep)) as f32;
            assert!((gradient[pixel] - n * upright).abs() < 1e-4, "{}, not {n} {upright}", gradient[pixel]);
        }
    }

    #[test]
    fn tanh_is_the_hyperbolic_tangent() {
        for k in -20_000..=20_000 {
            let x = k as f32 * 5e-4;
            let difference = f64::from(tanh(x)) - f64::from(x).tanh();
            assert!(difference.abs() < 1e-5, "{x}: {difference:e}");
        }
        assert_eq!([tanh(7.0), tanh(-1e30)], [tanh(6.0), -tanh(6.0)]);
    }
}
