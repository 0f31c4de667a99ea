//! How lines that end at the border go on beyond it.
//!
//! Beyond the border the terrain goes on as it comes there: lines go on straight, in the direction in which they reach it, up to an outer rectangle.
//! They keep their order, so that none crosses another. Without them, or with lines at right angles to the border, distances near it would be
//! wrong: of a plane in 20 levels, heights within 8 cells of the border are 0.6 % of the interval off, at right angles 3.4 %.

use glam::DVec2;

use super::border::Border;
use super::join::Elevation;
use super::lines::distance;
use crate::polygons::Polygon;

/// Pixels that lines go on for, and from which their direction is taken. The outer rectangle is a contour for distances, the more one the nearer it
/// is: of a plane in 20 levels heights near the border are 1.6 % of the interval off with 4 px. With 16 lines that bend are as straight too far: a
/// bowl 4.4 for 3.4 %.
const BEYOND: f64 = 8.0;
/// Most that lines go on along the border for each pixel outward: those that nearly run along it. A saddle is 1.6 % off with 4, 0.8 % with 8.
const STEEPEST: f64 = 8.0;
/// Part of their distance from each other that lines keep at least.
const KEPT: f64 = 0.25;

/// An end of a line at one side of the border.
struct End {
    level: usize,
    line: usize,
    is_last: bool,
    /// Where along the side.
    place: f64,
    /// Where along the side it reaches the outer rectangle.
    reached: f64,
}

/// The outer rectangle, and the lines of each level that go from border to border gone on to it.
pub fn go_on(border: &Border, levels: &[Elevation], pixel: f64) -> (Border, Vec<Vec<Polygon>>) {
    let by = BEYOND * pixel;
    let outer = border.grown(by);
    let mut lines: Vec<Vec<Polygon>> = levels.iter().map(|level| level.open.clone()).collect();
    let mut sides: [Vec<End>; 4] = Default::default();
    for (level, open) in lines.iter().enumerate() {
        for (line, points) in open.iter().enumerate() {
            let backward: Polygon = points.iter().rev().copied().collect();
            for (is_last, points) in [(false, points), (true, &backward)] {
                let Some(end) = points.first() else { continue };
                let (side, _) = border.nearest(*end);
                let came = *end - inner(points, by);
                let slope = along(side, came) / out(side, came);
                let slope = if slope.is_nan() { 0.0 } else { slope.clamp(-STEEPEST, STEEPEST) };
                let place = along(side, *end);
                sides[side].push(End { level, line, is_last, place, reached: place + slope * by });
            }
        }
    }
    for (side, mut ends) in sides.into_iter().enumerate() {
        put_in_order(&mut ends, [border.low, border.high].map(|p| along(side, p)), by);
        for End { level, line, is_last, place, reached } in ends {
            let points = &mut lines[level][line];
            // An end inside, where a slanted edge has cut its line, goes straight to the border first.
            let mut more = [on(border, side, place), on(&outer, side, reached)];
            if is_last {
                points.extend(more);
            } else {
                more.reverse();
                points.splice(0..0, more);
            }
        }
    }
    (outer, lines)
}

/// The point of a line so far from its first, at most half way.
fn inner(points: &[DVec2], by: f64) -> DVec2 {
    let pieces = || points.windows(2).map(|w| (w[0], w[1], distance(w[0], w[1])));
    let mut left = by.min(pieces().map(|(.., length)| length).sum::<f64>() / 2.0);
    for (p, q, length) in pieces() {
        if length >= left && length > 0.0 {
            return p + (left / length) * (q - p);
        }
        left -= length;
    }
    points.first().copied().unwrap_or_default()
}

/// Moves where ends reach the outer rectangle, as little as it takes (least squares, by pooling adjacent violators), so that they keep their order and
/// [`KEPT`] of their distances, between its corners: of the sides' `corners` those `by` farther out.
fn put_in_order(ends: &mut [End], corners: [f64; 2], by: f64) {
    // Of two that meet at the border the one that goes on farther along it comes from before the other.
    ends.sort_by(|a, b| a.place.total_cmp(&b.place).then(b.reached.total_cmp(&a.reached)));
    // Without what they keep, places must only not decrease: means of groups, each of a sum and a count.
    let mut groups: Vec<(f64, usize)> = Vec::new();
    for end in ends.iter() {
        let (mut sum, mut count) = (end.reached - KEPT * end.place, 1);
        while let Some((lower, n)) = groups.pop_if(|(lower, n)| *lower / *n as f64 > sum / count as f64) {
            sum += lower;
            count += n;
        }
        groups.push((sum, count));
    }
    let means = groups.iter().flat_map(|(sum, n)| std::iter::repeat_n(sum / *n as f64, *n));
    let [low, high] = corners.map(|corner| (1.0 - KEPT) * corner);
    for (end, mean) in ends.iter_mut().zip(means) {
        end.reached = mean.clamp(low - by, high + by) + KEPT * end.place;
    }
}

/// Coordinate along a side (bottom, right, top, left).
fn along(side: usize, p: DVec2) -> f64 {
    if side.is_multiple_of(2) { p.x } else { p.y }
}

/// Part at right angles to a side, outward; at least 0.
fn out(side: usize, p: DVec2) -> f64 {
    [-p.y, p.x, p.y, -p.x][side].max(0.0)
}

/// The point of a rectangle's side.
fn on(rectangle: &Border, side: usize, at: f64) -> DVec2 {
    match side {
        0 => DVec2::new(at, rectangle.low.y),
        1 => DVec2::new(rectangle.high.x, at),
        2 => DVec2::new(at, rectangle.high.y),
        _ => DVec2::new(rectangle.low.x, at),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BORDER: Border = Border { low: DVec2::ZERO, high: DVec2::new(100.0, 60.0) };

    fn level(open: &[&[[f64; 2]]]) -> Elevation {
        let open = open.iter().map(|line| line.iter().copied().map(DVec2::from).collect()).collect();
        Elevation { z: 0.0, lines: Vec::new(), rings: Vec::new(), open }
    }

    #[test]
    fn lines_go_on_as_they_come_to_the_border() {
        // From the bottom to the right side, straight up for 20 of its length, and a quarter to the right for each outward.
        let (outer, lines) =
            go_on(&BORDER, &[level(&[&[[30.0, 0.0], [30.0, 20.0], [60.0, 40.0], [100.0, 50.0]]])], 1.0);
        assert_eq!(outer, BORDER.grown(8.0));
        let line = &lines[0][0];
        assert_eq!(line[..3], [[30.0, -8.0], [30.0, 0.0], [30.0, 0.0]].map(DVec2::from));
        assert_eq!(line[line.len() - 2], DVec2::new(100.0, 50.0));
        assert!(distance(line[line.len() - 1], DVec2::new(108.0, 52.0)) < 1e-9, "{line:?}");
    }

    #[test]
    fn an_end_inside_goes_straight_to_the_border_first_and_one_along_it_only_so_far() {
        let (_, lines) = go_on(&BORDER, &[level(&[&[[40.0, 5.0], [40.0, 30.0], [2.0, 60.0], [1.0, 60.0]]])], 0.1);
        assert_eq!(lines[0][0][..2], [[40.0, -0.8], [40.0, 0.0]].map(DVec2::from));
        // The last piece runs along the top to the left: on by 8 for each outward, but not beyond the corner.
        assert!(distance(lines[0][0][7], DVec2::new(-0.8 + 0.25, 60.8)) < 1e-9, "{:?}", lines[0][0]);
    }

    /// Where two ends reach the outer rectangle the other way round the lines cross: by directions alone they would.
    #[test]
    fn lines_keep_their_order() {
        use proptest::prelude::*;
        use proptest::strategy::ValueTree;
        let ends = prop::collection::vec((0.0..100.0f64, -STEEPEST..STEEPEST), 2..20);
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let mut crossed = 0;
        for _ in 0..200 {
            let drawn = ends.new_tree(&mut runner).expect("a draw").current();
            let end = |(place, slope): (f64, f64)| End {
                level: 0,
                line: 0,
                is_last: true,
                place,
                reached: place + 8.0 * slope,
            };
            let mut ends: Vec<End> = drawn.into_iter().map(end).collect();
            ends.sort_by(|a, b| a.place.total_cmp(&b.place));
            crossed += usize::from(ends.windows(2).any(|w| w[1].reached < w[0].reached));
            put_in_order(&mut ends, [0.0, 100.0], 8.0);
            for w in ends.windows(2) {
                let apart = w[1].reached - w[0].reached;
                assert!(apart >= KEPT * (w[1].place - w[0].place) - 1e-9, "{} and {}", w[0].place, w[1].place);
            }
            assert!(ends.iter().all(|end| end.reached >= -8.0 && end.reached <= 108.0));
        }
        assert!(crossed > 100, "{crossed}");
    }
}
