//! Parts of a slice that have no partner on the other one, and what an empty slice reads as.

use std::sync::Arc;

use glam::DVec2;

use crate::contour::Contour;
use crate::contour::caps::Cap;
use crate::grid::field::Field;
use crate::storage::spill::{Array, Large};

/// Smallest inradius of a part that is closed by itself where the other slice is not empty, px: that of a few pixels is what keeps their sign.
pub const LEAST_DEPTH: f64 = 1.0;

/// Parts of the two slices of an interval that have no partner, each with its own distance.
#[derive(Debug, Clone, Default)]
pub struct LoneParts {
    /// Parts of the lower slice.
    pub low: Vec<Cap>,
    /// Parts of the upper slice.
    pub high: Vec<Cap>,
    /// Whether one of the slices is empty: then there is nothing but these parts.
    pub empty: bool,
}

impl Large for LoneParts {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        self.low.iter_mut().chain(&mut self.high).map(|part| &mut part.field.data as Array<'_>).collect()
    }
}

/// Least value at time `t`, counted from their own slice, of the parts at node-space position `x` of it, where the slice's field is `a`. `None` off
/// their tiles.
#[inline]
pub fn closing(parts: &[&Cap], x: DVec2, a: f64, t: f64) -> Option<f64> {
    let value =
        |part: &&Cap| part.tile.holds(x, 0.0).then(|| part.field.sample(part.tile.to_local(x)).max(a) + part.offset(t));
    parts.iter().filter_map(value).reduce(f64::min)
}

/// An empty slice reads as the nearest contour beyond this many times its inradius.
const EMPTY_DEPTHS: f64 = 2.0;

/// Field that an empty slice reads as: its nearest contours drawn in by twice their inradius.
pub fn drawn_in(nearest: &[Arc<Contour>], dims: [usize; 2]) -> Field {
    let beyond = |contour: &Arc<Contour>| {
        let phi = &contour.phi;
        let depth = -phi.data.iter().copied().fold(0.0, f64::min);
        Field { dims: phi.dims, data: phi.data.iter().map(|v| v + EMPTY_DEPTHS * depth).collect() }
    };
    let nearer =
        |a: Field, b: Field| Field { dims: a.dims, data: a.data.iter().zip(&b.data).map(|(x, y)| x.min(*y)).collect() };
    nearest.iter().map(beyond).reduce(nearer).unwrap_or_else(|| Field::filled(dims, 1e3))
}
