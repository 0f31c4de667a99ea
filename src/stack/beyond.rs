//! Bodies that the image's border cuts go on beyond it: otherwise the border would be a contour, a wall that distances, particles and motion follow.
//!
//! A run of pixels on the border goes on where it is cut, not where it touches the border: it must be about as long as the body is some pixels
//! farther in, and a slice beside it must reach the border there, too. An organ whose image is cropped to its box touches the border tangentially, or
//! on a single slice. Both ends of a run go on straight, in the direction in which they reach the border. Beyond it, runs neither meet nor
//! branch, so that a slice keeps its parts and holes.

use std::ops::Range;

use crate::grid::tile::samples;

use super::{ContourStack, SliceContent};

/// Distance beyond the border to which bodies go on, px. Between 3 and 8 results hardly differ.
pub const REACH: usize = 4;
/// Distance from the border over which the direction is read in which a run reaches it, px.
const READ: usize = 4;
/// Share of the length farther in that a run on the border has at least where it is cut: (numerator, denominator).
const CUT: (usize, usize) = (7, 10);

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

/// Pixels beyond the image that a slice goes on to, row by row: pixels `along` of the row or column `beyond` px beyond the border, which is 1 beside it.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Strip {
    side: Side,
    beyond: usize,
    along: Range<isize>,
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
    /// The runs of slice `slice` on the line `depth` px from the border; 0 is the border.
    fn runs(&self, slice: usize, depth: usize) -> Vec<Range<usize>> {
        let (content, dims) = (&self.stack.slices[slice].content, self.stack.dims);
        let Side { axis, high } = self.side;
        let across = if high { dims[axis] - 1 - depth } else { depth };
        let mut line = vec![false; dims[1 - axis]];
        match axis {
            1 => content.read(across * dims[0], &mut line),
            _ => line.iter_mut().enumerate().for_each(|(j, inside)| *inside = content.inside(j * dims[0] + across)),
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
        let most = (reaches.steepest[along] * read) as isize;
        let shift = |border: usize, inner: usize| (border as isize - inner as isize).clamp(-most, most);
        let shifts = [shift(run.start, inner.start), shift(run.end, inner.end)];
        // Half of the way to the runs beside this one, less a pixel that lies between; never beyond a corner that is outside.
        let least = match k.checked_sub(1).map(|k| border[k].end) {
            Some(end) => ((end + run.start) / 2 + 1) as isize,
            None => 1,
        };
        let largest = match border.get(k + 1) {
            Some(next) => ((run.end + next.start).div_ceil(2) - 1) as isize,
            None => length as isize - 1,
        };
        let mut last = run.start as isize..run.end as isize;
        let twice = 2 * read.max(1) as isize;
        for beyond in 1..=reaches.beyond[across] {
            let oblique = (beyond * reaches.beyond[along]).div_ceil(reaches.beyond[across]) as isize;
            let steps = beyond as isize;
            // To the nearest pixel's edge; in integers, so that a mirrored image is treated alike.
            let start = (twice * run.start as isize + 2 * shifts[0] * steps + twice / 2).div_euclid(twice);
            let end = -(twice / 2 - twice * run.end as isize - 2 * shifts[1] * steps).div_euclid(twice);
            let next = Range {
                start: if corners[0] { -oblique } else { start.max(least) },
                end: if corners[1] { length as isize + oblique } else { end.min(largest) },
            };
            if next.is_empty() || next.start >= last.end || next.end <= last.start {
                break;
            }
            strips.push(Strip { side, beyond, along: next.clone() });
            last = next;
        }
    }
    strips
}

/// Pixels beyond the image that a slice of `stack` goes on to, counted from the image's first pixel. Level sets end at the border.
pub fn beyond(stack: &ContourStack, slice: usize) -> Vec<[isize; 2]> {
    let mut pixels = Vec::new();
    if let SliceContent::Level(_) = stack.slices[slice].content {
        return pixels;
    }
    for Strip { side: Side { axis, high }, beyond, along } in
        SIDES.into_iter().flat_map(|s| strips_of_side(stack, slice, s))
    {
        let beyond = beyond as isize;
        let across = if high { stack.dims[axis] as isize - 1 + beyond } else { -beyond };
        pixels.extend(along.map(|at| if axis == 0 { [across, at] } else { [at, across] }));
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::{label4, label8};
    use crate::stack::Slice;

    fn stack(dims: [usize; 2], slices: &[&dyn Fn(usize, usize) -> bool]) -> ContourStack {
        let slice = |(k, inside): (usize, &&dyn Fn(usize, usize) -> bool)| Slice {
            name: k.to_string(),
            z: k as f64,
            extra: false,
            content: SliceContent::Mask((0..dims[0] * dims[1]).map(|n| inside(n % dims[0], n / dims[0])).collect()),
        };
        ContourStack {
            dims,
            spacing: [1.0; 2],
            unit: "px".into(),
            slices: slices.iter().enumerate().map(slice).collect(),
            z_out: None,
            geometry: Default::default(),
        }
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
        for at in beyond(stack, slice) {
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
            assert_eq!(sorted(beyond(&own, 0)), sorted(expected.collect()), "slope {slope}");
        }
    }

    #[test]
    fn what_touches_the_border_ends_there() {
        let disc = |i: usize, j: usize| (i as f64 - 11.0).hypot(j as f64 - 15.0) < 11.5;
        let bar = |i: usize, j: usize| i < 20 && (10..18).contains(&j);
        let distant = |i: usize, j: usize| i > 2 && bar(i, j);
        assert!(beyond(&stack([40, 30], &[&disc, &disc]), 0).is_empty(), "a tangent");
        let touching = stack([30, 30], &[&distant, &bar, &distant]);
        assert!((0..3).all(|k| beyond(&touching, k).is_empty()), "a single slice");
        let cut = stack([30, 30], &[&distant, &bar, &bar]);
        assert_eq!([0, 1, 2].map(|k| beyond(&cut, k).is_empty()), [true, false, false]);
    }

    #[test]
    fn beyond_the_border_a_slice_keeps_its_parts_and_holes_and_its_symmetry() {
        let mut most = 0;
        for seed in 0..300u32 {
            let waves: Vec<f64> = (0..12u32).map(|k| f64::from((seed * 97 + k * 53) % 101) / 101.0).collect();
            let value = |i: usize, j: usize| {
                let wave =
                    |k: usize| (waves[k] * 0.9 * i as f64 + waves[k + 1] * 0.9 * j as f64 + 6.3 * waves[k + 2]).sin();
                wave(0) + wave(3) + wave(6) + wave(9)
            };
            let inside = |i: usize, j: usize| value(i, j) > 0.3;
            let transposed = |i: usize, j: usize| inside(j, i);
            let mirrored = |i: usize, j: usize| inside(25 - i, j);
            let own = stack([26, 31], &[&inside, &inside]);
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
            let own = sorted(beyond(&own, 0));
            let turned = beyond(&stack([31, 26], &[&transposed, &transposed]), 0);
            assert_eq!(own, sorted(turned.into_iter().map(|[i, j]| [j, i]).collect()), "seed {seed}");
            let turned = beyond(&stack([26, 31], &[&mirrored, &mirrored]), 0);
            assert_eq!(own, sorted(turned.into_iter().map(|[i, j]| [25 - i, j]).collect()), "seed {seed}");
            most = most.max(own.len());
        }
        assert!(most > 50, "{most}");
    }
}
