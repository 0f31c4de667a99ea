//! Slopes of the fields of a stack in its moving frame, along the trajectories.

use std::ops::Range;

use glam::DVec2;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::grid::field::Field;
use crate::grid::near_knots::{Gap, narrow, settled};
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

/// A gap that is not there.
const NONE: Gap = [0.0; 2];

/// Whether one of the gaps beside a slice between others is narrow beside the other.
fn unlike(moving: &MotionField, i: usize) -> bool {
    let [below, above] = [i - 1, i].map(|k| moving.gap(k));
    narrow(below, above).max(narrow(above, below)) > 0.0
}

fn slopes_of(moving: &MotionField, i: usize) -> Field {
    let last = moving.fields.len() - 1;
    let dims = moving.fields[i].dims;
    let mut slopes = Field::filled(dims, 0.0);
    let row = |(y, row): (usize, &mut [f64])| {
        if i == 0 || i == last {
            row.iter_mut().enumerate().for_each(|(x, m)| *m = end_slope(moving, i, DVec2::new(x as f64, y as f64)));
        } else if unlike(moving, i) {
            slopes_at_narrow_gap(moving, i, y, row);
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
    let of = |[nearer, next]: [Gap; 2]| {
        let lengths = [nearer, next].map(|[secant, gap]| [moving.px * secant, gap / moving.px]);
        let [[d0, h0], [d1, h1]] = settled(lengths, [NONE; 2], moving.doubt);
        three_point_end([h0, h1], [d0, d1]) / moving.px
    };
    match i {
        0 if last == 1 => secant_up(moving, 0, x),
        1 if last == 1 => secant_down(moving, 0, x),
        0 => {
            let next = secant_up(moving, 1, x + moving.at_slices[0][0].at(x));
            of([[secant_up(moving, 0, x), gap(0)], [next, gap(1)]])
        }
        _ => {
            let next = secant_down(moving, last - 2, x - moving.at_slices[last - 1][1].at(x));
            of([[secant_down(moving, last - 1, x), gap(last - 1)], [next, gap(last - 2)]])
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

/// The same where one gap is narrow beside the other.
fn slopes_at_narrow_gap(moving: &MotionField, i: usize, y: usize, row: &mut [f64]) {
    let px = moving.px;
    let [below, above] = [i - 1, i].map(|k| &moving.at_slices[k]);
    let farther = [i.checked_sub(2), Some(i + 1).filter(|k| *k < moving.at_slices.len())];
    let [hl, hr] = [i - 1, i].map(|k| moving.gap(k) / px);
    for (x, m) in row.iter_mut().enumerate() {
        let at = DVec2::new(x as f64, y as f64);
        let beside = [[px * secant_down(moving, i - 1, at), hl], [px * secant_up(moving, i, at), hr]];
        let beyond = [
            farther[0].map_or(NONE, |k| [px * secant_down(moving, k, at - below[1].at(at)), moving.gap(k) / px]),
            farther[1].map_or(NONE, |k| [px * secant_up(moving, k, at + above[0].at(at)), moving.gap(k) / px]),
        ];
        let [[l, hl], [r, hr]] = settled(beside, beyond, moving.doubt);
        *m = slope([l, r], [hl, hr], moving.relief) / px;
    }
}
