//! Layers of a stack in its moving frame: Hermite curves of the fields along the trajectories.

use glam::DVec2;
use multiversion::multiversion;

use crate::backend::requests::LayerRequest;
use crate::contour::caps::Cap;
use crate::grid::field::Field;
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::registration::cells::{CELL, cells_of_square, probed, probes};
use crate::registration::lone_parts::{LoneParts, closing};
use crate::registration::value_curve::between;

/// Distance from a cell's middle at which its pixels may read, px: distances change by a pixel per pixel, and the frame by less than half of that.
pub fn reach(h: [f64; 2]) -> f64 {
    0.75 * CELL as f64 * libm::hypot(h[0], h[1]) + 2.0
}

/// The layer at the `k`-th time of a request, px, clamped to its limit; a cell that is not wanted has the one value that its [`probes`] say.
pub fn layer(request: &LayerRequest<'_>, k: usize) -> SparseImage<f32> {
    let &LayerRequest { moving, interval: i, slopes, lone, times, limit, h, wanted } = request;
    let (t, wanted) = (times[k], wanted.map(|cells| &cells[k]));
    let paths = moving.paths(i, t);
    let (low, high) = (&moving.fields[i], &moving.fields[i + 1]);
    let dims = low.dims;
    let slopes = slopes.map(|field| &**field);
    let curves =
        Curves { fields: [low, high], slopes, empty: lone.empty, gap: moving.gap(i), relief: moving.relief, t, limit };
    let ends = |x: DVec2| (x - paths.come.at(x), x + paths.go.at(x));
    let (reach, around) = (reach(h), self::reach([1.0; 2]));
    let [out] = SparseImage::of_squares(dims, |square, [out]| {
        let mut parts = Parts::default();
        for [left, top] in cells_of_square(square, dims) {
            let [width, height] = [CELL.min(dims[0] - left), CELL.min(dims[1] - top)];
            let first = DVec2::new(left as f64, top as f64);
            let (from, to) = ends(first + 0.5 * DVec2::new((width - 1) as f64, (height - 1) as f64));
            let (a, b) = (low.sample(from), high.sample(to));
            let nearest = a.abs().min(b.abs()) - 0.05 * (a - b).abs();
            let far = (a < 0.0) == (b < 0.0) && nearest > limit + reach;
            parts.choose(lone, from, to, around);
            let rows = (top..top + height).map(|y| (y, y % SQUARE * SQUARE + left % SQUARE));
            let one = if far {
                Some(limit.copysign(a) as f32)
            } else if wanted.is_some_and(|cells| !cells.at(left, top)) {
                let value = |[x, y]: [usize; 2]| curves.value(&parts, ends(DVec2::new(x as f64, y as f64))) as f32;
                Some(probed(probes([left, top], [left + width - 1, top + height - 1]).map(value), limit as f32))
            } else {
                None
            };
            if let Some(v) = one {
                rows.for_each(|(_, at)| out[at..at + width].fill(v));
                continue;
            }
            let [mut come, mut go] = [[DVec2::ZERO; CELL]; 2];
            for (y, at) in rows {
                paths.come.read_row(y, left, &mut come);
                paths.go.read_row(y, left, &mut go);
                values(&curves, &parts, [left, y], &come, &go, &mut out[at..at + width]);
            }
        }
        [None]
    });
    out
}

/// Hermite curves of the fields of an interval's two slices, and the time at which they are read.
struct Curves<'a> {
    fields: [&'a Field; 2],
    slopes: [&'a Field; 2],
    /// One of the slices is empty.
    empty: bool,
    gap: f64,
    relief: f64,
    t: f64,
    limit: f64,
}

/// The lone parts of either slice that a cell's pixels may read.
#[derive(Default)]
struct Parts<'a> {
    low: Vec<&'a Cap>,
    high: Vec<&'a Cap>,
}

impl<'a> Parts<'a> {
    /// Chooses the parts no farther than `around` from where the cell's middle comes from and goes to.
    fn choose(&mut self, lone: &'a LoneParts, from: DVec2, to: DVec2, around: f64) {
        for (near, all, x) in [(&mut self.low, &lone.low, from), (&mut self.high, &lone.high, to)] {
            near.clear();
            near.extend(all.iter().filter(|part| part.tile.holds(x, around)));
        }
    }
}

impl Curves<'_> {
    /// Value on the trajectory between a position of the lower and one of the upper slice.
    #[inline(always)]
    fn value(&self, parts: &Parts<'_>, (from, to): (DVec2, DVec2)) -> f64 {
        let (a, b) = (self.fields[0].sample_smooth(from), self.fields[1].sample_smooth(to));
        let m = [self.gap * self.slopes[0].sample(from), self.gap * self.slopes[1].sample(to)];
        let joined = match self.empty {
            true => self.limit,
            false => between([a, b], m, self.relief, self.t),
        };
        let low = closing(&parts.low, from, a, self.t, joined);
        closing(&parts.high, to, b, 1.0 - self.t, low).clamp(-self.limit, self.limit)
    }
}

/// Values at pixels of a row from `first` on, by where they come from and go to.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn values(
    curves: &Curves<'_>,
    parts: &Parts<'_>,
    first: [usize; 2],
    come: &[DVec2; CELL],
    go: &[DVec2; CELL],
    row: &mut [f32],
) {
    for (k, v) in row.iter_mut().enumerate() {
        let x = DVec2::new((first[0] + k) as f64, first[1] as f64);
        *v = curves.value(parts, (x - come[k], x + go[k])) as f32;
    }
}
