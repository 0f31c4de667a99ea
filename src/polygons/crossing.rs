//! Lines of one region that cross each other, and lines that go twice round some of what they bound. Under even-odd what lies inside twice is outside,
//! which few mean who draw two parts that overlap, or draw on beyond the point at which they began.

use glam::DVec2;

use super::edges::{area, contour_edges};
use super::grid::bounds;
use super::{PlaneDrawing, Polygon};

/// Share of the smaller of two lines' areas that lies, and that does not lie, within the other from which on they cross.
const SHARE: f64 = 0.02;
/// Share of an area that rounding may bring in.
const LEAST: f64 = 1e-6;
/// Rows by which areas are measured.
const LINES: usize = 64;
/// Planes that are named.
const NAMED: usize = 6;

/// Words on planes on which lines of a region cross, and on those on which a line goes twice round something.
pub fn crossing(drawings: &[PlaneDrawing]) -> Vec<String> {
    let cross = |region: &Vec<Polygon>| {
        let lines: Vec<Line<'_>> = region.iter().map(Line::new).collect();
        (0..lines.len()).any(|a| (0..a).any(|b| lines[a].crosses(&lines[b])))
    };
    let twice = |region: &Vec<Polygon>| region.iter().any(|polygon| Line::new(polygon).goes_twice());
    let crossing = planes(drawings, cross).map(|on| {
        format!(
            "lines cross on {on}: what lies inside two of them is outside (even-odd); draw parts that overlap as one"
        )
    });
    let twice = planes(drawings, twice).map(|on| {
        format!("a line crosses itself on {on}: what it goes round twice is outside (even-odd); end it where it began")
    });
    crossing.into_iter().chain(twice).collect()
}

/// The planes of which a region is as `of` says, by name and height.
fn planes(drawings: &[PlaneDrawing], of: impl Fn(&Vec<Polygon>) -> bool) -> Option<String> {
    let planes: Vec<&PlaneDrawing> = drawings.iter().filter(|drawing| drawing.regions.iter().any(&of)).collect();
    let named: Vec<String> = planes.iter().take(NAMED).map(|d| format!("`{}` at {}", d.name, d.z)).collect();
    let more = planes.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!named.is_empty()).then(|| format!("{}{more}", named.join(", ")))
}

/// Areas that two closed lines bound.
pub struct Overlap {
    /// Of each alone.
    pub areas: [f64; 2],
    /// What lies inside both.
    pub both: f64,
}

impl Overlap {
    /// What lies inside one line alone has the area `A + B - 2 I`, with I that of what lies inside both.
    pub fn new(lines: [&Polygon; 2]) -> Self {
        let [low, high] = bounds(lines.into_iter().flatten());
        let tolerance = 1e-9 * (high - low).max_element();
        let of = |polygons: &[Polygon]| area(&contour_edges(polygons, tolerance), [low.y, high.y], LINES);
        let areas @ [a, b] = lines.map(|line| of(std::slice::from_ref(line)));
        Overlap { areas, both: 0.5 * (a + b - of(&lines.map(Polygon::clone))) }
    }
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

    /// Whether they have an area in common, and each has one beyond the other, of which neither is but a share of [`SHARE`]: of the smaller area, or of what lies
    /// inside one line alone. Of a line that is drawn again a little beside the latter is little itself.
    fn crosses(&self, other: &Line<'_>) -> bool {
        let [[low, high], [other_low, other_high]] = [self.bounds, other.bounds];
        if !low.max(other_low).cmplt(high.min(other_high)).all() {
            return false;
        }
        let Overlap { areas, both } = Overlap::new([self.polygon, other.polygon]);
        let (smaller, alone) = (areas[0].min(areas[1]), areas[0] + areas[1] - 2.0 * both);
        both > SHARE * smaller && smaller - both > SHARE * smaller.min(alone).max(LEAST * smaller)
    }

    /// Whether it goes twice, or any other even number of times, round more than [`SHARE`] of what it bounds. A way to a hole and back goes round the
    /// hole once more the other way, which is not at all; the loops of an eight are gone round once each.
    fn goes_twice(&self) -> bool {
        let [low, high] = self.bounds.map(|p| p.y);
        let step = (high - low) / LINES as f64;
        let height = |row: usize| low + (row as f64 + 0.5) * step;
        let mut rows: Vec<Vec<(f64, i32)>> = vec![Vec::new(); LINES];
        for (k, q) in self.polygon.iter().enumerate() {
            let p = self.polygon[k.checked_sub(1).unwrap_or(self.polygon.len() - 1)];
            // Numbers of the first rows above both; casting saturates.
            let [from, to] = [p, *q].map(|v| ((v.y - low) / step + 0.5).floor() as usize).map(|row| row.min(LINES));
            let between = from.min(to)..from.max(to);
            for (row, crossings) in between.clone().zip(&mut rows[between]) {
                let t = (height(row) - p.y) / (q.y - p.y);
                crossings.push((p.x + t.clamp(0.0, 1.0) * (q.x - p.x), if to > from { 1 } else { -1 }));
            }
        }
        let [mut all, mut even] = [0.0; 2];
        for row in &mut rows {
            row.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut winding = 0;
            for pair in row.windows(2) {
                winding += pair[0].1;
                let length = pair[1].0 - pair[0].0;
                all += if winding == 0 { 0.0 } else { length };
                even += if winding != 0 && winding % 2 == 0 { length } else { 0.0 };
            }
        }
        even > SHARE * all
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
            (circle([0.3, 0.0], 10.2), true),
            (circle([0.1, 0.0], 10.0), true),
            (circle([0.1, 0.0], 10.2), false),
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
    fn a_line_goes_twice_round_what_it_overlaps_and_not_round_holes_and_loops() {
        let around = |turns: f64, r: fn(f64) -> f64| -> Polygon {
            let at = |k: i32| f64::from(k) / 200.0 * turns;
            (0..200).map(|k| r(at(k)) * DVec2::from_angle(std::f64::consts::TAU * at(k))).collect()
        };
        // A spiral, a circle drawn on for a third of a turn farther out, and only a little too far.
        assert!(Line::new(&around(2.0, |t| 5.0 + t)).goes_twice());
        assert!(Line::new(&around(1.33, |t| if t < 1.0 { 5.0 } else { 5.5 })).goes_twice());
        assert!(!Line::new(&around(1.01, |t| 5.0 + 0.1 * t)).goes_twice());
        let back: Polygon = around(2.0, |t| 5.0 + t).into_iter().rev().collect();
        assert!(Line::new(&back).goes_twice(), "whichever way it goes");
        // A circle, an eight, a ring with a way to its hole, and the same with a hole drawn the way that makes it none.
        assert!(!Line::new(&around(1.0, |_| 5.0)).goes_twice());
        let eight: Polygon =
            (0..200).map(|k| 0.0314 * f64::from(k)).map(|t| DVec2::new(5.0 * t.sin(), 3.0 * (2.0 * t).sin())).collect();
        assert!(!Line::new(&eight).goes_twice());
        let mut hole = square([3.0, 3.0], 2.0);
        hole.push(hole[0]);
        let ring = |hole: &mut dyn Iterator<Item = DVec2>| -> Polygon {
            let outer = square([0.0; 2], 8.0);
            outer.iter().copied().chain([outer[0]]).chain(hole).collect()
        };
        assert!(!Line::new(&ring(&mut hole.iter().rev().copied())).goes_twice());
        assert!(Line::new(&ring(&mut hole.iter().copied())).goes_twice());
    }

    #[test]
    fn planes_are_named_and_regions_may_overlap() {
        let on = |z: f64, regions: Vec<Vec<Polygon>>| PlaneDrawing { name: format!("k={z}"), z, extra: false, regions };
        let [one, two] = [circle([0.0; 2], 10.0), circle([8.0, 3.0], 6.0)];
        let plane = |z: f64| on(z, vec![vec![one.clone(), two.clone()]]);
        let apart = on(9.0, vec![vec![one.clone()], vec![two.clone()]]);
        let told = crossing(&[plane(0.0), apart.clone(), plane(3.0)]);
        assert!(told.len() == 1 && told[0].starts_with("lines cross on `k=0` at 0, `k=3` at 3: "), "{told:?}");
        assert_eq!(crossing(&[apart]), Vec::<String>::new());
        let many: Vec<PlaneDrawing> = (0..9).map(|k| plane(f64::from(k))).collect();
        assert!(crossing(&many).iter().any(|told| told.contains("`k=5` at 5 and 3 more: ")));
    }
}
