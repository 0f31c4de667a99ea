//! Parts and holes of a slice that have no partner on the other one, and what an empty slice reads as.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec2;

use crate::contour::Contour;
use crate::contour::caps::Cap;
use crate::grid::field::Field;
use crate::storage::spill::{Array, Large};

/// Smallest inradius of a part that is closed by itself where the other slice is not empty, px: that of a few pixels is what keeps their sign.
pub const LEAST_DEPTH: f64 = 1.0;

/// Parts of the two slices of an interval that have no partner, each with its own distance, and holes below or above which the other slice has none.
#[derive(Debug, Clone, Default)]
pub struct LoneParts {
    /// Parts of the lower slice, then its holes.
    pub low: Vec<Cap>,
    /// The same of the upper slice.
    pub high: Vec<Cap>,
    /// Whether one of the slices is empty: then there is nothing but these parts.
    pub empty: bool,
}

impl Large for LoneParts {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        self.low.iter_mut().chain(&mut self.high).map(|part| &mut part.field.data as Array<'_>).collect()
    }
}

/// `value` united with the parts at time `t`, counted from their own slice, at node-space position `x` of it, and without its holes. The slice's field there
/// is `a`, which has no say in parts that are open.
#[inline]
pub fn closing(parts: &[&Cap], x: DVec2, a: f64, t: f64, value: f64) -> f64 {
    let there = parts.iter().filter(|part| part.tile.holds(x, 0.0));
    there.fold(value, |value, part| {
        let (own, a) = (part.field.sample(part.tile.to_local(x)), if part.hole { -a } else { a });
        let distance = if part.open { own } else { own.max(a) } + part.offset(t);
        if part.hole { value.max(-distance) } else { value.min(distance) }
    })
}

/// An empty slice reads as the nearest contour drawn in by this many times its inradius where no other contour says how the body falls, and by so many
/// at least where one does.
const EMPTY_DEPTHS: f64 = 2.0;
/// See [`EMPTY_DEPTHS`].
const LEAST_DEPTHS: f64 = 1.1;

/// A contour beside an empty slice.
pub struct Beside {
    /// The contour.
    pub contour: Arc<Contour>,
    /// What it is drawn in by there, see [`paraboloid`], px; 0 where nothing is known.
    pub falls: f64,
}

/// Field that an empty slice reads as: its nearest contours drawn in.
pub fn drawn_in(nearest: &[Beside], dims: [usize; 2]) -> Field {
    let beyond = |Beside { contour, falls }: &Beside| {
        let phi = &contour.phi;
        let depth = -phi.data.iter().copied().fold(0.0, f64::min);
        let by = if *falls > 0.0 { falls.max(LEAST_DEPTHS * depth) } else { EMPTY_DEPTHS * depth };
        Field { dims: phi.dims, data: phi.data.iter().map(|v| v + by).collect() }
    };
    let nearer =
        |a: Field, b: Field| Field { dims: a.dims, data: a.data.iter().zip(&b.data).map(|(x, y)| x.min(*y)).collect() };
    nearest.iter().map(beyond).reduce(nearer).unwrap_or_else(|| Field::filled(dims, 1e3))
}

/// Length that a body is drawn in by over a gap beyond its last contour, as its areas A there and B on the contour before say, whose radius falls by
/// `sqrt(B/pi) - sqrt(A/pi)` over the gap before: so far that its slope at the last contour is that of a paraboloid, of which areas are linear in the
/// height, `q = (1 + sqrt(B/A)) / 2` times the mean slope before it. The slope of [`value_curve`](super::value_curve) is this for the secants 1 and x,
/// `x / (1 + x) + (1 + x) / 4 = q`. 0 where nothing falls.
pub fn paraboloid([last, before]: [f64; 2], [gap, gap_before]: [f64; 2]) -> f64 {
    if last <= 0.0 || before <= last {
        return 0.0;
    }
    let fall = ((before / PI).sqrt() - (last / PI).sqrt()) / gap_before;
    let more = 0.5 * (1.0 + (before / last).sqrt()) - 1.0;
    let x = 2.0 * (more + (more * more + 1.0).sqrt()) - 1.0;
    x * fall * gap
}
