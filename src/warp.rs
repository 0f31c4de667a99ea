//! From the mid frame of an interval to the layers between its slices.

use crate::displacement::Displacement;
use crate::field::Field;
use crate::moving_field::{MovingField, Paths, plus};
use crate::spline::smoothstep;
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
            let way = way_to_middle(&moving.paths(i, end as f64), &middle);
            Field::from_fn(own.dims, |i, j| {
                let (x, v) = ([i as f64, j as f64], own.data[j * own.dims[0] + i]);
                if v.abs() < limit { v - seen.sample_smooth(plus(x, way.at(x), 1.0)) } else { 0.0 }
            })
        });
        Warp { moving, i, middle, lost, limit }
    }

    /// The layer at time `t` from its values in the mid frame, both clamped; where there is no trust in them `other` counts.
    pub fn layer(&self, seen: &Field, t: f64, trust: &Trust, other: &[f32]) -> Field {
        let paths = self.moving.paths(self.i, t);
        let [nx, ny] = seen.dims;
        let limit = self.limit;
        let w = smoothstep(t);
        let way = way_to_middle(&paths, &self.middle);
        let value = |x: [f64; 2]| {
            let middle = plus(x, way.at(x), 1.0);
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
                let values = corners.map(|c| c.map(|p| p as f64)).map(|x| seen.sample(plus(x, way.at(x), 1.0)));
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

/// From a layer's pixels to where their trajectories are in the mid frame: the mean of the ways over either slice.
fn way_to_middle(paths: &Paths, middle: &Paths) -> Displacement {
    paths.come.map(|x, _| {
        let a = middle.off_low(plus(x, paths.come.at(x), -1.0), x);
        let b = middle.off_high(plus(x, paths.go.at(x), 1.0), x);
        [0.5 * (a[0] + b[0]) - x[0], 0.5 * (a[1] + b[1]) - x[1]]
    })
}
