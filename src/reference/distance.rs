//! Fast sweeping: signed distance to the zero set of a field (Zhao 2005), with sub-cell start values.

use std::ops::Range;

use crate::grid::field::{FAR, Field};
use crate::grid::stencil::Eikonal;

/// Rounds of four sweeps after which a field that still changes is an error in the scheme, not in the data.
const MAX_ROUNDS: usize = 64;

/// Change below which a value counts as settled, px.
const SETTLED: f64 = 1e-9;

/// Signed distance to the zero set of `u`, px, negative where `u < 0`; [`FAR`] where there is no contour at all.
///
/// Start values at pixels next to the contour: along each axis the linear crossing `d = |u| / (|u| + |u_n|)`, both axes combined as
/// `1 / d^2 = 1 / dx^2 + 1 / dy^2`. They stay fixed.
pub fn distance_of(u: &Field, h: [f64; 2]) -> Field {
    let [nx, ny] = u.dims;
    let mut d = Field::filled(u.dims, FAR);
    let mut fixed = vec![false; u.data.len()];
    for j in 0..ny {
        for i in 0..nx {
            let node = j * nx + i;
            let dx = nearest_crossing(u, node, [(i > 0).then(|| node - 1), (i + 1 < nx).then_some(node + 1)]) * h[0];
            let dy = nearest_crossing(u, node, [(j > 0).then(|| node - nx), (j + 1 < ny).then_some(node + nx)]) * h[1];
            if dx.is_finite() || dy.is_finite() {
                let (dx, dy) = (dx.max(1e-6), dy.max(1e-6));
                d.data[node] = 1.0 / (1.0 / (dx * dx) + 1.0 / (dy * dy)).sqrt();
                fixed[node] = true;
            }
        }
    }
    sweep(&mut d, &fixed, h);
    for (v, u) in d.data.iter_mut().zip(&u.data) {
        if *u < 0.0 {
            *v = -*v;
        }
    }
    d
}

/// Distance along one axis to the closer of two crossings, as a fraction of the pixel side; `inf` where there is none.
fn nearest_crossing(u: &Field, node: usize, neighbours: [Option<usize>; 2]) -> f64 {
    let c = u.data[node];
    neighbours
        .into_iter()
        .flatten()
        .map(|n| u.data[n])
        .filter(|v| (*v < 0.0) != (c < 0.0))
        .map(|v| c.abs() / (c.abs() + v.abs() + 1e-30))
        .fold(f64::INFINITY, f64::min)
}

/// Solves `|grad d| = 1` outwards from the fixed pixels: Gauss-Seidel in four directions, repeated until nothing changes.
///
/// Only the columns of a row are looked at again beside which something has changed: elsewhere nothing would.
pub fn sweep(d: &mut Field, fixed: &[bool], h: [f64; 2]) {
    let [nx, ny] = d.dims;
    let mut open = vec![0..nx; ny];
    let eikonal = Eikonal::new(h);
    for _ in 0..MAX_ROUNDS {
        let mut largest = 0.0f64;
        for (up, right) in [(true, true), (true, false), (false, true), (false, false)] {
            for row in 0..ny {
                let j = if up { row } else { ny - 1 - row };
                let columns = std::mem::take(&mut open[j]);
                if columns.is_empty() {
                    continue;
                }
                let (changed, change) = sweep_row(d, &fixed[j * nx..][..nx], eikonal, j, columns, right);
                if changed.is_empty() {
                    continue;
                }
                largest = largest.max(change);
                // Pixels ahead in the row have been looked at since.
                open[j] = if right {
                    changed.start.saturating_sub(1)..changed.end - 1
                } else {
                    changed.start + 1..(changed.end + 1).min(nx)
                };
                for beside in [j.wrapping_sub(1), j + 1] {
                    if let Some(columns) = open.get_mut(beside) {
                        widen(columns, &changed);
                    }
                }
            }
        }
        if largest < SETTLED {
            break;
        }
    }
}

/// Makes `columns` hold some more.
fn widen(columns: &mut Range<usize>, more: &Range<usize>) {
    *columns = match (*columns).is_empty() {
        true => more.clone(),
        false => columns.start.min(more.start)..columns.end.max(more.end),
    };
}

/// Sweeps columns of row `j`, and those ahead as far as they change, in one direction: between which of them something has changed, and by how
/// much at most.
fn sweep_row(
    d: &mut Field,
    fixed: &[bool],
    eikonal: Eikonal,
    j: usize,
    columns: Range<usize>,
    right: bool,
) -> (Range<usize>, f64) {
    let [nx, ny] = d.dims;
    let (before, rest) = d.data.split_at_mut(j * nx);
    let (row, after) = rest.split_at_mut(nx);
    let south = if j > 0 { &before[(j - 1) * nx..] } else { &[] };
    let north = if j + 1 < ny { &after[..nx] } else { &[] };
    let (mut changed, mut largest) = (0..0, 0.0f64);
    let mut changes = |i: usize| {
        if fixed[i] {
            return false;
        }
        let west = if i > 0 { row[i - 1] } else { FAR };
        let east = if i + 1 < nx { row[i + 1] } else { FAR };
        let beside = |row: &[f64]| row.get(i).copied().unwrap_or(FAR);
        let (a, b) = (west.min(east), beside(south).min(beside(north)));
        let old = row[i];
        if a.min(b) >= old {
            return false;
        }
        let new = eikonal.solve(a, b);
        if new < old {
            largest = largest.max(old - new);
            row[i] = new;
            widen(&mut changed, &(i..i + 1));
        }
        new < old
    };
    let Range { mut start, mut end } = columns;
    while start < end {
        if right {
            if changes(start) {
                end = end.max(start + 2).min(nx);
            }
            start += 1;
        } else {
            end -= 1;
            if changes(end) {
                start = start.min(end.saturating_sub(1));
            }
        }
    }
    (changed, largest)
}

/// Distance that counts as right: pixels this close to a contour keep what the sweep of the front made of them, px.
pub const TRUSTED: f64 = 3.0;

/// A field that is right within 3 px of its contour, continued outwards as a distance and clamped to `limit` px.
pub fn far_distance(phi: Field, h: [f64; 2], limit: f64) -> Field {
    let fixed: Vec<bool> = phi.data.iter().map(|v| v.abs() < TRUSTED).collect();
    let data = phi.data.iter().zip(&fixed).map(|(v, &f)| if f { v.abs() } else { limit }).collect();
    let mut d = Field { dims: phi.dims, data };
    sweep(&mut d, &fixed, h);
    let data = d.data.iter().zip(&phi.data).map(|(d, v)| d.copysign(*v)).collect();
    Field { dims: phi.dims, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_has_its_distances_up_to_the_edges() {
        for h in [[1.0, 1.0], [0.5, 1.0], [1.0, 0.4]] {
            for axis in 0..2 {
                let dims = [11, 9];
                for line in [0.3, 4.8, dims[axis] as f64 - 1.4] {
                    let wanted = Field::from_fn(dims, |i, j| h[axis] * ([i, j][axis] as f64 - line));
                    // Not a distance to begin with.
                    let bent = Field { dims, data: wanted.data.iter().map(|v| 3.0 * v).collect() };
                    let found = distance_of(&bent, h);
                    for (n, (v, w)) in found.data.iter().zip(&wanted.data).enumerate() {
                        assert!(
                            (v - w).abs() < 1e-9,
                            "{v}, not {w}, at node {n}; line {line} along {axis}, sides {h:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn without_a_contour_everything_is_far() {
        assert!(distance_of(&Field::filled([5, 4], -2.0), [1.0; 2]).data.iter().all(|v| *v == -FAR));
        assert!(distance_of(&Field::filled([5, 4], 2.0), [1.0; 2]).data.iter().all(|v| *v == FAR));
    }

    #[test]
    fn a_corner_has_both_axes_in_its_start_value() {
        // One pixel inside: its neighbours' crossings lie half way.
        let u = Field::from_fn([7, 7], |i, j| if (i, j) == (3, 3) { -1.0 } else { 1.0 });
        let d = distance_of(&u, [1.0; 2]);
        assert!((d.data[24] + 0.5 / 2.0f64.sqrt()).abs() < 1e-6, "{}", d.data[24]);
        assert!((d.data[25] - 0.5).abs() < 1e-6 && (d.data[17] - 0.5).abs() < 1e-6);
        // (v - 1/2)^2 + (v - 1/2)^2 = 1.
        assert!((d.data[32] - 0.5 - 0.5f64.sqrt()).abs() < 1e-6, "{}", d.data[32]);
    }
}
