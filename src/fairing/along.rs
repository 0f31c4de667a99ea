//! Layers read along trajectories.

use glam::DVec2;
use multiversion::multiversion;

use crate::grid::sparse_image::SparseImage;
use crate::registration::displacement::{BLOCK, Displacement};

/// Pixels that are read at once.
const AT_ONCE: usize = 4 * BLOCK;

/// Adds `w` times the values of a layer at the pixels of row `j` from `first` on, or where their trajectories are.
pub fn add(v: &SparseImage<f32>, w: f32, offsets: Option<&Displacement>, j: usize, first: usize, out: &mut [f32]) {
    for (first, out) in (first..).step_by(AT_ONCE).zip(out.chunks_mut(AT_ONCE)) {
        let mut some = [0.0; AT_ONCE];
        read(v, offsets, None, [first, j], out.len(), &mut some);
        out.iter_mut().zip(some).for_each(|(sum, v)| *sum += w * v);
    }
}

/// Values of a layer there once all have moved by `shifts`, px.
pub fn read_beside(
    v: &SparseImage<f32>,
    offsets: Option<&Displacement>,
    shifts: &[DVec2],
    [first, j]: [usize; 2],
    out: &mut [f32],
) {
    let stretches = (first..).step_by(AT_ONCE).zip(out.chunks_mut(AT_ONCE)).zip(shifts.chunks(AT_ONCE));
    for ((first, out), shifts) in stretches {
        let mut some = [0.0; AT_ONCE];
        read(v, offsets, Some(shifts), [first, j], out.len(), &mut some);
        out.copy_from_slice(&some[..out.len()]);
    }
}

/// Values of a layer at the first `count` pixels from one on, or where they have moved.
fn read(
    v: &SparseImage<f32>,
    offsets: Option<&Displacement>,
    shifts: Option<&[DVec2]>,
    [first, j]: [usize; 2],
    count: usize,
    out: &mut [f32; AT_ONCE],
) {
    if offsets.is_none() && shifts.is_none() {
        return v.read(first, j, &mut out[..count]);
    }
    let mut moved = [DVec2::ZERO; AT_ONCE];
    if let Some(offsets) = offsets {
        offsets.read_row(j, first, &mut moved[..count]);
    }
    moved.iter_mut().zip(shifts.unwrap_or_default()).for_each(|(moved, shift)| *moved += *shift);
    sample(v, [first, j], &moved, count, out);
}

/// Bilinear values of a layer at pixels of a row that have `moved`, of which the first is `origin`, the edge repeated.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn sample(v: &SparseImage<f32>, origin: [usize; 2], moved: &[DVec2; AT_ONCE], count: usize, out: &mut [f32; AT_ONCE]) {
    let [nx, ny] = v.dims();
    let last = [nx, ny].map(|n| (n - 1) as f64);
    let before_last = [nx, ny].map(|n| n.saturating_sub(2) as u32);
    let (mut cells, mut places) = ([[0u32; AT_ONCE]; 2], [[0.0f32; AT_ONCE]; 2]);
    for axis in 0..2 {
        for k in 0..AT_ONCE {
            let along = if axis == 0 { k as f64 } else { 0.0 };
            let at = (origin[axis] as f64 + along + moved[k][axis]).clamp(0.0, last[axis]);
            let cell = (at as u32).min(before_last[axis]);
            cells[axis][k] = cell;
            places[axis][k] = (at - f64::from(cell)) as f32;
        }
    }
    let mut corners = [[0.0f32; AT_ONCE]; 4];
    for k in 0..count {
        let [i, j] = [cells[0][k] as usize, cells[1][k] as usize];
        let of = v.corners(i, j, usize::from(nx > 1), usize::from(ny > 1));
        (0..4).for_each(|c| corners[c][k] = of[c]);
    }
    for k in 0..AT_ONCE {
        let (fx, fy) = (places[0][k], places[1][k]);
        let low = (1.0 - fx) * corners[0][k] + fx * corners[1][k];
        let high = (1.0 - fx) * corners[2][k] + fx * corners[3][k];
        out[k] = (1.0 - fy) * low + fy * high;
    }
}
