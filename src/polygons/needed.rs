//! Points that lines need: those that lie near the straight line through others say nothing, however many they are.
//!
//! A run is a stretch of a line all of whose points lie within a distance of the straight line between its ends. Each side of a line counts for the
//! longest run that it is in, and no line has a beginning: whichever point comes first, whichever way round, the runs are the same.

use glam::DVec2;
use rayon::prelude::*;

use super::Polygon;

/// Runs begin at every point, but no closer than this part of the points of the last one: straight sides with very many points take no longer.
const STRIDE: usize = 64;
/// Half of all points but for rounding: of two halves the nearer points count.
const HALF: f64 = 0.5 - 1e-9;

/// What is left of lines without the points that say nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Needed {
    /// Median distance of neighbouring points.
    pub points: f64,
    /// Their number.
    pub count: f64,
}

/// The points that lines need where `off` is nothing; none where they have no length.
pub fn needed<'l>(lines: impl Iterator<Item = &'l Polygon>, off: f64) -> Option<Needed> {
    let lines: Vec<&Polygon> = lines.collect();
    let mut sides: Vec<Side> = lines.par_iter().flat_map_iter(|line| sides(line, off)).collect();
    sides.sort_by(|a, b| a.chord.total_cmp(&b.chord).then(a.share.total_cmp(&b.share)));
    let count: f64 = sides.iter().map(|side| side.share).sum();
    let mut below = 0.0;
    let middle = sides.iter().find(|side| {
        below += side.share;
        below >= HALF * count
    });
    middle.map(|side| Needed { points: side.chord, count })
}

/// A side of a line.
#[derive(Debug, Clone, Copy)]
struct Side {
    /// Between the ends of the longest run that it is in.
    chord: f64,
    /// Its share of that run.
    share: f64,
}

/// The sides of a closed line.
fn sides(line: &Polygon, off: f64) -> Vec<Side> {
    let mut points = line.clone();
    points.dedup();
    while points.len() > 1 && points.first() == points.last() {
        points.pop();
    }
    let n = points.len();
    if n < 2 {
        return Vec::new();
    }
    let lengths: Vec<f64> = (0..n).map(|k| points[k].distance(points[(k + 1) % n])).collect();
    let mut sides = vec![Side { chord: 0.0, share: 1.0 }; n];
    for forward in [true, false] {
        // Point k of the walk, and the side from it to the next.
        let at = |k: usize| if forward { k % n } else { n - 1 - k % n };
        let side = |k: usize| if forward { k % n } else { (2 * n - 2 - k % n) % n };
        let mut start = 0;
        while start < n {
            let count = run(|k| points[at(start + k)], n, off);
            let chord = points[at(start)].distance(points[at(start + count)]);
            let length: f64 = (start..start + count).map(|k| lengths[side(k)]).sum();
            for k in (start..start + count).map(side) {
                if chord > sides[k].chord {
                    sides[k] = Side { chord, share: lengths[k] / length };
                }
            }
            start += 1 + count / STRIDE;
        }
    }
    sides
}

/// How many sides of a closed line of `n` points, from point 0 on, are a run.
fn run(point: impl Fn(usize) -> DVec2, n: usize, off: f64) -> usize {
    let first = point(0);
    // Directions to all points so far, as wide as what is nothing.
    let mut sector: Option<[DVec2; 2]> = None;
    let mut farthest = 0.0f64;
    for k in 1..n {
        let to = point(k) - first;
        let length = to.length();
        let outside = sector.is_some_and(|[right, left]| right.perp_dot(to) < 0.0 || to.perp_dot(left) < 0.0);
        // A line that comes back is no straight one.
        if outside || length < farthest - off {
            return (k - 1).max(1);
        }
        farthest = farthest.max(length);
        if length > off {
            let sine = off / length;
            let own = [-sine, sine].map(|sine| DVec2::new((1.0 - sine * sine).sqrt(), sine).rotate(to));
            sector = Some(sector.map_or(own, |[right, left]| {
                [
                    if right.perp_dot(own[0]) > 0.0 { own[0] } else { right },
                    if own[1].perp_dot(left) > 0.0 { own[1] } else { left },
                ]
            }));
        }
    }
    n - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(line: &[[f64; 2]], off: f64) -> Needed {
        needed([line.iter().copied().map(DVec2::from).collect()].iter(), off).expect("a line")
    }

    #[test]
    fn sides_are_as_long_as_the_runs_that_they_are_in() {
        // A rectangle of 8 x 4, whose points are 1 apart, but for one that is 0.1 off.
        let rectangle: Vec<[f64; 2]> = (0..24)
            .map(|k: u8| match f64::from(k) {
                k if k < 8.0 => [k, 0.0],
                k if k < 12.0 => [8.0, k - 8.0],
                k if k < 20.0 => [20.0 - k, if k == 15.0 { 4.1 } else { 4.0 }],
                k => [0.0, 24.0 - k],
            })
            .collect();
        let found = of(&rectangle, 0.2);
        assert!((found.count - 4.0).abs() < 1e-9 && found.points == 4.0, "{found:?}");
        let found = of(&rectangle, 0.01);
        assert!((found.count - 7.0).abs() < 1e-9 && found.points == 4.0, "{found:?}");
        let corners = [[0.0, 0.0], [8.0, 0.0], [8.0, 4.0], [0.0, 4.0], [0.0, 0.0]];
        assert_eq!(of(&corners, 0.01), Needed { points: 4.0, count: 4.0 });
        assert_eq!(needed([Polygon::new(), vec![DVec2::ONE; 4]].iter(), 0.1), None);
    }

    #[test]
    fn a_line_there_and_back_is_two_runs_and_one_that_is_nothing_has_an_end() {
        let there_and_back = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [2.0, 0.0], [1.0, 0.0]];
        let found = of(&there_and_back, 0.1);
        assert!((found.count - 2.0).abs() < 1e-9 && found.points == 3.0, "{found:?}");
        assert!(of(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 5.0).count >= 1.0);
    }
}
