//! Exact Euclidean distance to the other side of a mask (Felzenszwalb and Huttenlocher 2012), the pixel edge half way.

use glam::DVec2;

use crate::grid::field::Field;

/// Pixels at equal distance may give different results where a pixel is not square: within this many pixels of a tie the least one counts.
pub const TIE: f64 = 1e-3;

/// Signed distance `e = d (1 - 1 / (2 n))` of each pixel, where d is the distance to the nearest pixel of the other side and n the
/// same in pixel steps: half a pixel less than d, whatever the direction and pixel shape. Negative inside; `inf` without contour.
pub fn exact_distance(mask: &[bool], dims: [usize; 2], h: [f64; 2]) -> Field {
    let to_inside = unsigned(mask, true, dims, h);
    let to_outside = unsigned(mask, false, dims, h);
    let data = mask.iter().enumerate().map(|(k, &inside)| if inside { -to_outside[k] } else { to_inside[k] }).collect();
    Field { dims, data }
}

/// Distance to the nearest pixel with `mask == side`, less half a pixel, where `mask != side`.
fn unsigned(mask: &[bool], side: bool, [nx, ny]: [usize; 2], h: [f64; 2]) -> Vec<f64> {
    // Columns: steps to the nearest pixel of the side in the same column.
    let mut steps = vec![f64::INFINITY; nx * ny];
    for j in 0..ny {
        for i in 0..nx {
            let node = j * nx + i;
            steps[node] = if mask[node] == side {
                0.0
            } else if j > 0 {
                steps[node - nx] + 1.0
            } else {
                f64::INFINITY
            };
        }
    }
    for j in (0..ny.saturating_sub(1)).rev() {
        for node in j * nx..(j + 1) * nx {
            steps[node] = steps[node].min(steps[node + nx] + 1.0);
        }
    }
    // Rows: lower envelope of the parabolas (hx (i - q))^2 + (hy steps[q])^2.
    let mut out = vec![f64::INFINITY; nx * ny];
    let (mut feet, mut starts) = (vec![0usize; nx], vec![0.0f64; nx]);
    for j in 0..ny {
        let row = &steps[j * nx..(j + 1) * nx];
        let height = |q: usize| (h[1] * row[q] / h[0]).powi(2) + (q * q) as f64;
        let mut count = 0;
        for q in (0..nx).filter(|&q| row[q].is_finite()) {
            let mut start = f64::NEG_INFINITY;
            while count > 0 {
                let p = feet[count - 1];
                start = (height(q) - height(p)) / (2 * (q - p)) as f64;
                if start > starts[count - 1] {
                    break;
                }
                count -= 1;
                start = f64::NEG_INFINITY;
            }
            (feet[count], starts[count]) = (q, start);
            count += 1;
        }
        if count == 0 {
            continue;
        }
        let mut k = 0;
        for i in (0..nx).filter(|i| mask[j * nx + i] != side) {
            while k + 1 < count && starts[k + 1] < i as f64 - TIE {
                k += 1;
            }
            let away = |q: usize| {
                let steps = DVec2::new(i.abs_diff(q) as f64, row[q]);
                (steps * DVec2::from(h)).length() * (1.0 - 0.5 / steps.length().max(0.5))
            };
            let tied = (k + 1..count).take_while(|&l| starts[l] < i as f64 + TIE);
            out[j * nx + i] = tied.map(|l| away(feet[l])).fold(away(feet[k]), f64::min);
        }
    }
    out
}
