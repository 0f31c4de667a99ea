//! From the mid frame of an interval to the layers between its slices.

use crate::field::Field;
use crate::moving_field::{MovingField, Paths, plus};
use crate::trust::Trust;

/// Side of the cells that are skipped where the mid frame's layer is far from any contour, px.
const CELL: usize = 8;

/// Brings layers of interval `i` from its mid frame to where they belong.
pub struct Warp<'m> {
    moving: &'m MovingField,
    i: usize,
    middle: Paths,
    /// What the way to the mid frame and back takes from either slice, px.
    lost: [Field; 2],
    limit: f64,
}

impl<'m> Warp<'m> {
    /// For an interval whose slices are `low` and `high`, as they are and as the mid frame sees them; distances count up to `limit` px.
    pub fn new(moving: &'m MovingField, i: usize, slices: [(&Field, &Field); 2], limit: f64) -> Self {
        let middle = moving.paths(i, 0.5);
        let lost = [0, 1].map(|end| {
            let (own, seen) = slices[end];
            let paths = moving.paths(i, end as f64);
            Field::from_fn(own.dims, |x, y| {
                let x = [x as f64, y as f64];
                let v = own.data[x[1] as usize * own.dims[0] + x[0] as usize];
                if v.abs() < limit { v - seen.sample_smooth(to_middle(x, &paths, &middle)) } else { 0.0 }
            })
        });
        Warp { moving, i, middle, lost, limit }
    }

    /// The layer at time `t` from its values in the mid frame, both clamped; where there is no trust in them `other` counts.
    pub fn layer(&self, seen: &Field, t: f64, trust: &Trust, other: &[f32]) -> Field {
        let paths = self.moving.paths(self.i, t);
        let [nx, ny] = seen.dims;
        let limit = self.limit;
        let w = t * t * (3.0 - 2.0 * t);
        let value = |x: [f64; 2]| {
            let middle = to_middle(x, &paths, &self.middle);
            let v = seen.sample_smooth(middle);
            let (come, go) = (paths.come.at(x), paths.go.at(x));
            let low = self.lost[0].sample([x[0] - come[0], x[1] - come[1]]);
            let high = self.lost[1].sample([x[0] + go[0], x[1] + go[1]]);
            let trust = trust.at(middle);
            let other = f64::from(other[x[1] as usize * nx + x[0] as usize]);
            (trust * (v + (1.0 - w) * low + w * high) + (1.0 - trust) * other).clamp(-limit, limit)
        };
        let mut out = Field::filled(seen.dims, limit);
        for top in (0..ny).step_by(CELL) {
            for left in (0..nx).step_by(CELL) {
                let (right, bottom) = ((left + CELL).min(nx) - 1, (top + CELL).min(ny) - 1);
                let corners = [
                    [left, top],
                    [right, top],
                    [left, bottom],
                    [right, bottom],
                    [left.midpoint(right), top.midpoint(bottom)],
                ];
                let values = corners.map(|c| seen.sample(to_middle(c.map(|p| p as f64), &paths, &self.middle)));
                let others = corners.map(|[x, y]| f64::from(other[y * nx + x]));
                let all = || values.iter().chain(&others);
                let far = all().all(|v| *v >= limit) || all().all(|v| *v <= -limit);
                for y in top..=bottom {
                    for x in left..=right {
                        out.data[y * nx + x] = if far { values[0] } else { value([x as f64, y as f64]) };
                    }
                }
            }
        }
        out
    }
}

/// Where the trajectory through `x` of a layer is in the mid frame: the mean of the ways over either slice.
fn to_middle(x: [f64; 2], paths: &Paths, middle: &Paths) -> [f64; 2] {
    let (come, go) = (paths.come.at(x), paths.go.at(x));
    let a = middle.off_low(plus(x, come, -1.0), x);
    let b = middle.off_high(plus(x, go, 1.0), x);
    [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
}
