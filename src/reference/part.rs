//! Distance field of a part of a contour.

use super::distance::sweep;
use crate::field::Field;
use crate::jobs::PartJob;

/// Where an edge of another part is nearer by less than this, the whole contour's field still has a share in the value, px: pixels that are as
/// far from both would else go by rounding.
pub const BOTH: f64 = 0.5;

/// Signed distance to the part's edges, negative inside the part. Where the nearest edge of the whole contour belongs to the part,
/// the value of the whole contour's field stands bit for bit, and fades out where another is nearer; `inf` where the part is empty.
pub fn part_field(job: &PartJob, h: [f64; 2]) -> Field {
    if let Some(field) = job.without_computing() {
        return field;
    }
    let PartJob { whole, inside } = job;
    let far = Field::filled(whole.dims, 1e30);
    let (mut own, mut other) = (far.clone(), far);
    let (mut own_fixed, mut other_fixed) = (vec![false; inside.len()], vec![false; inside.len()]);
    for node in 0..inside.len() {
        let edges = Edges::at(whole, inside, node, h);
        if edges.own.is_finite() {
            // Next to edges of both kinds the whole field may measure the wrong one.
            own.data[node] = if edges.other.is_finite() { edges.own } else { whole.data[node].abs() };
            own_fixed[node] = true;
        }
        if edges.other.is_finite() {
            other.data[node] = whole.data[node].abs();
            other_fixed[node] = true;
        }
    }
    sweep(&mut own, &own_fixed, h);
    sweep(&mut other, &other_fixed, h);
    let data = (0..inside.len())
        .map(|k| {
            let same_side = (whole.data[k] < 0.0) == inside[k];
            let keep = same_side && !(own_fixed[k] && other_fixed[k]);
            let kept = if keep { 1.0 - ((own.data[k] - other.data[k]) / BOTH).clamp(0.0, 1.0) } else { 0.0 };
            let distance = kept * whole.data[k].abs() + (1.0 - kept) * own.data[k];
            if inside[k] { -distance } else { distance }
        })
        .collect();
    Field { dims: whole.dims, data }
}

/// Distances from a pixel to the crossings on its four edges, by whether the part has them; `inf` where there are none.
struct Edges {
    own: f64,
    other: f64,
}

impl Edges {
    fn at(whole: &Field, inside: &[bool], node: usize, h: [f64; 2]) -> Self {
        let [nx, ny] = whole.dims;
        let (i, j) = (node % nx, node / nx);
        let c = whole.data[node];
        let mut inverse = [0.0; 2];
        for (axis, neighbours) in [
            (0, [(i > 0).then(|| node - 1), (i + 1 < nx).then_some(node + 1)]),
            (1, [(j > 0).then(|| node - nx), (j + 1 < ny).then_some(node + nx)]),
        ] {
            let mut nearest = [f64::INFINITY; 2];
            for n in neighbours.into_iter().flatten() {
                let v = whole.data[n];
                if (v < 0.0) != (c < 0.0) {
                    let kind = usize::from(inside[n] == inside[node]);
                    nearest[kind] = nearest[kind].min(h[axis] * c.abs() / (c.abs() + v.abs()));
                }
            }
            for (sum, d) in inverse.iter_mut().zip(nearest) {
                *sum += d.max(1e-6).powi(-2);
            }
        }
        let [own, other] = inverse.map(|s| 1.0 / s.sqrt());
        Edges { own, other }
    }
}
