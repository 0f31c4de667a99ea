//! How lines that end at the border go on beyond it.
//!
//! Beyond the border the terrain goes on as it comes there. Two lines of a level that meet there are one ([`arch`](super::arch)); the others go on
//! straight, in the direction in which they reach it, up to an outer rectangle. They keep their order, so that none crosses another. Without them, or
//! with lines at right angles to the border, distances near it would be wrong: of a plane in 20 levels, heights within 8 cells of the border are 0.6 %
//! of the interval off, at right angles 3.4 %; of a bowl 1.4 %, 3.3 % where lines do not meet.

use std::collections::BTreeMap;

use glam::DVec2;

use super::arch::{Arch, Ray, arches};
use super::border::Border;
use super::join::Elevation;
use super::lines::distance;
use crate::polygons::Polygon;

/// Pixels that lines go on for, and from which their direction is taken. The outer rectangle is a contour for distances, the more one the nearer it
/// is: of a plane in 20 levels heights near the border are 1.6 % of the interval off with 4 px. With 16 lines that bend are as straight too far: a
/// bowl, with lines that do not meet, 4.4 for 3.4 %.
const BEYOND: f64 = 8.0;
/// Pixels beyond those that hold the map in which lines go on as they come: these hold up to a pixel more than the map, and the outermost edges of what
/// closes the lines lie within another.
pub const COURSE: usize = BEYOND as usize - 2;
/// Most that lines go on along the border for each pixel outward: those that nearly run along it. A saddle is 1.6 % off with 4, 0.8 % with 8.
const STEEPEST: f64 = 8.0;
/// Part of their distance from each other that lines keep at least.
const KEPT: f64 = 0.25;

/// An end of a line at one side of the border.
struct End {
    ray: Ray,
    line: usize,
    is_last: bool,
    /// Where along the side it reaches the outer rectangle.
    reached: f64,
}

/// How an end goes on.
enum Onward {
    /// To the outer rectangle: its points at the border and there.
    Out([DVec2; 2]),
    /// Along these points from its own at the border to that of another end of its level, the last or the first of a line.
    Across { points: Polygon, line: usize, is_last: bool },
}

/// How the ends of a level's lines go on, by line and whether it is its last point.
type OfLevel = BTreeMap<(usize, bool), Onward>;

/// The outer rectangle, and of each level the lines that go from border to border gone on and closed: where two meet, by each other, else along that
/// rectangle.
pub fn go_on(border: &Border, levels: &[Elevation], pixel: f64) -> (Border, Vec<Vec<Polygon>>) {
    let by = BEYOND * pixel;
    let outer = border.grown(by);
    let mut onward: Vec<OfLevel> = levels.iter().map(|_| OfLevel::new()).collect();
    for (side, mut ends) in ends_by_side(border, levels, by).into_iter().enumerate() {
        // Of two that meet at the border the one that goes on farther along it comes from before the other.
        ends.sort_by(|a, b| a.ray.place.total_cmp(&b.ray.place).then(b.reached.total_cmp(&a.reached)));
        let rays: Vec<Ray> = ends.iter().map(|end| end.ray).collect();
        let arches = arches(&rays, by);
        put_in_order(&mut ends, &arches, [border.low, border.high].map(|p| along(side, p)), by);
        // An end inside, where a slanted edge has cut its line, goes straight to the border first.
        for End { ray, line, is_last, reached } in &ends {
            let out = [at_side(border, side, [ray.place, 0.0]), at_side(&outer, side, [*reached, 0.0])];
            onward[ray.level].insert((*line, *is_last), Onward::Out(out));
        }
        for arch in arches {
            let [a, b] = arch.ends.map(|k| &ends[k]);
            let there: Polygon = arch.points().map(|p| at_side(border, side, p)).collect();
            let back = there.iter().rev().copied().collect();
            for (from, to, points) in [(a, b, there), (b, a, back)] {
                let across = Onward::Across { points, line: to.line, is_last: to.is_last };
                onward[from.ray.level].insert((from.line, from.is_last), across);
            }
        }
    }
    let closed = levels.iter().zip(&onward).map(|(level, onward)| closed(&level.open, onward, &outer)).collect();
    (outer, closed)
}

/// The ends of all lines by the side of the border that is nearest (bottom, right, top, left), each as far as it goes on straight for `by`.
fn ends_by_side(border: &Border, levels: &[Elevation], by: f64) -> [Vec<End>; 4] {
    let mut sides: [Vec<End>; 4] = Default::default();
    for (level, lines) in levels.iter().enumerate() {
        for (line, points) in lines.open.iter().enumerate() {
            let backward: Polygon = points.iter().rev().copied().collect();
            for (is_last, points) in [(false, points), (true, &backward)] {
                let Some(end) = points.first() else { continue };
                let (side, _) = border.nearest(*end);
                let came = *end - inner(points, by);
                let slope = along(side, came) / out(side, came);
                let slope = if slope.is_nan() { 0.0 } else { slope.clamp(-STEEPEST, STEEPEST) };
                let ray = Ray { level, place: along(side, *end), slope };
                sides[side].push(End { ray, line, is_last, reached: ray.place + slope * by });
            }
        }
    }
    sides
}

/// Lines from border to border, and what they go on by, as closed ones.
fn closed(open: &[Polygon], onward: &OfLevel, outer: &Border) -> Vec<Polygon> {
    let mut done = vec![false; open.len()];
    // From the outer rectangle first: what is left then is closed by itself.
    let (from_outer, rest): (Vec<_>, Vec<_>) = onward.iter().partition(|(_, to)| matches!(to, Onward::Out(_)));
    let mut polygons = Vec::new();
    for (&(first, is_last), to) in from_outer.into_iter().chain(rest) {
        if done[first] {
            continue;
        }
        let mut points = Polygon::new();
        if let Onward::Out(out) = to {
            points.extend(out.iter().rev());
        }
        let (mut line, mut from_last) = (first, is_last);
        while !done[line] {
            done[line] = true;
            let own = open[line].iter().copied();
            if from_last {
                points.extend(own.rev())
            } else {
                points.extend(own)
            }
            match onward.get(&(line, !from_last)) {
                Some(Onward::Across { points: more, line: next, is_last }) => {
                    points.extend(more);
                    (line, from_last) = (*next, *is_last);
                }
                Some(Onward::Out(out)) => points.extend(out),
                None => {}
            }
        }
        polygons.push(if matches!(to, Onward::Out(_)) { outer.close(&points) } else { points });
    }
    polygons
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
/// [`KEPT`] of their distances, between its corners: of the sides' `corners` those `by` farther out. Then as far as it takes to pass beside all arches.
fn put_in_order(ends: &mut [End], arches: &[Arch], corners: [f64; 2], by: f64) {
    let free: Vec<usize> = (0..ends.len()).filter(|k| !arches.iter().any(|arch| arch.ends.contains(k))).collect();
    // Without what they keep, places must only not decrease: means of groups, each of a sum and a count.
    let mut groups: Vec<(f64, usize)> = Vec::new();
    for end in free.iter().map(|k| &ends[*k]) {
        let (mut sum, mut count) = (end.reached - KEPT * end.ray.place, 1);
        while let Some((lower, n)) = groups.pop_if(|(lower, n)| *lower / *n as f64 > sum / count as f64) {
            sum += lower;
            count += n;
        }
        groups.push((sum, count));
    }
    let means = groups.iter().flat_map(|(sum, n)| std::iter::repeat_n(sum / *n as f64, *n));
    let [low, high] = corners.map(|corner| (1.0 - KEPT) * corner);
    for (k, mean) in free.iter().zip(means) {
        ends[*k].reached = mean.clamp(low - by, high + by) + KEPT * ends[*k].ray.place;
    }
    // A line that has an arch's shoulder on its one side has the whole arch there. One at right angles to the border would have, so that no end is
    // moved farther than to that, and those that are moved with it not either.
    let beside = |end: &End, [at, up]: [f64; 2]| end.ray.place + (at - end.ray.place) * by / up;
    let keep =
        |least: f64, before: &End, end: &End| least.max(before.reached + KEPT * (end.ray.place - before.ray.place));
    for (n, &k) in free.iter().enumerate() {
        let passed = arches.iter().filter(|arch| arch.ends[1] < k).map(|arch| beside(&ends[k], arch.shoulders()[1]));
        let least = passed.fold(ends[k].reached, f64::max);
        ends[k].reached = n.checked_sub(1).map_or(least, |before| keep(least, &ends[free[before]], &ends[k]));
    }
    for (n, &k) in free.iter().enumerate().rev() {
        let ahead = arches.iter().filter(|arch| arch.ends[0] > k).map(|arch| beside(&ends[k], arch.shoulders()[0]));
        let most = ahead.fold(ends[k].reached, f64::min);
        let kept = |after: &End| most.min(after.reached - KEPT * (after.ray.place - ends[k].ray.place));
        ends[k].reached = free.get(n + 1).map_or(most, |after| kept(&ends[*after]));
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

/// The point `[along, outward]` of a rectangle's side.
fn at_side(rectangle: &Border, side: usize, [along, out]: [f64; 2]) -> DVec2 {
    match side {
        0 => DVec2::new(along, rectangle.low.y - out),
        1 => DVec2::new(rectangle.high.x + out, along),
        2 => DVec2::new(along, rectangle.high.y + out),
        _ => DVec2::new(rectangle.low.x - out, along),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;

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
        // It is closed along the outer rectangle.
        assert_eq!(line[5..7], [DVec2::new(100.0, 50.0); 2]);
        assert!(distance(line[7], DVec2::new(108.0, 52.0)) < 1e-9, "{line:?}");
        assert_eq!(line[8..], [[108.0, 68.0], [-8.0, 68.0], [-8.0, -8.0]].map(DVec2::from));
    }

    #[test]
    fn an_end_inside_goes_straight_to_the_border_first_and_one_along_it_only_so_far() {
        let (_, lines) = go_on(&BORDER, &[level(&[&[[40.0, 5.0], [40.0, 30.0], [2.0, 60.0], [1.0, 60.0]]])], 0.1);
        assert_eq!(lines[0][0][..2], [[40.0, -0.8], [40.0, 0.0]].map(DVec2::from));
        // The last piece runs along the top to the left: on by 8 for each outward, but not beyond the corner.
        assert!(distance(lines[0][0][7], DVec2::new(-0.8 + 0.25, 60.8)) < 1e-9, "{:?}", lines[0][0]);
    }

    /// Two lines across the map that meet beyond both sides are one ring; a third, that meets one of them at one side only, goes round by it.
    #[test]
    fn lines_that_meet_beyond_the_border_are_one() {
        let [a, b]: [&[[f64; 2]]; 2] =
            [&[[40.0, 60.0], [30.0, 30.0], [40.0, 0.0]], &[[44.0, 0.0], [54.0, 30.0], [44.0, 60.0]]];
        let (_, lines) = go_on(&BORDER, &[level(&[a, b])], 1.0);
        let [ring] = &lines[0][..] else { panic!("{lines:?}") };
        let reach = |of: fn(f64, f64) -> f64, from: f64| ring.iter().map(|p| p.y).fold(from, of);
        let [low, high] = [reach(f64::min, 0.0), reach(f64::max, 0.0)];
        // They come a third of a pixel nearer per pixel from either side: the tangents meet 6 px outward.
        assert!((low + 3.0).abs() < 1e-9 && (high - 63.0).abs() < 1e-9, "{low} to {high}");
        assert!(ring.iter().all(|p| (30.0..=54.0).contains(&p.x)));

        let c: &[[f64; 2]] = &[[44.0, 60.0], [70.0, 30.0], [70.0, 0.0]];
        let b: &[[f64; 2]] = &[[40.0, 0.0], [30.0, 30.0], [40.0, 60.0]];
        let (outer, lines) = go_on(&BORDER, &[level(&[c, b])], 1.0);
        let [line] = &lines[0][..] else { panic!("{lines:?}") };
        assert!(line.windows(2).all(|w| distance(w[0], w[1]) < 50.0 || w[0].y == outer.low.y), "{line:?}");
        let ends = line.iter().filter(|p| p.y == outer.low.y).count();
        assert_eq!(ends, 2, "{line:?}");
        assert!(line.iter().any(|p| p.y > 60.5) && line.iter().all(|p| p.y < 68.0), "{line:?}");
    }

    /// Ends on a side from 0 to 100, where they reach a rectangle 8 outward, and those that meet.
    fn drawn(runner: &mut TestRunner) -> (Vec<End>, Vec<Arch>) {
        let ends = prop::collection::vec((0.0..100.0f64, -STEEPEST..STEEPEST, 0..2usize), 2..20);
        let mut drawn = ends.new_tree(runner).expect("a draw").current();
        drawn.sort_by(|a, b| a.0.total_cmp(&b.0));
        let end = |(place, slope, level): &(f64, f64, usize)| {
            let ray = Ray { level: *level, place: *place, slope: *slope };
            End { ray, line: 0, is_last: true, reached: place + 8.0 * slope }
        };
        let ends: Vec<End> = drawn.iter().map(end).collect();
        let rays: Vec<Ray> = ends.iter().map(|end| end.ray).collect();
        (ends, arches(&rays, 8.0))
    }

    /// Pairs of lines beyond the border that cross each other.
    fn crossings(ends: &[End], arches: &[Arch]) -> usize {
        let free = (0..ends.len()).filter(|k| !arches.iter().any(|arch| arch.ends.contains(k)));
        let straight = free.map(|k| vec![DVec2::new(ends[k].ray.place, 0.0), DVec2::new(ends[k].reached, 8.0)]);
        let lines: Vec<Polygon> =
            straight.chain(arches.iter().map(|arch| arch.points().map(DVec2::from).collect())).collect();
        let apart = |[p, q]: [DVec2; 2], [a, b]: [DVec2; 2]| (q - p).perp_dot(a - p) * (q - p).perp_dot(b - p) > -1e-9;
        let crosses = |a: &Polygon, b: &Polygon| {
            let pieces = |line: &Polygon| line.windows(2).map(|w| [w[0], w[1]]).collect::<Vec<_>>();
            pieces(a).iter().any(|own| pieces(b).iter().any(|other| !apart(*own, *other) && !apart(*other, *own)))
        };
        (0..lines.len()).map(|k| lines[..k].iter().filter(|other| crosses(&lines[k], other)).count()).sum()
    }

    #[test]
    fn lines_keep_their_order() {
        let mut runner = TestRunner::deterministic();
        let (mut straight, mut through_arches, mut met) = (0, 0, 0);
        for _ in 0..400 {
            let (mut ends, arches) = drawn(&mut runner);
            straight += usize::from(crossings(&ends, &[]) > 0);
            met += arches.len();
            // As if there were no arches in the way.
            let free = |k: &usize| !arches.iter().any(|arch| arch.ends.contains(k));
            let mut twin: Vec<End> = (0..ends.len()).filter(free).map(|k| End { ..ends[k] }).collect();
            put_in_order(&mut twin, &[], [0.0, 100.0], 8.0);
            for (n, k) in (0..ends.len()).filter(free).enumerate() {
                twin[n].line = k;
            }
            let mut others: Vec<End> = ends.iter().map(|end| End { ..*end }).collect();
            twin.iter().for_each(|end| others[end.line].reached = end.reached);
            through_arches += usize::from(crossings(&others, &arches) > 0);

            put_in_order(&mut ends, &arches, [0.0, 100.0], 8.0);
            assert_eq!(crossings(&ends, &arches), 0);
            let free: Vec<&End> = (0..ends.len()).filter(free).map(|k| &ends[k]).collect();
            for w in free.windows(2) {
                let apart = w[1].reached - w[0].reached;
                assert!(apart >= KEPT * (w[1].ray.place - w[0].ray.place) - 1e-9, "{:?} and {:?}", w[0].ray, w[1].ray);
            }
            assert!(free.iter().all(|end| end.reached >= -8.0 && end.reached <= 108.0));
        }
        assert!(straight > 200 && through_arches > 40 && met > 200, "{straight} {through_arches} {met}");
    }
}
