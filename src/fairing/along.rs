//! Layers read along trajectories.

use glam::DVec2;
use multiversion::multiversion;

use crate::grid::field::WHOLE;
use crate::grid::sparse_image::SparseImage;
use crate::registration::displacement::Displacement;
use crate::registration::displacement_row::ROW_LANES;

/// Pixels that are read at once.
const AT_ONCE: usize = ROW_LANES;

/// Values of a layer at the pixels of row `j` from `first` on, or where their trajectories are.
pub fn read(v: &SparseImage<f32>, offsets: Option<&Displacement>, at: [usize; 2], out: &mut [f32]) {
    let Some(offsets) = offsets else { return v.read(at[0], at[1], out) };
    read_moved(v, Some(offsets), &[], at, out);
}

/// The same once all have moved by `shifts`, px.
pub fn read_beside(
    v: &SparseImage<f32>,
    offsets: Option<&Displacement>,
    shifts: &[DVec2],
    at: [usize; 2],
    out: &mut [f32],
) {
    read_moved(v, offsets, shifts, at, out);
}

/// Values of a layer where pixels have moved, by the offsets of their trajectories and by `shifts`, where there are any: bilinear, the edge repeated.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn read_moved(
    v: &SparseImage<f32>,
    offsets: Option<&Displacement>,
    shifts: &[DVec2],
    [first, j]: [usize; 2],
    out: &mut [f32],
) {
    // Without closures in the loop: they are not inlined into kernels of other targets.
    let [nx, ny] = v.dims();
    let last = [(nx - 1) as f64, (ny - 1) as f64];
    let before_last = [nx.saturating_sub(2) as f64, ny.saturating_sub(2) as f64];
    let row = offsets.map(|offsets| offsets.row(j));
    for (part, out) in out.chunks_mut(AT_ONCE).enumerate() {
        let i = first + part * AT_ONCE;
        let mut moved = match &row {
            Some(row) => row.lanes(i),
            None => [[0.0; AT_ONCE]; 2],
        };
        if let Some(shifts) = shifts.get(part * AT_ONCE..) {
            for (k, shift) in shifts.iter().take(AT_ONCE).enumerate() {
                moved[0][k] += shift.x;
                moved[1][k] += shift.y;
            }
        }
        let (mut cells, mut places) = ([[0u32; AT_ONCE]; 2], [[0.0f32; AT_ONCE]; 2]);
        for axis in 0..2 {
            for k in 0..AT_ONCE {
                let pixel = if axis == 0 { i as f64 + k as f64 } else { j as f64 };
                let at = (pixel + moved[axis][k]).clamp(0.0, last[axis]);
                let cell = at.floor().min(before_last[axis]);
                // The last bits of such a sum are the whole number: other conversions are done one by one.
                cells[axis][k] = (cell + WHOLE).to_bits() as u32;
                places[axis][k] = (at - cell) as f32;
            }
        }
        let mut corners = [[[0.0f32; 2]; AT_ONCE]; 2];
        for k in 0..out.len() {
            let [i, j] = [cells[0][k] as usize, cells[1][k] as usize];
            let of = v.corners(i, j, usize::from(nx > 1), usize::from(ny > 1));
            corners[0][k] = [of[0], of[1]];
            corners[1][k] = [of[2], of[3]];
        }
        let mut some = [0.0; AT_ONCE];
        for k in 0..AT_ONCE {
            let (fx, fy) = (places[0][k], places[1][k]);
            let low = (1.0 - fx) * corners[0][k][0] + fx * corners[0][k][1];
            let high = (1.0 - fx) * corners[1][k][0] + fx * corners[1][k][1];
            some[k] = (1.0 - fy) * low + fy * high;
        }
        out.copy_from_slice(&some[..out.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::{bilinear, cell};

    #[test]
    fn values_are_those_where_pixels_have_moved() {
        for dims in [[2, 2], [37, 5], [64, 33]] {
            let [nx, ny] = dims;
            let values: Vec<f32> = (0..nx * ny).map(|n| (n as f32 * 0.7).sin() * 9.0).collect();
            let v = SparseImage::of(dims, &values);
            let far = |k: usize| DVec2::new((k as f64 * 0.9).sin() * 6.0, (k as f64 * 1.7).cos() * 5.0);
            let offsets = Displacement::zero(dims).map(|k, _, _| far(k));
            let shifts: Vec<DVec2> = (0..nx).map(|k| 0.3 * far(k + 7)).collect();
            for (first, j) in [(0, 0), (1, ny - 1), (nx / 3, ny / 2)] {
                let [mut along, mut beside] = [(); 2].map(|()| vec![0.0; nx - first]);
                read(&v, Some(&offsets), [first, j], &mut along);
                read_beside(&v, Some(&offsets), &shifts[..nx - first], [first, j], &mut beside);
                for k in 0..nx - first {
                    let x = DVec2::new((first + k) as f64, j as f64);
                    let at = |x: DVec2| {
                        let ([i, j], place) = cell(dims, x, 0);
                        bilinear(v.corners(i, j, 1, 1).map(f64::from), place)
                    };
                    let moved = x + offsets.at(x);
                    assert!((f64::from(along[k]) - at(moved)).abs() < 1e-4, "{dims:?} {first} {j} {k}");
                    assert!((f64::from(beside[k]) - at(moved + shifts[k])).abs() < 1e-4, "{dims:?} {first} {j} {k}");
                }
            }
        }
    }
}
