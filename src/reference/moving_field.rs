//! Slopes and layers of a stack in its moving frame: Hermite curves of the fields along the trajectories.

use std::ops::Range;

use rayon::prelude::*;

use crate::field::Field;
use crate::moving_field::{CELL, Cells, LoneParts, MovingField, between, closing, plus, probes};
use crate::spline::{harmonic, limited, three_point_end};

/// Slopes of the fields at the `wanted` slices, per height: the mean of PCHIP and of Catmull-Rom limited to three times the smaller secant, secants
/// taken along the trajectories; at the ends the three-point formula.
pub fn slopes(moving: &MovingField, wanted: Range<usize>) -> Vec<Field> {
    wanted.into_par_iter().map(|i| slopes_of(moving, i)).collect()
}

/// Secant of interval `i` at a position of its lower slice.
fn secant_up(moving: &MovingField, i: usize, x: [f64; 2]) -> f64 {
    let u = moving.at_slices[i][0].at(x);
    let there = moving.fields[i + 1].sample([x[0] + u[0], x[1] + u[1]]);
    (there - moving.fields[i].sample(x)) / moving.gap(i)
}

/// Secant of interval `i` at a position of its upper slice.
fn secant_down(moving: &MovingField, i: usize, x: [f64; 2]) -> f64 {
    let u = moving.at_slices[i][1].at(x);
    let there = moving.fields[i].sample([x[0] - u[0], x[1] - u[1]]);
    (moving.fields[i + 1].sample(x) - there) / moving.gap(i)
}

fn slopes_of(moving: &MovingField, i: usize) -> Field {
    let last = moving.fields.len() - 1;
    let gap = |k: usize| moving.gap(k);
    let slope = |x: [f64; 2]| match i {
        0 if last == 1 => secant_up(moving, 0, x),
        1 if last == 1 => secant_down(moving, 0, x),
        0 => {
            let u = moving.at_slices[0][0].at(x);
            let next = secant_up(moving, 1, [x[0] + u[0], x[1] + u[1]]);
            three_point_end([gap(0), gap(1)], [secant_up(moving, 0, x), next])
        }
        _ if i == last => {
            let u = moving.at_slices[last - 1][1].at(x);
            let next = secant_down(moving, last - 2, [x[0] - u[0], x[1] - u[1]]);
            three_point_end([gap(last - 1), gap(last - 2)], [secant_down(moving, last - 1, x), next])
        }
        _ => {
            let (l, r) = (secant_down(moving, i - 1, x), secant_up(moving, i, x));
            let (hl, hr) = (gap(i - 1), gap(i));
            0.5 * (harmonic(l, r, hl, hr) + limited((hr * l + hl * r) / (hl + hr), l, r))
        }
    };
    let dims = moving.fields[i].dims;
    let mut slopes = Field::filled(dims, 0.0);
    let row = |(y, row): (usize, &mut [f64])| {
        row.iter_mut().enumerate().for_each(|(x, m)| *m = slope([x as f64, y as f64]));
    };
    slopes.data.par_chunks_mut(dims[0]).enumerate().for_each(row);
    slopes
}

/// How far from a cell's middle its pixels may read, px: distances change by a pixel per pixel, and the frame by less than half of that.
pub fn reach(h: [f64; 2]) -> f64 {
    0.75 * CELL as f64 * h[0].hypot(h[1]) + 2.0
}

/// The layer at time `t` of interval `i`, px, clamped to `limit`; in cells that are not `wanted` only at their [`probes`].
#[expect(clippy::too_many_arguments, reason = "one stage reads what all stages before it have made")]
pub fn layer(
    moving: &MovingField,
    slopes: [&Field; 2],
    lone: &LoneParts,
    i: usize,
    t: f64,
    limit: f64,
    h: [f64; 2],
    wanted: Option<&Cells>,
) -> Vec<f32> {
    let paths = moving.paths(i, t);
    let (low, high) = (&moving.fields[i], &moving.fields[i + 1]);
    let [nx, ny] = low.dims;
    let gap = moving.gap(i);
    let ends = |x: [f64; 2], p: [f64; 2], q: [f64; 2]| (plus(x, p, -1.0), plus(x, q, 1.0));
    let value = |(from, to): ([f64; 2], [f64; 2])| {
        let (mut a, mut b) = (low.sample_smooth(from), high.sample_smooth(to));
        let mut m = [gap * slopes[0].sample(from), gap * slopes[1].sample(to)];
        if let Some(own) = closing(&lone.low, from).filter(|&own| own < b) {
            (b, m) = (own, [own - a; 2]);
        }
        if let Some(own) = closing(&lone.high, to).filter(|&own| own < a) {
            (a, m) = (own, [b - own; 2]);
        }
        between([a, b], m, gap / moving.px, t).clamp(-limit, limit)
    };
    let mut out = vec![0.0; nx * ny];
    let reach = reach(h);
    out.par_chunks_mut(nx * CELL).enumerate().for_each(|(cell, rows)| {
        let cell_y = cell * CELL;
        for cell_x in (0..nx).step_by(CELL) {
            let (width, height) = (CELL.min(nx - cell_x), CELL.min(ny - cell_y));
            let middle = [(cell_x as f64) + 0.5 * (width - 1) as f64, (cell_y as f64) + 0.5 * (height - 1) as f64];
            let (from, to) = ends(middle, paths.come.at(middle), paths.go.at(middle));
            let (a, b) = (low.sample(from), high.sample(to));
            let nearest = a.abs().min(b.abs()) - 0.05 * (a - b).abs();
            let far = (a < 0.0) == (b < 0.0) && nearest > limit + reach;
            if wanted.is_some_and(|cells| !cells.at(cell_x, cell_y)) {
                for [x, y] in probes([cell_x, cell_y], [cell_x + width - 1, cell_y + height - 1]) {
                    let at = [x as f64, y as f64];
                    let near = || value(ends(at, paths.come.at(at), paths.go.at(at)));
                    rows[(y - cell_y) * nx + x] = if far { limit.copysign(a) } else { near() } as f32;
                }
                continue;
            }
            let (mut come, mut go) = ([[0.0; 2]; CELL], [[0.0; 2]; CELL]);
            for y in cell_y..cell_y + height {
                let row = &mut rows[(y - cell_y) * nx + cell_x..][..width];
                if far {
                    row.fill(limit.copysign(a) as f32);
                    continue;
                }
                paths.come.read_row(y, cell_x, &mut come);
                paths.go.read_row(y, cell_x, &mut go);
                for (k, v) in row.iter_mut().enumerate() {
                    *v = value(ends([(cell_x + k) as f64, y as f64], come[k], go[k])) as f32;
                }
            }
        }
    });
    out
}
