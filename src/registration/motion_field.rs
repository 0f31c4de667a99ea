//! A stack in a smooth moving frame: fields of all slices, displacements between them, and what follows from both.
//!
//! A point of the lower slice of an interval moves along `x + p(t)`, with `p(0) = 0`, `p(1) = u` and the rates K at the slices, so that
//! motion too is C1 across contours: `p(t) = t u + (h K_i - u)(t^3 - 2 t^2 + t) + (h K_{i+1} - u)(t^3 - t^2)`.

use std::cmp::Ordering;
use std::sync::Arc;

use glam::DVec2;

use crate::grid::field::Field;
use crate::grid::near_knots::{narrow, settled};
use crate::grid::spline::{harmonic, smoothstep};
use crate::registration::displacement::{self, Displacement, LANES, Lanes, Resting};

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
    /// What contours may be off by, px, see [`crate::grid::near_knots`].
    pub doubt: f64,
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

/// The displacement of an interval at its slices, and its gap.
pub type Moved<'d> = (&'d [Displacement; 2], f64);

/// Rate of motion at a slice, px of the image per height, from the intervals below and above it, of which there is at least one. `farther` are those beyond
/// these, `doubt` is what contours may be off by, px: see [`settled`].
pub fn rate([below, above]: [Option<Moved<'_>>; 2], farther: [Option<Moved<'_>>; 2], doubt: f64) -> Displacement {
    let alone = |v: &Displacement, gap: f64| v.map(|_, _, u| u / gap);
    match (below, above) {
        (Some((below, h0)), Some((above, h1))) => {
            let (before, after) = (&below[1], &above[0]);
            if narrow(h0, h1).max(narrow(h1, h0)) == 0.0 {
                let along = |b: f64, a: f64| harmonic(b / h0, a / h1, h0, h1);
                return before.zip([after], |b, [a]| DVec2::new(along(b.x, a.x), along(b.y, a.y)));
            }
            // What moves beyond the slices below and above.
            let beyond = |interval: Option<Moved<'_>>, slice: usize, x: DVec2| {
                interval.map_or((DVec2::ZERO, 0.0), |(v, gap)| (v[slice].at(x) / gap, gap))
            };
            before.map(|k, x, b| {
                let a = after.vectors[k];
                let ((c, h2), (d, h3)) = (beyond(farther[0], 1, x - b), beyond(farther[1], 0, x + a));
                let along = |b: f64, a: f64, c: f64, d: f64| {
                    let [[b, h0], [a, h1]] = settled([[b / h0, h0], [a / h1, h1]], [[c, h2], [d, h3]], doubt);
                    harmonic(b, a, h0, h1)
                };
                DVec2::new(along(b.x, a.x, c.x, d.x), along(b.y, a.y, c.y, d.y))
            })
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
        let interval = |i: Option<usize>| i.filter(|i| *i < gaps.len()).and_then(beside);
        let rate = |i: usize| {
            let [below, farther] = [1, 2].map(|n| interval(i.checked_sub(n)));
            rate([below, interval(Some(i))], [farther, interval(Some(i + 1))], 0.0)
        };
        let rates: Vec<Arc<Displacement>> = (0..heights.len()).map(|i| Arc::new(rate(i))).collect();
        let through = |(i, v): (usize, &Displacement)| Arc::new(through_middle(v, gaps[i], [&rates[i], &rates[i + 1]]));
        let through_middle = displacements.iter().enumerate().map(through).collect();
        let displacements = displacements.into_iter().map(Arc::new).collect();
        MotionField {
            heights,
            gaps,
            px,
            relief: 0.0,
            doubt: 0.0,
            fields,
            displacements,
            at_slices,
            rates,
            through_middle,
        }
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
        let off = v.zip([low, high], |u, [low, high]| DVec2::new(way(u.x, low.x, high.x), way(u.y, low.y, high.y)));
        let [come, go] = off.map_lanes_twice(|x, first| {
            let back = |off: &Lanes| [0, 1].map(|a| std::array::from_fn(|k| x[a][k] - off[a][k]));
            let middle = back(&(1..displacement::PASSES).fold(*first, |found, _| off.at_lanes(&back(&found))));
            let (mut come, mut go) = (off.at_lanes(&middle), v.at_lanes(&middle));
            // Halves are exact: at the slices themselves nothing is left.
            for (come, go) in come.as_flattened_mut().iter_mut().zip(go.as_flattened_mut()) {
                *come += 0.5 * *go;
                *go -= *come;
            }
            [come, go]
        });
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
    /// The place at time `t` of interval `i` of `moving`, which is number `interval` of the stack, and the paths through it. It shares the
    /// displacement at the interval's slices with all others there.
    pub fn new(moving: &MotionField, i: usize, interval: usize, t: f64, at_slices: Arc<[Resting; 2]>) -> (Self, Paths) {
        let paths = moving.paths(i, t);
        let off = moving.off_slices(i, t, &paths).each_ref().map(Resting::from);
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

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_place_is_carried_along_its_trajectory() {
        // As between layers, and what is found at nodes is read between them.
        const BOUND: f64 = 0.03;
        let (moving, times) = (swelling(), [0.2, 0.5, 0.9]);
        let place = |i: usize, t: f64| {
            let at_slices = Arc::new(moving.at_slices[i].each_ref().map(Resting::from));
            Place::new(&moving, i, i, t, at_slices)
        };
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
