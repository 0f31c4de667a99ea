//! Distance field of a part of a contour.

use super::distance::sweep;
use crate::backend::jobs::PartJob;
use crate::grid::field::{FAR, Field};

/// Difference of distances, px: where an edge of another part is nearer by less than this, the whole contour's field still has a share in the value, px: pixels that are as
/// far from both would else go by rounding.
pub const BOTH: f64 = 0.5;

/// Signed distance to the part's edges, negative inside the part. Beside them and where the nearest edge of the whole contour belongs to the part,
/// the value of the whole contour's field stands bit for bit, so that parts that touch at a corner are together what they were, and fades out
/// where another is nearer; `inf` where the part is empty.
pub fn part_field(job: &PartJob, h: [f64; 2]) -> Field {
    if let Some(field) = job.without_computing() {
        return field;
    }
    let PartJob { whole, inside } = job;
    let far = Field::filled(whole.dims, FAR);
    let (mut own, mut other) = (far.clone(), far);
    let (mut own_fixed, mut other_fixed) = (vec![false; inside.len()], vec![false; inside.len()]);
    for node in 0..inside.len() {
        let edges = edges(whole, inside, node);
        for (kind, (field, fixed)) in
            [(&mut own, &mut own_fixed), (&mut other, &mut other_fixed)].into_iter().enumerate()
        {
            if edges[kind] {
                field.data[node] = whole.data[node].abs();
                fixed[node] = true;
            }
        }
    }
    rayon::join(|| sweep(&mut own, &own_fixed, h), || sweep(&mut other, &other_fixed, h));
    let data = (0..inside.len())
        .map(|k| {
            let same_side = (whole.data[k] < 0.0) == inside[k];
            let kept = if same_side { 1.0 - ((own.data[k] - other.data[k]) / BOTH).clamp(0.0, 1.0) } else { 0.0 };
            let distance = kept * whole.data[k].abs() + (1.0 - kept) * own.data[k];
            if inside[k] { -distance } else { distance }
        })
        .collect();
    Field { dims: whole.dims, data }
}

/// Whether the contour crosses an edge between a pixel and its neighbours that is the part's own, and one that is not.
fn edges(whole: &Field, inside: &[bool], node: usize) -> [bool; 2] {
    let [nx, ny] = whole.dims;
    let (i, j) = (node % nx, node / nx);
    let neighbours = [
        (i > 0).then(|| node - 1),
        (i + 1 < nx).then_some(node + 1),
        (j > 0).then(|| node - nx),
        (j + 1 < ny).then_some(node + nx),
    ];
    let mut found = [false; 2];
    for n in neighbours.into_iter().flatten() {
        if (whole.data[n] < 0.0) != (whole.data[node] < 0.0) {
            found[usize::from(inside[n] == inside[node])] = true;
        }
    }
    found
}
