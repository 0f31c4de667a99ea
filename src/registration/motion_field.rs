//! A stack in a smooth moving frame: fields of all slices, displacements between them, and what follows from both.
//!
//! A point of the lower slice of an interval moves along `x + p(t)`, with `p(0) = 0`, `p(1) = u` and the rates K at the slices, so that
//! motion too is C1 across contours: `p(t) = t u + (h K_i - u)(t^3 - 2 t^2 + t) + (h K_{i+1} - u)(t^3 - t^2)`.

use std::cmp::Ordering;
use std::sync::Arc;

use glam::DVec2;

use crate::contour::Contour;
use crate::contour::caps::Cap;
use crate::grid::field::Field;
use crate::grid::sparse_image::SQUARE;
use crate::grid::spline::{harmonic, hermite_values, limited, smoothstep, van_albada};
use crate::registration::displacement::{self, Displacement, LANES, Lanes, Resting};
use crate::storage::spill::{Array, Large};

/// Share of `4 t^2 (1 - t)^2 |A - B|` taken off of what is no relief: what interpolated distances shrink by systematically.
pub const SHRINKING: f64 = 0.2;

/// Smallest inradius of a part that is closed by itself where the other slice is not empty, px: that of a few pixels is what keeps their sign.
pub const LEAST_DEPTH: f64 = 1.0;

/// Surfaces that go sideways by more than this per height are less upright, those that go by more than FLAT not at all.
pub const STEEP: f64 = 1.5;
/// See [`STEEP`].
pub const FLAT: f64 = 4.0;

/// Side of the cells that are skipped where no contour can be, px.
pub const CELL: usize = 8;

/// Fixed-point passes that find where a trajectory is on a layer, from where it is on the slice.
pub const PASSES: usize = 4;

/// Steps of times and gaps.
pub const STEPS: f64 = (1u64 << 30) as f64;

/// Slices and displacements.
#[derive(Debug, Clone)]
pub struct MotionField {
    /// Heights of the slices, increasing.
    pub heights: Vec<f64>,
    /// Gaps between them, see [`even_gaps`].
    pub gaps: Vec<f64>,
    /// Length of a pixel's larger side in the unit of the heights.
    pub px: f64,
    /// Degree to which the whole stack is relief, see [`crate::stack::change`].
    pub relief: f64,
    /// Signed distances, px; finite everywhere.
    pub fields: Vec<Arc<Field>>,
    /// Mid-frame displacement of each interval.
    pub displacements: Vec<Arc<Displacement>>,
    /// Displacements read at the pixels of the interval's lower and upper slice.
    pub at_slices: Vec<Arc<[Displacement; 2]>>,
    /// Rate of motion at each slice, px of the image per height.
    pub rates: Vec<Arc<Displacement>>,
    /// Rates at the slices of each interval of the trajectories through its mid frame, see [`through_middle`].
    pub through_middle: Vec<Arc<[Displacement; 2]>>,
}

/// Rates at the lower and the upper slice of an interval, px of the image per interval, of the trajectories through the nodes of its mid frame:
/// `v` is its displacement, `gap` its height, `rates` are those at the slices.
pub fn through_middle(v: &Displacement, gap: f64, rates: [&Displacement; 2]) -> [Displacement; 2] {
    let of = |rate: &Displacement, half: f64| {
        v.map_lanes(|_, x, u| {
            let slice = |a: usize| std::array::from_fn(|k| x[a][k] + half * u[a][k]);
            rate.at_lanes(&[slice(0), slice(1)]).map(|along| along.map(|r| gap * r))
        })
    };
    [of(rates[0], -0.5), of(rates[1], 0.5)]
}

/// Rate of motion at a slice, px of the image per height, from the displacements (at the slices) and gaps of the intervals below and above
/// it, of which there is at least one.
pub fn rate(below: Option<(&[Displacement; 2], f64)>, above: Option<(&[Displacement; 2], f64)>) -> Displacement {
    let alone = |v: &Displacement, gap: f64| v.map(|_, _, u| u / gap);
    match (below, above) {
        (Some((below, h0)), Some((above, h1))) => {
            let (before, after) = (&below[1], &above[0]);
            let along = |b: f64, a: f64| harmonic(b / h0, a / h1, h0, h1);
            let both = before.vectors.iter().zip(&after.vectors);
            before.with(both.map(|(b, a)| DVec2::new(along(b.x, a.x), along(b.y, a.y))).collect())
        }
        (None, Some((above, gap))) => alone(&above[0], gap),
        (Some((below, gap)), None) => alone(&below[1], gap),
        (None, None) => Displacement::zero([0; 2]),
    }
}

/// Paths of the points of a layer: where they come from and go to.
#[derive(Debug, Clone)]
pub struct Paths {
    /// Displacement from the lower slice to the layer.
    pub come: Displacement,
    /// Displacement from the layer to the upper slice.
    pub go: Displacement,
}

impl MotionField {
    /// The moving field that follows from fields and displacements of a stack that is no relief.
    pub fn new(heights: Vec<f64>, px: f64, fields: Vec<Arc<Field>>, displacements: Vec<Displacement>) -> Self {
        let gaps = even_gaps(&heights);
        let at_slices: Vec<Arc<[Displacement; 2]>> = displacements.iter().map(|v| Arc::new(v.at_slices())).collect();
        let beside = |i: usize| Some((&*at_slices[i], gaps[i]));
        let rate = |i: usize| {
            let below = i.checked_sub(1).and_then(beside);
            rate(below, if i < gaps.len() { beside(i) } else { None })
        };
        let rates: Vec<Arc<Displacement>> = (0..heights.len()).map(|i| Arc::new(rate(i))).collect();
        let through = |(i, v): (usize, &Displacement)| Arc::new(through_middle(v, gaps[i], [&rates[i], &rates[i + 1]]));
        let through_middle = displacements.iter().enumerate().map(through).collect();
        let displacements = displacements.into_iter().map(Arc::new).collect();
        MotionField { heights, gaps, px, relief: 0.0, fields, displacements, at_slices, rates, through_middle }
    }

    /// Gap of an interval.
    pub fn gap(&self, i: usize) -> f64 {
        self.gaps[i]
    }

    /// Paths through the layer at time `t` of interval `i`. The trajectory through `m` in the mid frame starts at `m - u/2` and is at
    /// `m - u/2 + p(t)` on the layer: which one passes through a node is found by fixed-point passes.
    pub fn paths(&self, i: usize, t: f64) -> Paths {
        let (v, [low, high]) = (&*self.displacements[i], &*self.through_middle[i]);
        let way = |u: f64, low: f64, high: f64| curve(t, u, [low, high]) - 0.5 * u;
        let mut off = v.with(Vec::with_capacity(v.vectors.len()));
        for (u, (low, high)) in v.vectors.iter().zip(low.vectors.iter().zip(&high.vectors)) {
            off.vectors.push(DVec2::new(way(u.x, low.x, high.x), way(u.y, low.y, high.y)));
        }
        let middle = off.map_lanes(|_, x, first| {
            let back = |off: &Lanes| [0, 1].map(|a| std::array::from_fn(|k| x[a][k] - off[a][k]));
            back(&(1..displacement::PASSES).fold(*first, |found, _| off.at_lanes(&back(&found))))
        });
        let mut come = middle.map_lanes(|_, _, m| off.at_lanes(m));
        let mut go = middle.map_lanes(|_, _, m| v.at_lanes(m));
        // Halves are exact: at the slices themselves nothing is left.
        for (come, go) in come.vectors.iter_mut().zip(&mut go.vectors) {
            *come += 0.5 * *go;
            *go -= *come;
        }
        Paths { come, go }
    }

    /// `p(t)` in interval `i` with displacement `u` and the rates of node `k` of the slices.
    #[inline]
    fn along(&self, i: usize, t: f64, k: usize, u: DVec2) -> DVec2 {
        let [low, high] = [i, i + 1].map(|slice| self.gap(i) * self.rates[slice].vectors[k]);
        DVec2::new(curve(t, u.x, [low.x, high.x]), curve(t, u.y, [low.y, high.y]))
    }
}

/// `p(t)` with displacement `u` and rates per interval.
#[inline(always)]
fn curve(t: f64, u: f64, [low, high]: [f64; 2]) -> f64 {
    let [first, second] = [t * (t - 1.0) * (t - 1.0), t * t * (t - 1.0)];
    t * u + (low - u) * first + (high - u) * second
}

/// A layer's place in the stack.
#[derive(Debug, Clone)]
pub struct Place {
    /// Its interval; a contour's layer belongs to the interval above it.
    pub interval: usize,
    /// Time in it.
    pub t: f64,
    /// Displacements from the interval's lower and upper slice to the layer.
    pub off: [Resting; 2],
    /// The interval's displacement at its slices.
    pub at_slices: Arc<[Resting; 2]>,
}

impl MotionField {
    /// The ways back of `paths`, which are those through the layer at time `t` of interval `i`: from either slice to the layer.
    pub fn off_slices(&self, i: usize, t: f64, paths: &Paths) -> [Displacement; 2] {
        let [low, high] = &*self.at_slices[i];
        // What the nodes at the slices say themselves is near enough for half of the passes.
        let off = |slice: &Displacement, way: &Displacement, sign: f64, whole: f64| {
            slice.map_lanes(|first, x, u| {
                let mut off = *u;
                for k in 0..LANES.min(slice.vectors.len() - first) {
                    let u = DVec2::new(u[0][k], u[1][k]);
                    (off[0][k], off[1][k]) = (self.along(i, t, first + k, u) - whole * u).into();
                }
                for _ in 0..PASSES / 2 {
                    let there = way.at_lanes(&[0, 1].map(|a| std::array::from_fn(|k| x[a][k] + off[a][k])));
                    off = there.map(|along| along.map(|v| sign * v));
                }
                off
            })
        };
        rayon::join(|| off(low, &paths.come, 1.0, 0.0), || off(high, &paths.go, -1.0, 1.0)).into()
    }
}

impl Place {
    /// The place at time `t` of interval `i` of `moving`, which is number `interval` of the stack, and the paths through it. What it shares
    /// with another place of the interval is taken from there.
    pub fn new(moving: &MotionField, i: usize, interval: usize, t: f64, known: Option<&Place>) -> (Self, Paths) {
        let paths = moving.paths(i, t);
        let off = moving.off_slices(i, t, &paths).each_ref().map(Resting::from);
        let at_slices = match known {
            Some(place) => place.at_slices.clone(),
            None => Arc::new(moving.at_slices[i].each_ref().map(Resting::from)),
        };
        (Place { interval, t, off, at_slices }, paths)
    }

    /// Place on another layer of the trajectory that meets the slices around this layer at `[below, above]`. Within an interval the way over
    /// the lower slice passes smoothly into that over the upper one, so that it is C1 at the slices, and the same upside down. `between` are
    /// the displacements at the slices of the intervals between both, lowest first.
    pub fn carry(&self, [below, above]: [DVec2; 2], to: &Place, between: &[&[Resting; 2]]) -> DVec2 {
        let off = |end: usize, slice: DVec2| slice + to.off[end].at(slice);
        match self.interval.cmp(&to.interval) {
            // To a slice there is one way, as from the interval on its other side.
            Ordering::Equal if to.t == 0.0 => below,
            Ordering::Equal if to.t == 1.0 => above,
            Ordering::Equal => {
                let ([a, b], w) = ([off(0, below), off(1, above)], smoothstep(self.t));
                smoothstep(1.0 - self.t) * a + w * b
            }
            // A slice beyond is reached from slice to slice alone: it lies in the interval above it or, upside down, in that below.
            Ordering::Less => {
                let step = |x: DVec2, v: &[Resting; 2]| x + v[0].at(x);
                let slice = between.iter().fold(above, |x, v| step(x, v));
                if to.t == 1.0 { step(slice, &to.at_slices) } else { off(0, slice) }
            }
            Ordering::Greater => {
                let step = |x: DVec2, v: &[Resting; 2]| x - v[1].at(x);
                let slice = between.iter().rev().fold(below, |x, v| step(x, v));
                if to.t == 0.0 { step(slice, &to.at_slices) } else { off(1, slice) }
            }
        }
    }
}

impl Paths {
    /// Points at which the trajectory through a point of this layer meets the slices below and above it, px of the padded image.
    pub fn to_slices(&self, x: DVec2) -> [DVec2; 2] {
        [x - self.come.at(x), x + self.go.at(x)]
    }

    /// Place on this layer of the trajectory that starts at `slice` on the lower slice, by fixed-point passes from a first guess.
    pub fn off_low(&self, slice: DVec2, guess: DVec2, passes: usize) -> DVec2 {
        (0..passes).fold(guess, |y, _| slice + self.come.at(y))
    }

    /// Place on this layer of the trajectory that ends at `slice` on the upper slice.
    pub fn off_high(&self, slice: DVec2, guess: DVec2, passes: usize) -> DVec2 {
        (0..passes).fold(guess, |y, _| slice - self.go.at(y))
    }
}

/// Gaps between heights in steps of 2^-30 of the whole: a stack and the same upside down then have the very same gaps, whichever way their
/// heights were rounded.
pub fn even_gaps(heights: &[f64]) -> Vec<f64> {
    const BITS: u64 = 20;
    let span = heights[heights.len() - 1] - heights[0];
    // The span's own last bits are rounded off too.
    let span = f64::from_bits((span.to_bits() + (1 << (BITS - 1))) >> BITS << BITS);
    let unit = span / STEPS;
    heights.windows(2).map(|w| ((w[1] - w[0]) / unit).round().max(1.0) * unit).collect()
}

/// Height as time of its interval, in steps of 2^-30: `1 - t` is exact; 0 and 1 at the ends and beyond.
pub fn time(z: f64, low: f64, high: f64) -> f64 {
    ((z - low) / (high - low) * STEPS).round().clamp(0.0, STEPS) / STEPS
}

/// Slope of the field at a slice from the secants of the intervals below and above it, per height: the mean of PCHIP and of Catmull-Rom limited
/// to three times the smaller secant; of relief van Albada's, since beside a contour a plain stays a plain although a slope begins on the
/// other side. None of them has a unit of height.
#[inline(always)]
pub fn slope([below, above]: [f64; 2], [h_below, h_above]: [f64; 2], relief: f64) -> f64 {
    let pchip = harmonic(below, above, h_below, h_above);
    let mean = (h_above * below + h_below * above) / (h_below + h_above);
    (1.0 - relief) * 0.5 * (pchip + limited(mean, below, above)) + relief * van_albada(below, above)
}

/// Value of the field at time `t` of an interval, from values and slopes (per interval) at both ends. What it shrinks by is taken off where
/// there is room for it above the lesser end: `s r / sqrt(s^2 + r^2)`, or a body would swell beyond its larger contour.
#[inline]
pub fn between([a, b]: [f64; 2], [ma, mb]: [f64; 2], relief: f64, t: f64) -> f64 {
    let shrinking = SHRINKING * (1.0 - relief) * 4.0 * (t * (1.0 - t)).powi(2) * (a - b).abs();
    let value = hermite_values([a, b], [ma, mb], t);
    let room = (value - a.min(b)).max(0.0);
    let square = shrinking * shrinking + room * room;
    if square > 0.0 { value - shrinking * room / square.sqrt() } else { value }
}

/// Uprightness of a surface that goes `sideways` per height: 1 for a wall, 0 for a plain. What lies flat is relief between contour lines, which
/// neither shrinks nor shows creases.
#[inline]
pub fn upright(sideways: f64) -> f64 {
    1.0 - smoothstep((sideways - STEEP) / (FLAT - STEEP))
}

/// Set of cells of an image.
#[derive(Debug, Clone)]
pub struct Cells {
    columns: usize,
    /// Row by row.
    chosen: Vec<bool>,
}

impl Cells {
    /// The cells that `choose` wants, by the first and the last pixel `[column, row]` of each.
    pub fn new([nx, ny]: [usize; 2], choose: impl Fn([usize; 2], [usize; 2]) -> bool) -> Self {
        let last = |first: usize, n: usize| (first + CELL).min(n) - 1;
        let row = |y| (0..nx).step_by(CELL).map(move |x| ([x, y], [last(x, nx), last(y, ny)]));
        let chosen = (0..ny).step_by(CELL).flat_map(row).map(|(first, last)| choose(first, last)).collect();
        Cells { columns: nx.div_ceil(CELL), chosen }
    }

    /// Whether each cell is one of them, row by row.
    pub fn chosen(&self) -> &[bool] {
        &self.chosen
    }

    /// Whether the cell of a pixel is one of them.
    pub fn at(&self, x: usize, y: usize) -> bool {
        self.chosen[y / CELL * self.columns + x / CELL]
    }
}

/// Cells of a sparse image's square in that column and row: their first pixels.
pub fn cells_of_square([column, row]: [usize; 2], [nx, ny]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let firsts = |k: usize, n: usize| (k * SQUARE..((k + 1) * SQUARE).min(n)).step_by(CELL);
    firsts(row, ny).flat_map(move |top| firsts(column, nx).map(move |left| [left, top]))
}

/// What probes with these values say of a cell: that it is beyond `limit`, inside or outside, else nothing, which is 0.
pub fn probed(values: [f32; 5], limit: f32) -> f32 {
    let all = |beyond: fn(f32, f32) -> bool| values.iter().all(|v| beyond(*v, limit));
    if all(|v, limit| v >= limit) {
        limit
    } else if all(|v, limit| v <= -limit) {
        -limit
    } else {
        0.0
    }
}

/// Pixels that tell whether a cell is far from any contour: its corners and its middle.
pub fn probes([left, top]: [usize; 2], [right, bottom]: [usize; 2]) -> [[usize; 2]; 5] {
    [[left, top], [right, top], [left, bottom], [right, bottom], [left.midpoint(right), top.midpoint(bottom)]]
}

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

#[cfg(test)]
mod tests {
    use super::*;

    /// Secants below and above, and gaps.
    fn some() -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let secants = [-40.0, -3.0, -0.2, 0.0, 0.05, 0.7, 2.0, 2.5, 6.0, 90.0];
        let pairs = secants.into_iter().flat_map(move |a| secants.map(|b| [a, b]));
        pairs.flat_map(|d| [[1.0, 1.0], [0.3, 2.0]].map(|h| (d, h)))
    }

    /// A body that swells by a fifth and shrinks again while it drifts.
    fn swelling() -> MotionField {
        let dims = [90, 70];
        let still = Displacement::zero(dims);
        let v = |growth: f64, drift: f64| {
            still.map(|_, x, _| growth * (x - DVec2::new(44.0, 35.0)) + DVec2::new(drift, 0.3 * drift))
        };
        let field = Arc::new(Field::filled(dims, 1.0));
        let fields = (0..4).map(|_| field.clone()).collect();
        let displacements = vec![v(0.2, 1.0), v(-0.3, 1.5), v(-0.1, -1.0)];
        MotionField::new(vec![0.0, 2.0, 5.0, 9.0], 1.0, fields, displacements)
    }

    #[test]
    fn all_layers_have_the_same_trajectories() {
        // What three fixed-point passes leave where the displacement changes by 0.3 px per px, read at nodes. With trajectories found as if
        // they were straight it is 0.37 px.
        const BOUND: f64 = 0.01;
        let (moving, times) = (swelling(), [0.0, 0.1, 0.25, 0.5, 0.7, 0.9, 1.0]);
        for i in 0..3 {
            let layers = times.map(|t| moving.paths(i, t));
            for (from, onto) in layers.iter().flat_map(|from| layers.iter().map(move |onto| (from, onto))) {
                for x in [[30.0, 20.0], [44.0, 35.0], [61.0, 41.5], [50.2, 52.7]].map(DVec2::from) {
                    let [low, high] = from.to_slices(x);
                    let there = onto.off_low(low, low, 20);
                    let off = (there + onto.go.at(there) - high).length();
                    assert!(off < BOUND, "interval {i}, {x}: {off}");
                }
            }
            assert!(layers[0].come.largest() == 0.0 && layers[6].go.largest() == 0.0, "slices stay where they are");
        }
    }

    #[test]
    fn slopes_are_the_same_upside_down() {
        for (([a, b], [h, k]), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            assert_eq!(slope([a, b], [h, k], relief), -slope([-b, -a], [k, h], relief), "{a} {b} {h} {k}");
        }
    }

    #[test]
    fn a_line_keeps_its_slope_and_none_overshoots() {
        for ((d @ [a, b], h), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            let m = slope(d, h, relief);
            if a == b {
                assert!((m - a).abs() <= 1e-12 * a.abs(), "{a}: {m}");
            }
            // Up to three times the smaller secant a cubic curve stays monotone (Fritsch and Carlson 1980).
            let (sign, least) = (if a * b > 0.0 { a.signum() } else { 0.0 }, a.abs().min(b.abs()));
            assert!(m * sign >= 0.0 && m.abs() <= 3.0 * least * sign.abs(), "{d:?}, {h:?}: {m}");
        }
    }

    #[test]
    fn a_monotone_curve_stays_between_its_ends() {
        let times = (0..=64).map(|k| f64::from(k) / 64.0);
        for ((a, b), t) in
            [(8.5_f64, -0.4), (-0.4, 8.5), (1.0, 1.0)].iter().flat_map(|e| times.clone().map(move |t| (*e, t)))
        {
            for m in [0.0, 1.0, 3.0].iter().flat_map(|m| [0.0, 1.0, 3.0].map(|n| [m * (b - a), n * (b - a)])) {
                let (least, most) = (a.min(b), a.max(b));
                let value = between([a, b], m, 0.0, t);
                assert!((least - 1e-12..=most + 1e-12).contains(&value), "{a} {b} {m:?} {t}: {value}");
                assert_eq!(value, between([b, a], [-m[1], -m[0]], 0.0, 1.0 - t), "upside down");
                if m == [b - a; 2] && t == 0.5 {
                    let full = SHRINKING * 0.25 * (a - b).abs();
                    assert!(
                        (0.5 * (a + b) - value - full).abs() <= 0.01 * full,
                        "where there is room all of it is taken off"
                    );
                }
            }
        }
    }

    #[test]
    fn slopes_have_no_unit_of_height() {
        for ((d, h), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            // A power of two, so that nothing is rounded.
            let stretched = slope(d.map(|d| d / 8.0), h.map(|h| 8.0 * h), relief);
            assert_eq!(8.0 * stretched, slope(d, h, relief), "{d:?}, {h:?}");
        }
    }

    #[test]
    fn of_relief_the_smaller_secant_counts_more() {
        let [h, d] = [[1.0, 1.0], [0.5, 1.5]];
        // PCHIP 0.75 and Catmull-Rom 1; 1.5 / 2.5.
        assert_eq!([0.0, 1.0].map(|relief| slope(d, h, relief)), [0.5 * (0.75 + 1.0), 0.6]);
    }

    #[test]
    fn a_place_is_carried_along_its_trajectory() {
        // As between layers, and what is found at nodes is read between them.
        const BOUND: f64 = 0.03;
        let (moving, times) = (swelling(), [0.2, 0.5, 0.9]);
        let place = |i: usize, t: f64| Place::new(&moving, i, i, t, None);
        let places: Vec<(usize, f64)> = (0..3).flat_map(|i| times.map(|t| (i, t))).collect();
        for (&(i, t), &(to, u)) in places.iter().flat_map(|from| places.iter().map(move |to| (from, to))) {
            let ((from, paths), (onto, there)) = (place(i, t), place(to, u));
            let between: Vec<Place> = (i.min(to) + 1..i.max(to)).map(|i| place(i, 0.5).0).collect();
            let between: Vec<&[Resting; 2]> = between.iter().map(|place| &*place.at_slices).collect();
            for x in [[30.0, 20.0], [44.0, 35.0], [61.0, 41.5]].map(DVec2::from) {
                let slices = paths.to_slices(x);
                // From slice to slice by the ways of whole intervals.
                let expected = if to < i {
                    let slice = (to + 1..i).rev().fold(slices[0], |x, k| moving.paths(k, 1.0).to_slices(x)[0]);
                    there.off_high(slice, slice, 20)
                } else {
                    let slice = (i + 1..to).fold(slices[1], |x, k| moving.paths(k, 0.0).to_slices(x)[1]);
                    let slice = if to == i { slices[0] } else { slice };
                    there.off_low(slice, slice, 20)
                };
                let off = (from.carry(slices, &onto, &between) - expected).length();
                assert!(off < BOUND, "from {i}, {t} to {to}, {u}: {off}");
            }
        }
    }
}
