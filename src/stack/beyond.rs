//! Bodies that the image's border cuts go on beyond it: otherwise the border would be a contour, a wall that distances, particles and motion follow.
//!
//! A run of pixels on the border goes on where it is cut, not where it touches the border: it must be about as long as the body is some pixels
//! farther in, and a slice beside it must reach the border there, too. An organ whose image is cropped to its box touches the border tangentially, or
//! on a single slice. Both ends of a run go on straight, in the direction in which they reach the border: those of a mask half way between two
//! pixels, those of a level set where it crosses zero. Beyond the border, runs neither meet nor branch, so that a slice keeps its parts and holes.

use std::ops::Range;

use crate::grid::tile::samples;

use super::{ContourStack, SliceContent};

/// Distance beyond the border to which bodies go on, px. Between 3 and 8 results hardly differ.
pub const REACH: usize = 4;
/// Distance from the border over which the direction is read in which a run reaches it, px.
const READ: usize = 4;
/// Share of the length farther in that a run on the border has at least where it is cut: (numerator, denominator).
const CUT: (usize, usize) = (7, 10);

/// Pixels beyond the border, along either axis, in which contours go on as they come: the edges of what ends them lie beyond the last. `h` are a
/// pixel's sides in units of the larger one.
pub fn course(h: [f64; 2]) -> [usize; 2] {
    samples(REACH, h).map(|n| n - 1)
}

/// A side of the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Side {
    /// Axis across it.
    axis: usize,
    /// Whether it is the one with the larger coordinate.
    high: bool,
}

const SIDES: [Side; 4] = [
    Side { axis: 0, high: false },
    Side { axis: 0, high: true },
    Side { axis: 1, high: false },
    Side { axis: 1, high: true },
];

/// An end of a run: the level set rises by `rise` per pixel outwards and is 0 `at` pixels beyond the centre of the run's last pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
struct End {
    at: f64,
    rise: f64,
}

impl End {
    /// Between the last pixel inside and the first outside, by their distances from the level.
    fn between(inside: f64, outside: f64) -> Self {
        End { at: inside / (inside + outside), rise: inside + outside }
    }

    /// Value `pixels` beyond the centre of the run's last pixel.
    fn value(&self, pixels: isize) -> f64 {
        self.rise * (pixels as f64 - self.at)
    }
}

/// What becomes of a run of pixels on the border in the row or column `beyond` px beyond it, which is 0 on it.
#[derive(Debug, Clone, PartialEq)]
struct Strip {
    side: Side,
    beyond: usize,
    run: Range<usize>,
    ends: [End; 2],
}

impl Strip {
    /// Pixels inside.
    fn along(&self) -> Range<isize> {
        let [first, last] = self.ends.map(|end| end.at.ceil() as isize - 1);
        self.run.start as isize - first..self.run.end as isize + last
    }

    /// Value at pixel `at` of the line, negative inside.
    fn value(&self, at: isize) -> f32 {
        let [first, last] = [self.run.start as isize - at, at + 1 - self.run.end as isize];
        let v = self.ends[0].value(first).max(self.ends[1].value(last));
        if v < 0.0 { (v as f32).min(-f32::MIN_POSITIVE) } else { v as f32 }
    }
}

/// Distances to which slices go on beyond the image, and over which directions are read, px by axis.
#[derive(Debug, Clone, Copy)]
struct Reaches {
    beyond: [usize; 2],
    read: [usize; 2],
    /// Steps along either axis by which an end moves at most per step along the other.
    steepest: [usize; 2],
}

impl Reaches {
    fn of(spacing: [f64; 2]) -> Self {
        let px = spacing[0].max(spacing[1]);
        let h = spacing.map(|s| s / px);
        let steepest = [0, 1].map(|a| ((h[1 - a] / h[a]) as usize).max(1));
        Reaches { beyond: samples(REACH, h), read: samples(READ, h), steepest }
    }
}

/// Lines of pixels along a side: the border, and those farther in.
struct Lines<'s> {
    stack: &'s ContourStack,
    side: Side,
}

impl Lines<'_> {
    /// Pixel `along` of the line `depth` px from the border; 0 is the border.
    fn node(&self, depth: usize, along: usize) -> usize {
        let (dims, Side { axis, high }) = (self.stack.dims, self.side);
        let across = if high { dims[axis] - 1 - depth } else { depth };
        if axis == 1 { across * dims[0] + along } else { along * dims[0] + across }
    }

    /// The runs of slice `slice` on a line.
    fn runs(&self, slice: usize, depth: usize) -> Vec<Range<usize>> {
        let content = &self.stack.slices[slice].content;
        let mut line = vec![false; self.stack.dims[1 - self.side.axis]];
        match self.side.axis {
            1 => content.read(self.node(depth, 0), &mut line),
            _ => line.iter_mut().enumerate().for_each(|(j, inside)| *inside = content.inside(self.node(depth, j))),
        }
        let mut runs: Vec<Range<usize>> = Vec::new();
        for (at, _) in line.iter().enumerate().filter(|(_, inside)| **inside) {
            match runs.last_mut().filter(|run| run.end == at) {
                Some(run) => run.end += 1,
                None => runs.push(at..at + 1),
            }
        }
        runs
    }

    /// Both ends of a run on a line; half way to the next pixel those of a mask, and those at the image's corners.
    fn ends(&self, slice: usize, depth: usize, run: &Range<usize>) -> [End; 2] {
        let SliceContent::Level(level) = &self.stack.slices[slice].content else { return [End::between(0.5, 0.5); 2] };
        let distance = |along: usize| f64::from(level.value(self.node(depth, along))).abs();
        let end =
            |inside: usize, outside: Option<usize>| End::between(distance(inside), distance(outside.unwrap_or(inside)));
        let length = self.stack.dims[1 - self.side.axis];
        [end(run.start, run.start.checked_sub(1)), end(run.end - 1, Some(run.end).filter(|end| *end < length))]
    }
}

/// Whether two runs of neighbouring lines share an edge.
fn meets(a: &Range<usize>, b: &Range<usize>) -> bool {
    a.start < b.end && b.start < a.end
}

/// Strips in which slice `slice` goes on beyond one side.
fn strips_of_side(stack: &ContourStack, slice: usize, side: Side) -> Vec<Strip> {
    let lines = Lines { stack, side };
    let border = lines.runs(slice, 0);
    if border.is_empty() {
        return Vec::new();
    }
    let reaches = Reaches::of(stack.spacing);
    let (along, across) = (1 - side.axis, side.axis);
    let length = stack.dims[along];
    let read = reaches.read[across].min(stack.dims[across] - 1);
    let within: Vec<Vec<Range<usize>>> = (1..=read).map(|depth| lines.runs(slice, depth)).collect();
    let beside = [slice.checked_sub(1), Some(slice + 1).filter(|k| *k < stack.slices.len())];
    let beside: Vec<Range<usize>> = beside.into_iter().flatten().flat_map(|k| lines.runs(k, 0)).collect();
    let mut strips = Vec::new();
    for (k, run) in border.iter().enumerate() {
        // The run farther in: all that hangs on it, line by line.
        let inner = within.iter().try_fold(run.clone(), |run, line| {
            let mut hanging = line.iter().filter(|other| meets(&run, other));
            let first = hanging.next()?;
            Some(first.start..hanging.next_back().unwrap_or(first).end)
        });
        let Some(inner) = inner.filter(|inner| run.len() * CUT.1 >= inner.len() * CUT.0) else { continue };
        if !beside.iter().any(|other| meets(run, other)) {
            continue;
        }
        // Ends at the image's corners go on obliquely, so that the sides that meet there share what lies beyond both.
        let corners = [run.start == 0, run.end == length];
        let (ends, inner_ends) = (lines.ends(slice, 0, run), lines.ends(slice, read, &inner));
        // Outwards, so that a mirrored image is treated alike.
        let most = (reaches.steepest[along] * read) as f64;
        let steps = [inner.start as f64 - run.start as f64, run.end as f64 - inner.end as f64];
        let shifts = [0, 1].map(|e| (steps[e] + (ends[e].at - inner_ends[e].at)).clamp(-most, most));
        // Half of the way to the runs beside this one, less a pixel that lies between; never beyond a corner that is outside.
        let rooms = [
            match k.checked_sub(1).map(|k| border[k].end) {
                Some(end) => run.start - ((end + run.start) / 2 + 1),
                None => run.start.saturating_sub(1),
            },
            match border.get(k + 1) {
                Some(next) => (run.end + next.start).div_ceil(2) - 1 - run.end,
                None => (length - run.end).saturating_sub(1),
            },
        ];
        let mut last = run.start as isize..run.end as isize;
        for beyond in 0..=reaches.beyond[across] {
            let oblique = (beyond * reaches.beyond[along]).div_ceil(reaches.beyond[across]) as f64;
            let end = |e: usize| {
                let End { at, rise } = ends[e];
                let on = at + shifts[e] * beyond as f64 / read.max(1) as f64;
                End { at: if corners[e] { oblique + at } else { on.min(rooms[e] as f64 + at) }, rise }
            };
            let strip = Strip { side, beyond, run: run.clone(), ends: [end(0), end(1)] };
            let next = strip.along();
            if next.is_empty() || next.start >= last.end || next.end <= last.start {
                break;
            }
            strips.push(strip);
            last = next;
        }
    }
    strips
}

/// Pixels beyond the image that a slice of `stack` goes on to, and values, negative there, of these and of those beside them, which may be on the
/// border; counted from the image's first pixel.
pub fn beyond(stack: &ContourStack, slice: usize) -> Vec<([isize; 2], f32)> {
    let reaches = Reaches::of(stack.spacing);
    let mut pixels = Vec::new();
    for strip in SIDES.into_iter().flat_map(|side| strips_of_side(stack, slice, side)) {
        let Side { axis, high } = strip.side;
        let beyond = strip.beyond as isize;
        let across = if high { stack.dims[axis] as isize - 1 + beyond } else { -beyond };
        let more = reaches.steepest[1 - axis] as isize;
        let along = strip.along();
        let pixel = |at: isize| (if axis == 0 { [across, at] } else { [at, across] }, strip.value(at));
        let around = (along.start - more..along.end + more).map(pixel);
        pixels.extend(around.filter(|(_, v)| beyond > 0 || *v >= 0.0));
    }
    pixels
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::grid::components::{label4, label8};
    use crate::stack::{LevelSlice, Slice};

    fn stack_of(dims: [usize; 2], contents: Vec<SliceContent>) -> ContourStack {
        let slice = |(k, content)| Slice { name: format!("{k}"), z: k as f64, extra: false, content };
        ContourStack {
            dims,
            spacing: [1.0; 2],
            unit: "px".into(),
            slices: contents.into_iter().enumerate().map(slice).collect(),
            z_out: None,
            geometry: Default::default(),
            known: None,
        }
    }

    fn stack(dims: [usize; 2], slices: &[&dyn Fn(usize, usize) -> bool]) -> ContourStack {
        let mask = |inside: &&dyn Fn(usize, usize) -> bool| {
            SliceContent::Mask((0..dims[0] * dims[1]).map(|n| inside(n % dims[0], n / dims[0])).collect())
        };
        stack_of(dims, slices.iter().map(mask).collect())
    }

    /// Two slices of the same values, or of their masks.
    fn twice(dims: [usize; 2], level: bool, value: &dyn Fn(usize, usize) -> f64) -> ContourStack {
        let values: Vec<f32> = (0..dims[0] * dims[1]).map(|n| value(n % dims[0], n / dims[0]) as f32).collect();
        let content = match level {
            true => SliceContent::Level(LevelSlice::new(&values, dims[0])),
            false => SliceContent::Mask(values.iter().map(|v| *v < 0.0).collect()),
        };
        stack_of(dims, vec![content.clone(), content])
    }

    /// Pixels to which a slice goes on.
    fn going_on(stack: &ContourStack, slice: usize) -> Vec<[isize; 2]> {
        beyond(stack, slice).into_iter().filter(|(_, v)| *v < 0.0).map(|(at, _)| at).collect()
    }

    /// Least values by pixel, bit by bit.
    fn values(stack: &ContourStack, at: impl Fn([isize; 2]) -> [isize; 2]) -> BTreeMap<[isize; 2], u32> {
        let mut least: BTreeMap<[isize; 2], f32> = BTreeMap::new();
        for (pixel, v) in beyond(stack, 0) {
            let known = least.entry(at(pixel)).or_insert(v);
            *known = known.min(v);
        }
        least.into_iter().map(|(pixel, v)| (pixel, v.to_bits())).collect()
    }

    fn sorted(mut pixels: Vec<[isize; 2]>) -> Vec<[isize; 2]> {
        pixels.sort_unstable();
        pixels.dedup();
        pixels
    }

    /// A slice with what goes on, and `REACH` + 1 pixels around the image.
    fn seen(stack: &ContourStack, slice: usize) -> (Vec<bool>, [usize; 2]) {
        let around = REACH + 1;
        let dims = stack.dims.map(|n| n + 2 * around);
        let mut pixels = vec![false; dims[0] * dims[1]];
        for (n, inside) in stack.slices[slice].content.sides().into_iter().enumerate() {
            pixels[(n / stack.dims[0] + around) * dims[0] + n % stack.dims[0] + around] = inside;
        }
        for at in going_on(stack, slice) {
            let [i, j] = at.map(|n| (n + around as isize) as usize);
            pixels[j * dims[0] + i] = true;
        }
        (pixels, dims)
    }

    #[test]
    fn what_is_cut_goes_on_in_its_direction() {
        // A bar across the left border that comes down by a pixel per pixel on its way there, and one that comes straight.
        let bar =
            |slope: isize| move |i: usize, j: usize| i < 20 && (10 + slope * i as isize..18).contains(&(j as isize));
        for (slope, starts) in [(0, [10, 10, 10, 10]), (1, [9, 8, 7, 6])] {
            let own = stack([30, 30], &[&bar(slope), &bar(slope)]);
            let expected = (1..).zip(starts).flat_map(|(x, start)| (start..18).map(move |y| [-x, y]));
            assert_eq!(sorted(going_on(&own, 0)), sorted(expected.collect()), "slope {slope}");
        }
    }

    #[test]
    fn a_level_set_goes_on_where_its_contour_runs() {
        // A bar across two borders, one end of which is steep and the other flat, and whose values rise unlike at its edges.
        let value = |x: f64, y: f64| (3.0 * (8.35 + 0.3 * x - y)).max(0.7 * (y - 26.63 + 0.05 * x));
        let own = twice([30, 30], true, &|i, j| value(i as f64, j as f64));
        let inside = |x: isize| (-9..40).map(move |y| [x, y]).filter(|[x, y]| value(*x as f64, *y as f64) < 0.0);
        assert_eq!(sorted(going_on(&own, 0)), (-4..0).chain(30..34).flat_map(inside).collect::<Vec<_>>());
        let found = beyond(&own, 0);
        for x in (-4..=0).chain(29..34) {
            let beside = found.iter().filter(|([i, _], v)| *i == x && *v >= 0.0);
            assert_eq!(beside.count(), 2, "a pixel beside either end, column {x}");
        }
        for ([i, j], v) in found {
            let expected = value(i as f64, j as f64);
            assert!((f64::from(v) - expected).abs() < 1e-4, "({i}, {j}): {v}, not {expected}");
        }
    }

    #[test]
    fn a_level_set_of_pixels_twice_as_long_as_wide_goes_on_likewise() {
        // Its edge moves by 1.3 pixels per row, over a pixel of the border that has no value of its own.
        let value = |x: f64, y: f64| (12.1 + 1.3 * y - x).max(x - 24.4);
        let own = ContourStack { spacing: [0.5, 1.0], ..twice([40, 30], true, &|i, j| value(i as f64, j as f64)) };
        let found = beyond(&own, 0);
        assert!(found.iter().any(|(at, _)| *at == [11, 0]) && going_on(&own, 0).contains(&[11, -1]), "{found:?}");
        assert_eq!(found.iter().map(|([_, j], _)| *j).min(), Some(-4));
        for ([i, j], v) in found {
            let expected = value(i as f64, j as f64);
            assert!((f64::from(v) - expected).abs() < 1e-4, "({i}, {j}): {v}, not {expected}");
        }
    }

    #[test]
    fn what_touches_the_border_ends_there() {
        let disc = |i: usize, j: usize| (i as f64 - 11.0).hypot(j as f64 - 15.0) < 11.5;
        let bar = |i: usize, j: usize| i < 20 && (10..18).contains(&j);
        let distant = |i: usize, j: usize| i > 2 && bar(i, j);
        assert!(beyond(&stack([40, 30], &[&disc, &disc]), 0).is_empty(), "a tangent");
        let grey = twice([40, 30], true, &|i, j| (i as f64 - 11.0).hypot(j as f64 - 15.0) - 11.5);
        assert!(beyond(&grey, 0).is_empty(), "a tangent of a level set");
        let touching = stack([30, 30], &[&distant, &bar, &distant]);
        assert!((0..3).all(|k| beyond(&touching, k).is_empty()), "a single slice");
        let cut = stack([30, 30], &[&distant, &bar, &bar]);
        assert_eq!([0, 1, 2].map(|k| beyond(&cut, k).is_empty()), [true, false, false]);
    }

    #[test]
    fn beyond_the_border_a_slice_keeps_its_parts_and_holes_and_its_symmetry() {
        let mut most = 0;
        for (seed, level) in (0..300u32).flat_map(|seed| [(seed, false), (seed, true)]) {
            let waves: Vec<f64> = (0..12u32).map(|k| f64::from((seed * 97 + k * 53) % 101) / 101.0).collect();
            let value = |i: usize, j: usize| {
                let wave =
                    |k: usize| (waves[k] * 0.9 * i as f64 + waves[k + 1] * 0.9 * j as f64 + 6.3 * waves[k + 2]).sin();
                0.3 - (wave(0) + wave(3) + wave(6) + wave(9))
            };
            let own = twice([26, 31], level, &value);
            let (pixels, dims) = seen(&own, 0);
            let sides = own.slices[0].content.sides();
            let count = |pixels: &[bool], dims| {
                // What is outside reaches the border of a larger image.
                let outside: Vec<bool> = pixels.iter().map(|inside| !inside).collect();
                (label4(pixels, dims).count, label8(&outside, dims).count)
            };
            let bare = {
                let mut bare = vec![false; pixels.len()];
                for (n, inside) in sides.iter().enumerate() {
                    bare[(n / 26 + REACH + 1) * dims[0] + n % 26 + REACH + 1] = *inside;
                }
                bare
            };
            assert_eq!(count(&pixels, dims), count(&bare, dims), "seed {seed}");
            let turned = values(&twice([31, 26], level, &|i, j| value(j, i)), |[i, j]| [j, i]);
            assert_eq!(values(&own, |at| at), turned, "seed {seed}");
            let turned = values(&twice([26, 31], level, &|i, j| value(25 - i, j)), |[i, j]| [25 - i, j]);
            assert_eq!(values(&own, |at| at), turned, "seed {seed}");
            most = most.max(sorted(going_on(&own, 0)).len());
        }
        assert!(most > 50, "{most}");
    }
}
