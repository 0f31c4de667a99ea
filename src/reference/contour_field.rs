//! Level set phi_i of a slice: anti-aliasing, distance, conditioning.

use multiversion::multiversion;

use super::band::Band;
use super::distance::distance_of;
use super::exact::exact_distance;
use super::hj_step::Scratch;
use super::reinit::reinit;
use crate::backend::ContourOptions;
use crate::backend::conditioning::{
    AREA_SIGMA, CONDITION_ITERATIONS, CONDITION_WIDER, CONDITIONED, EQ6_ITERATIONS, FIELD_FLOOR, KERNEL_CLIP,
    LEAST_LENGTH, MASK_FLOOR, MOST_SHIFT, contour_length, gaussian_weights, pixel_width,
};
use crate::grid::field::{Field, covered};
use crate::settings::AntiAlias;

/// Signed distance field of a mask, px; `inf` where the mask is empty. The side of every pixel is the mask's.
pub fn field_of_mask(mask: &[bool], dims: [usize; 2], h: [f64; 2], options: ContourOptions) -> Field {
    if !mask.contains(&true) {
        return Field::filled(dims, f64::INFINITY);
    }
    let binary = Field { dims, data: mask.iter().map(|&m| if m { -0.5 } else { 0.5 }).collect() };
    let smooth = match options.anti_alias {
        AntiAlias::None => return condition(distance_of(&binary, h), h, options.half_width),
        AntiAlias::Kernel => without_second_moment(&binary, options.sigma),
        AntiAlias::Eq6 => {
            let band = Band::new(&mut exact_distance(mask, dims, h), options.half_width + CONDITION_WIDER);
            let mut u = binary;
            reinit(&mut u, &band, h, EQ6_ITERATIONS, &mut Scratch::default());
            u
        }
    };
    let mut phi = distance_of(&keep_side(smooth, |k| mask[k], MASK_FLOOR), h);
    if options.anti_alias == AntiAlias::Kernel {
        let exact = exact_distance(mask, dims, h);
        for (v, e) in phi.data.iter_mut().zip(&exact.data) {
            *v = v.clamp(e - KERNEL_CLIP, e + KERNEL_CLIP);
        }
    }
    let phi = condition(phi, h, options.half_width);
    if options.anti_alias == AntiAlias::Kernel { with_area(phi, mask, h) } else { phi }
}

/// Signed distance to the sub-pixel zero set of `u` (negative inside, 0 counts as outside); `inf` where nothing is inside.
pub fn field_of_level(u: &Field, h: [f64; 2], options: ContourOptions) -> Field {
    if !u.has_inside() {
        return Field::filled(u.dims, f64::INFINITY);
    }
    condition(distance_of(u, h), h, options.half_width)
}

/// Brings a distance field to the fixed point of the sweeps' reinitialisation near its contour, without changing any side.
fn condition(phi: Field, h: [f64; 2], half_width: f64) -> Field {
    let mut relaxed = phi.clone();
    let band = Band::new(&mut relaxed, half_width + CONDITION_WIDER);
    reinit(&mut relaxed, &band, h, CONDITION_ITERATIONS, &mut Scratch::default());
    let mut out = phi.clone();
    for node in band.nodes() {
        if relaxed.data[node].abs() < half_width + CONDITIONED {
            out.data[node] = relaxed.data[node];
        }
    }
    keep_side(out, |k| phi.data[k] < 0.0, FIELD_FLOOR)
}

/// Moves a contour along its normal by the area that it lacks of its mask per length, both in a Gaussian window: what smoothing takes from
/// small and thin parts comes back. With the share c of a pixel that lies inside, `phi -= (G * (mask - c)) / (G * length)`.
fn with_area(mut phi: Field, mask: &[bool], h: [f64; 2]) -> Field {
    let [nx, ny] = phi.dims;
    // The steeper side: in the middle of a thin part the level set rises to both.
    let width = |i: usize, j: usize| {
        let own = phi.data[j * nx + i];
        let steeper = |low: usize, high: usize| (phi.data[low] - own).abs().max((phi.data[high] - own).abs());
        let across = steeper(j * nx + i.saturating_sub(1), j * nx + (i + 1).min(nx - 1));
        let along = steeper(j.saturating_sub(1) * nx + i, (j + 1).min(ny - 1) * nx + i);
        pixel_width([across / h[0], along / h[1]], h)
    };
    let of = |value: &dyn Fn(bool, f64, f64) -> f64| {
        let at = |i: usize, j: usize| {
            let (inside, v) = (mask[j * nx + i], phi.data[j * nx + i]);
            // No pixel is wider than 1.
            if v.abs() < 1.0 { value(inside, v, width(i, j)) } else { 0.0 }
        };
        gaussian(&Field::from_fn(phi.dims, at), AREA_SIGMA)
    };
    let lack = of(&|inside, v, width| f64::from(u8::from(inside)) - covered(v / width));
    let length = of(&|_, v, width| contour_length(v, width));
    for (v, (lack, length)) in phi.data.iter_mut().zip(lack.data.iter().zip(&length.data)) {
        *v -= (lack / length.max(LEAST_LENGTH)).clamp(-MOST_SHIFT, MOST_SHIFT);
    }
    keep_side(phi, |k| mask[k], FIELD_FLOOR)
}

fn keep_side(mut u: Field, inside: impl Fn(usize) -> bool, floor: f64) -> Field {
    for (k, v) in u.data.iter_mut().enumerate() {
        *v = if inside(k) { v.min(-floor) } else { v.max(floor) };
    }
    u
}

/// `2 G - G * G` applied to `u`: smooths without a second moment, so that no contour shrinks to leading order.
fn without_second_moment(u: &Field, sigma: f64) -> Field {
    let once = gaussian(u, sigma);
    let twice = gaussian(&once, sigma);
    Field { dims: u.dims, data: once.data.iter().zip(&twice.data).map(|(a, b)| 2.0 * a - b).collect() }
}

/// Gaussian of width `sigma` samples, cut at 4 sigma, edges repeated.
fn gaussian(u: &Field, sigma: f64) -> Field {
    let weights = gaussian_weights(sigma);
    let reach = weights.len() / 2;
    let [nx, ny] = u.dims;
    let mut along_x = Field::filled(u.dims, 0.0);
    let mut repeated = vec![0.0; nx + 2 * reach];
    for (row, out) in u.data.chunks_exact(nx).zip(along_x.data.chunks_exact_mut(nx)).filter(|(row, _)| !is_zero(row)) {
        repeated[..reach].fill(row[0]);
        repeated[reach..reach + nx].copy_from_slice(row);
        repeated[reach + nx..].fill(row[nx - 1]);
        weights.iter().enumerate().for_each(|(k, w)| add_scaled(out, &repeated[k..k + nx], *w));
    }
    let mut out = Field::filled(u.dims, 0.0);
    for (j, out) in out.data.chunks_exact_mut(nx).enumerate() {
        for (k, w) in weights.iter().enumerate() {
            let from = (j + k).saturating_sub(reach).min(ny - 1);
            let row = &along_x.data[from * nx..(from + 1) * nx];
            if !is_zero(row) {
                add_scaled(out, row, *w);
            }
        }
    }
    out
}

fn is_zero(row: &[f64]) -> bool {
    row.iter().all(|v| *v == 0.0)
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn add_scaled(out: &mut [f64], row: &[f64], w: f64) {
    out.iter_mut().zip(row).for_each(|(sum, v)| *sum += w * v);
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    const SIDE: usize = 64;
    /// Parts of a pixel along each axis at which areas are counted.
    const PARTS: usize = 16;

    /// Area inside the level set, bilinear between pixels, of the pixels that are chosen by their place, over theirs.
    fn share(h: [f64; 2], is_inside: impl Fn(DVec2) -> bool, anti_alias: AntiAlias) -> f64 {
        let place = |n: usize| DVec2::new((n % SIDE) as f64 - 32.0, (n / SIDE) as f64 - 32.0) * DVec2::from(h);
        let mask: Vec<bool> = (0..SIDE * SIDE).map(|n| is_inside(place(n))).collect();
        let options = ContourOptions { anti_alias, sigma: 1.0, half_width: 6.0 };
        let phi = field_of_mask(&mask, [SIDE; 2], h, options);
        assert!(phi.data.iter().zip(&mask).all(|(v, inside)| (*v < 0.0) == *inside), "a pixel has changed its side");
        let at = |n: usize| n as f64 / PARTS as f64 + 0.5 / PARTS as f64;
        let count = (0..(SIDE - 1) * PARTS)
            .flat_map(|j| (0..(SIDE - 1) * PARTS).map(move |i| DVec2::new(at(i), at(j))))
            .filter(|x| phi.sample(*x) < 0.0)
            .count();
        count as f64 / (PARTS * PARTS) as f64 / mask.iter().filter(|m| **m).count() as f64
    }

    #[test]
    fn small_and_thin_parts_keep_the_area_of_their_pixels() {
        for h in [[1.0, 1.0], [0.25, 1.0], [1.0, 0.5]] {
            for radius in [1.5, 2.2, 3.0, 5.0] {
                for middle in [DVec2::new(0.1, 0.2), DVec2::new(0.5, 0.05)] {
                    let found = share(h, |x| x.distance(middle) < radius, AntiAlias::Kernel);
                    assert!((0.9..1.01).contains(&found), "radius {radius} at {middle}, sides {h:?}: {found}");
                }
            }
            for samples in 1..5 {
                let half = DVec2::splat(f64::from(samples) - 0.5) * DVec2::from(h);
                let walls = [
                    share(h, |x| x.x > -0.01 && x.x < half.x && x.y.abs() < 7.0, AntiAlias::Kernel),
                    share(h, |x| x.y > -0.01 && x.y < half.y && x.x.abs() < 7.0, AntiAlias::Kernel),
                ];
                assert!(
                    walls.iter().all(|wall| (0.9..1.01).contains(wall)),
                    "{samples} samples, sides {h:?}: {walls:?}"
                );
            }
        }
    }

    #[test]
    fn the_papers_way_is_left_as_it_is() {
        let bar = |x: DVec2| x.x > -0.01 && x.x < 1.5 && x.y.abs() < 18.0;
        let [paper, own] = [AntiAlias::Eq6, AntiAlias::Kernel].map(|rule| share([1.0; 2], bar, rule));
        assert!(paper > 1.15 && own < 1.01, "two pixels wide: {paper} by Eq. 6, {own} by the kernel");
    }
}
