//! What closed lines bound, line by line: a line and those drawn right inside it bound a zone, of matter or of none.
//!
//! A line may touch another one, in a point or along a side: what lies where is asked of a point inside a line, not on it.
//!
//! The width of a zone is `2 A / P`, its area twice over the length of all its lines: the thickness of a wall, the radius of a disc.

use std::collections::{HashMap, HashSet};

use glam::DVec2;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::Polygon;
use super::edges::contour_edges;
use super::grid::bounds;

/// Points of a keyhole closer than this, of its size, are one.
const SAME: f64 = 1e-9;

/// Area, unsigned, and length of a closed line.
pub(super) fn measures(line: &[DVec2]) -> [f64; 2] {
    let first = line.first().copied().unwrap_or_default();
    let (mut area, mut length) = (0.0, 0.0);
    for (p, q) in line.iter().zip(line.iter().cycle().skip(1)) {
        // About the first point: far from the origin nothing cancels.
        area += 0.5 * (*p - first).perp_dot(*q - first);
        length += p.distance(*q);
    }
    [area.abs(), length]
}

/// Whether a point lies inside a closed line, by its crossings of the ray to the right.
fn encloses(line: &[DVec2], x: DVec2) -> bool {
    let crosses =
        |p: DVec2, q: DVec2| (p.y > x.y) != (q.y > x.y) && x.x < p.x + (x.y - p.y) / (q.y - p.y) * (q.x - p.x);
    line.iter().zip(line.iter().cycle().skip(1)).filter(|(p, q)| crosses(**p, **q)).count() % 2 == 1
}

/// A point inside a closed line: in the middle of the longest run of the row half way in the largest gap between its points' heights. None where
/// there is no such row.
fn inner_point(line: &[DVec2]) -> Option<DVec2> {
    let mut heights: Vec<f64> = line.iter().map(|p| p.y).collect();
    heights.sort_by(f64::total_cmp);
    let gap = heights.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    let y = 0.5 * (gap[0] + gap[1]);
    let sides = line.iter().zip(line.iter().cycle().skip(1)).filter(|(p, q)| (p.y > y) != (q.y > y));
    let mut crossed: Vec<f64> = sides.map(|(p, q)| p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)).collect();
    crossed.sort_by(f64::total_cmp);
    let run = crossed.chunks_exact(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    Some(DVec2::new(0.5 * (run[0] + run[1]), y))
}

/// For each line of a region the larger ones in which it lies; none for a line without area.
fn around(region: &[Polygon], measured: &[[f64; 2]]) -> Vec<Vec<usize>> {
    let boxed = |(k, line): (usize, &Polygon)| {
        let corners = AABB::from_points(line.iter().map(DVec2::to_array).collect::<Vec<_>>().iter());
        GeomWithData::new(Rectangle::from_aabb(corners), k)
    };
    let drawn = region.iter().enumerate().filter(|(k, _)| measured[*k][0] > 0.0);
    let tree = RTree::bulk_load(drawn.map(boxed).collect());
    let of = |(k, line): (usize, &Polygon)| {
        let point = inner_point(line).filter(|_| measured[k][0] > 0.0);
        let larger = |x: DVec2| {
            let around = tree.locate_all_at_point(x.to_array()).map(|around| around.data);
            around.filter(|&m| measured[m][0] > measured[k][0] && encloses(&region[m], x)).collect()
        };
        point.map_or(Vec::new(), larger)
    };
    region.iter().enumerate().map(of).collect()
}

/// Number of lines of a region that lie in an odd number of others: under even-odd they bound holes.
pub fn holes(region: &[Polygon]) -> usize {
    let measured: Vec<[f64; 2]> = region.iter().map(|line| measures(line)).collect();
    around(region, &measured).iter().filter(|around| around.len() % 2 == 1).count()
}

/// Number of lines of a region that are keyholes: a hole is drawn in the same line. Only where both walks over its bridge have the same points at
/// its ends is such a line known.
pub fn keyholes(region: &[Polygon]) -> usize {
    region.iter().filter(|line| is_keyhole(line)).count()
}

fn is_keyhole(line: &Polygon) -> bool {
    let key = |p: &DVec2| (*p + DVec2::ZERO).to_array().map(f64::to_bits);
    let mut keys: Vec<[u64; 2]> = line.iter().map(key).collect();
    keys.dedup();
    if keys.len() > 1 && keys.first() == keys.last() {
        keys.pop();
    }
    let mut seen = HashSet::new();
    if keys.into_iter().all(|key| seen.insert(key)) {
        return false;
    }
    // Without its bridge it is several closed lines.
    let [low, high] = bounds(line.iter());
    let edges = contour_edges(std::slice::from_ref(line), SAME * (high - low).max_element());
    let mut at: HashMap<[u64; 2], Vec<usize>> = HashMap::new();
    edges.iter().enumerate().for_each(|(k, ends)| ends.iter().for_each(|p| at.entry(key(p)).or_default().push(k)));
    let mut walked = vec![false; edges.len()];
    let mut loops: Vec<Polygon> = Vec::new();
    for first in 0..edges.len() {
        let (mut from, mut next, mut walk) = (edges[first][0], Some(first), Vec::new());
        // Every point has an even number of edges: a walk ends where it began.
        while let Some(k) = next.filter(|k| !walked[*k]) {
            walked[k] = true;
            walk.push(from);
            let [p, q] = edges[k];
            from = if key(&p) == key(&from) { q } else { p };
            next = at.get(&key(&from)).and_then(|edges| edges.iter().copied().find(|k| !walked[*k]));
        }
        loops.extend((!walk.is_empty()).then_some(walk));
    }
    holes(&loops) > 0
}

/// Width of the zone inside each line of a region; none for one without area. A line lies in the smallest one that is around it.
pub fn widths(region: &[Polygon]) -> Vec<Option<f64>> {
    let measured: Vec<[f64; 2]> = region.iter().map(|line| measures(line)).collect();
    let mut zones = measured.clone();
    for (k, around) in around(region, &measured).into_iter().enumerate() {
        if let Some(outer) = around.into_iter().min_by(|a, b| measured[*a][0].total_cmp(&measured[*b][0])) {
            zones[outer][0] -= measured[k][0];
            zones[outer][1] += measured[k][1];
        }
    }
    let width = |([area, length], own): ([f64; 2], [f64; 2])| {
        // Lines that cross may have more inside than they enclose: by themselves, then.
        let [area, length] = if area > 0.0 { [area, length] } else { own };
        let width = 2.0 * area / length;
        (width.is_finite() && width > 0.0).then_some(width)
    };
    zones.into_iter().zip(measured).map(width).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc([x, y, r]: [f64; 3]) -> Polygon {
        (0..256)
            .map(|k| DVec2::new(x, y) + r * DVec2::from_angle(f64::from(k) * std::f64::consts::TAU / 256.0))
            .collect()
    }

    #[test]
    fn walls_are_as_wide_as_they_are_thick_and_what_is_nested_deeper_counts_for_itself() {
        // A tube with an island in it, a disc with two holes, and a disc beside them; in any order.
        let discs = [
            [0.0, 0.0, 20.0],
            [0.0, 0.0, 19.0],
            [1.0, 0.0, 6.0],
            [100.0, 0.0, 30.0],
            [90.0, 0.0, 4.0],
            [112.0, 0.0, 5.0],
            [0.0, 50.0, 2.0],
        ];
        let of_holed = 2.0 * (900.0 - 16.0 - 25.0) / (2.0 * 39.0);
        let expected = [1.0, 2.0 * (361.0 - 36.0) / (2.0 * 25.0), 6.0, of_holed, 4.0, 5.0, 2.0];
        for shift in 0..discs.len() {
            let place = |k: usize| (k + shift) % discs.len();
            let region: Vec<Polygon> = (0..discs.len()).map(|k| disc(discs[place(k)])).collect();
            for (k, width) in widths(&region).into_iter().enumerate() {
                let (width, expected) = (width.expect("an area"), expected[place(k)]);
                assert!((width - expected).abs() < 1e-3 * expected, "{width} for {expected}");
            }
        }
    }

    #[test]
    fn lines_that_touch_lie_beside_each_other_or_within() {
        let square = |[x, y]: [f64; 2], side: f64| -> Polygon {
            [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[a, b]| DVec2::new(x + a, y + b)).into()
        };
        // Each begins where it touches the other; whichever comes first, and wherever the lines begin.
        let large = square([0.0; 2], 10.0);
        for (small, within) in [
            (square([10.0, 0.0], 8.0), false),
            (square([10.0, 10.0], 8.0), false),
            (square([-8.0, 0.0], 8.0), false),
            (square([-8.0, -8.0], 8.0), false),
            (square([0.0; 2], 4.0), true),
            (square([6.0, 0.0], 4.0), true),
            (square([6.0, 6.0], 4.0), true),
            (square([1.0, 1.0], 8.0), true),
        ] {
            for turn in 0..4 {
                let mut small = small.clone();
                small.rotate_left(turn);
                for region in [[large.clone(), small.clone()], [small.clone(), large.clone()]] {
                    assert_eq!(holes(&region), usize::from(within), "{small:?}");
                }
            }
        }
        // Two discs with a point in common are as wide as by themselves.
        for width in widths(&[disc([0.0, 0.0, 10.0]), disc([20.0, 0.0, 10.0 - 1e-9])]) {
            assert!(width.is_some_and(|width| (width - 10.0).abs() < 0.01), "{width:?}");
        }
    }

    #[test]
    fn a_keyhole_is_a_line_with_a_hole_and_an_eight_is_none() {
        let square = |[x, y]: [f64; 2], side: f64| -> Polygon {
            [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]]
                .map(|[a, b]| DVec2::new(x + a, y + b))
                .into()
        };
        let joined = |lines: &[Polygon]| -> Polygon { lines.concat() };
        let (outer, inner) = (square([0.0; 2], 20.0), square([4.0, 6.0], 8.0));
        let back: Polygon = inner.iter().rev().copied().collect();
        for hole in [&inner, &back] {
            assert_eq!(
                [keyholes(&[joined(&[outer.clone(), hole.clone()])]), holes(std::slice::from_ref(&outer))],
                [1, 0]
            );
        }
        // Closed squares, two joined by a bridge, two with a corner in common, and one that is walked twice.
        let beside = joined(&[outer.clone(), square([30.0, 0.0], 8.0)]);
        let eight = joined(&[outer.clone(), square([-8.0, -8.0], 8.0)]);
        for line in [outer.clone(), beside, eight, joined(&[outer.clone(), outer]), Vec::new()] {
            assert_eq!(keyholes(std::slice::from_ref(&line)), 0, "{line:?}");
        }
    }

    #[test]
    fn lines_without_area_have_no_width_and_lines_that_cross_their_own() {
        let flat = vec![DVec2::ZERO, DVec2::X, 2.0 * DVec2::X];
        let eight = vec![DVec2::ZERO, DVec2::ONE, DVec2::X, DVec2::Y];
        assert_eq!(widths(&[flat, eight, Vec::new(), vec![DVec2::ONE]]), [None; 4]);
        assert!(widths(&[]).is_empty());
        // Three that overlap, of which the largest encloses points of the others.
        let crossing = [disc([0.0, 0.0, 10.0]), disc([-9.0, 0.0, 9.0]), disc([-8.5, 0.0, 8.0])];
        assert!(widths(&crossing).iter().all(|width| width.is_some_and(|width| width > 0.0)));
    }
}
