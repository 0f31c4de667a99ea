//! Lines of one region that cross each other. Under even-odd what lies inside both is outside, which few mean who draw two parts that overlap.

use glam::DVec2;

use super::edges::{area, contour_edges};
use super::grid::bounds;
use super::{PlaneDrawing, Polygon};

/// Share of the smaller of two lines' areas that lies, and that does not lie, within the other from which on they cross.
const SHARE: f64 = 0.02;
/// Rows by which areas are measured.
const LINES: usize = 64;
/// Planes that are named.
const NAMED: usize = 6;

/// Words on planes on which lines of a region cross.
pub fn crossing(drawings: &[PlaneDrawing]) -> Option<String> {
    let cross = |region: &Vec<Polygon>| {
        let lines: Vec<Line<'_>> = region.iter().map(Line::new).collect();
        (0..lines.len()).any(|a| (0..a).any(|b| lines[a].crosses(&lines[b])))
    };
    let planes: Vec<&PlaneDrawing> = drawings.iter().filter(|drawing| drawing.regions.iter().any(cross)).collect();
    let named: Vec<String> = planes.iter().take(NAMED).map(|d| format!("`{}` at {}", d.name, d.z)).collect();
    let more = planes.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!named.is_empty()).then(|| {
        format!("lines cross on {}{more}: what lies inside two of them is outside (even-odd); draw parts that overlap as one", named.join(", "))
    })
}

/// A closed line and the box around it.
struct Line<'p> {
    polygon: &'p Polygon,
    bounds: [DVec2; 2],
}

impl<'p> Line<'p> {
    fn new(polygon: &'p Polygon) -> Self {
        Line { polygon, bounds: bounds(polygon.iter()) }
    }

    /// Whether part of the smaller area lies within the other, and part beyond it. What lies inside one line alone has the area `A + B - 2 I`, with I that
    /// of what lies inside both.
    fn crosses(&self, other: &Line<'_>) -> bool {
        let [[low, high], [other_low, other_high]] = [self.bounds, other.bounds];
        if !low.max(other_low).cmplt(high.min(other_high)).all() {
            return false;
        }
        let (low, high) = (low.min(other_low), high.max(other_high));
        let tolerance = 1e-9 * (high - low).max_element();
        let of = |polygons: &[Polygon]| area(&contour_edges(polygons, tolerance), [low.y, high.y], LINES);
        let [a, b] = [self, other].map(|line| of(std::slice::from_ref(line.polygon)));
        let both = 0.5 * (a + b - of(&[self.polygon.clone(), other.polygon.clone()]));
        both > SHARE * a.min(b) && both < (1.0 - SHARE) * a.min(b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle([x, y]: [f64; 2], r: f64) -> Polygon {
        (0..60).map(|k| DVec2::new(x, y) + r * DVec2::from_angle(0.1047 * f64::from(k))).collect()
    }

    fn square([x, y]: [f64; 2], side: f64) -> Polygon {
        [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[a, b]| DVec2::new(x + a, y + b)).into()
    }

    #[test]
    fn what_overlaps_in_part_crosses_and_what_lies_within_beside_or_along_does_not() {
        let disc = circle([0.0; 2], 10.0);
        for (other, crosses) in [
            (circle([8.0, 3.0], 6.0), true),
            (circle([13.0, 0.0], 4.0), true),
            (circle([2.0, 1.0], 5.0), false),
            (circle([0.0; 2], 9.99), false),
            (circle([30.0, 0.0], 6.0), false),
            (circle([14.0, 14.0], 6.0), false),
        ] {
            let [disc, other] = [&disc, &other].map(Line::new);
            assert_eq!([disc.crosses(&other), other.crosses(&disc)], [crosses; 2], "{:?}", other.bounds);
        }
        let [left, right] = [square([0.0; 2], 8.0), square([8.0, 2.0], 8.0)];
        assert!(!Line::new(&left).crosses(&Line::new(&right)), "along a side");
    }

    #[test]
    fn planes_are_named_and_regions_may_overlap() {
        let on = |z: f64, regions: Vec<Vec<Polygon>>| PlaneDrawing { name: format!("k={z}"), z, extra: false, regions };
        let [one, two] = [circle([0.0; 2], 10.0), circle([8.0, 3.0], 6.0)];
        let plane = |z: f64| on(z, vec![vec![one.clone(), two.clone()]]);
        let apart = on(9.0, vec![vec![one.clone()], vec![two.clone()]]);
        let told = crossing(&[plane(0.0), apart.clone(), plane(3.0)]).expect("two planes");
        assert!(told.starts_with("lines cross on `k=0` at 0, `k=3` at 3: "), "{told}");
        assert_eq!(crossing(&[apart]), None);
        let many: Vec<PlaneDrawing> = (0..9).map(|k| plane(f64::from(k))).collect();
        assert!(crossing(&many).is_some_and(|told| told.contains("`k=5` at 5 and 3 more: ")));
    }
}
