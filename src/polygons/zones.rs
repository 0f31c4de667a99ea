//! What closed lines bound, line by line: a line and those drawn right inside it bound a zone, of matter or of none.
//!
//! The width of a zone is `2 A / P`, its area twice over the length of all its lines: the thickness of a wall, the radius of a disc.

use glam::DVec2;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::Polygon;

/// Area, unsigned, and length of a closed line.
fn measures(line: &[DVec2]) -> [f64; 2] {
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

/// Width of the zone inside each line of a region; none for one without area. A line lies in the smallest one that encloses its first point.
pub fn widths(region: &[Polygon]) -> Vec<Option<f64>> {
    let measured: Vec<[f64; 2]> = region.iter().map(|line| measures(line)).collect();
    let boxed = |(k, line): (usize, &Polygon)| {
        let corners = AABB::from_points(line.iter().map(DVec2::to_array).collect::<Vec<_>>().iter());
        GeomWithData::new(Rectangle::from_aabb(corners), k)
    };
    let drawn = region.iter().enumerate().filter(|(k, _)| measured[*k][0] > 0.0);
    let tree = RTree::bulk_load(drawn.map(boxed).collect());
    let mut zones = measured.clone();
    for (k, line) in region.iter().enumerate().filter(|(k, _)| measured[*k][0] > 0.0) {
        let Some(first) = line.first() else { continue };
        let around = tree.locate_all_at_point(first.to_array()).map(|around| around.data);
        let larger = around.filter(|&m| m != k && measured[m][0] > measured[k][0] && encloses(&region[m], *first));
        if let Some(outer) = larger.min_by(|a, b| measured[*a][0].total_cmp(&measured[*b][0])) {
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
    fn lines_without_area_have_no_width_and_lines_that_cross_their_own() {
        let flat = vec![DVec2::ZERO, DVec2::X, 2.0 * DVec2::X];
        let eight = vec![DVec2::ZERO, DVec2::ONE, DVec2::X, DVec2::Y];
        assert_eq!(widths(&[flat, eight, Vec::new(), vec![DVec2::ONE]]), [None; 4]);
        assert!(widths(&[]).is_empty());
        // Three that overlap, of which the largest encloses the others' first points.
        let crossing = [disc([0.0, 0.0, 10.0]), disc([-9.0, 0.0, 9.0]), disc([-8.5, 0.0, 8.0])];
        assert!(widths(&crossing).iter().all(|width| width.is_some_and(|width| width > 0.0)));
    }
}
