//! Slopes of the fields of a stack in its moving frame, along the trajectories.

use std::ops::Range;

use glam::DVec2;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::grid::field::Field;
use crate::grid::spline::three_point_end;
use crate::registration::motion_field::MotionField;
use crate::registration::value_curve::slope;

/// Slopes of the fields at the `wanted` slices, per height: see [`slope`], secants taken along the trajectories; at the ends the three-point
/// formula.
pub fn slopes(moving: &MotionField, wanted: Range<usize>) -> Vec<Field> {
    wanted.into_par_iter().map(|i| slopes_of(moving, i)).collect()
}

/// Secant of interval `i` at a position of its lower slice.
fn secant_up(moving: &MotionField, i: usize, x: DVec2) -> f64 {
    let there = moving.fields[i + 1].sample(x + moving.at_slices[i][0].at(x));
    (there - moving.fields[i].sample(x)) / moving.gap(i)
}

/// Secant of interval `i` at a position of its upper slice.
fn secant_down(moving: &MotionField, i: usize, x: DVec2) -> f64 {
    let there = moving.fields[i].sample(x - moving.at_slices[i][1].at(x));
    (moving.fields[i + 1].sample(x) - there) / moving.gap(i)
}

fn slopes_of(moving: &MotionField, i: usize) -> Field {
    let last = moving.fields.len() - 1;
    let dims = moving.fields[i].dims;
    let mut slopes = Field::filled(dims, 0.0);
    let row = |(y, row): (usize, &mut [f64])| {
        if i == 0 || i == last {
            row.iter_mut().enumerate().for_each(|(x, m)| *m = end_slope(moving, i, DVec2::new(x as f64, y as f64)));
        } else {
            inner_slopes(moving, i, y, row);
        }
    };
    slopes.data.par_chunks_mut(dims[0]).enumerate().for_each(row);
    slopes
}

/// Slope at a position of the first or the last slice.
fn end_slope(moving: &MotionField, i: usize, x: DVec2) -> f64 {
    let last = moving.fields.len() - 1;
    let gap = |k: usize| moving.gap(k);
    match i {
        0 if last == 1 => secant_up(moving, 0, x),
        1 if last == 1 => secant_down(moving, 0, x),
        0 => {
            let next = secant_up(moving, 1, x + moving.at_slices[0][0].at(x));
            three_point_end([gap(0), gap(1)], [secant_up(moving, 0, x), next])
        }
        _ => {
            let next = secant_down(moving, last - 2, x - moving.at_slices[last - 1][1].at(x));
            three_point_end([gap(last - 1), gap(last - 2)], [secant_down(moving, last - 1, x), next])
        }
    }
}

/// Slopes at the pixels of row `y` of a slice between others.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn inner_slopes(moving: &MotionField, i: usize, y: usize, row: &mut [f64]) {
    let [below, here, above] = [i - 1, i, i + 1].map(|k| &moving.fields[k]);
    let px = moving.px;
    let [hl, hr] = [i - 1, i].map(|k| moving.gap(k) / px);
    let mut moved = [(); 2].map(|()| vec![DVec2::ZERO; row.len()]);
    moving.at_slices[i - 1][1].read_row(y, 0, &mut moved[0]);
    moving.at_slices[i][0].read_row(y, 0, &mut moved[1]);
    let own = &here.data[y * row.len()..];
    for (x, (m, own)) in row.iter_mut().zip(own).enumerate() {
        let at = DVec2::new(x as f64, y as f64);
        let l = (own - below.sample(at - moved[0][x])) / hl;
        let r = (above.sample(at + moved[1][x]) - own) / hr;
        *m = slope([l, r], [hl, hr], moving.relief) / px;
    }
}
