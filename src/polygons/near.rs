//! Closed lines that nearly coincide: a contour that was drawn, or written, twice, with other points or a little beside. Under even-odd such a
//! pair bounds a sliver along the line, and what it goes round is gone.
//!
//! A ring as thin may be meant. Its two lines do not cross, and it is one from a tenth of a pixel on. Lines that cross bound no ring: they are
//! compared by the pixel that one of them would have alone, as the sliver between them makes the drawing's own pixels small. And whatever a pixel is one is
//! a copy of the other that has nine tenths of its area, and as much beyond it as it leaves out.

use std::collections::{BTreeSet, HashSet};

use glam::DVec2;
use rstar::primitives::{GeomWithData, Line};
use rstar::{AABB, RTree};

use super::crossing::Overlap;
use super::grid::{bounds, figures};
use super::pixel::pixel_side;
use super::zones::measures;
use super::{PlaneDrawing, Polygon};

/// Lines nowhere farther apart than this, px, are one.
const APART: f64 = 0.1;
/// Boxes around two lines that differ by less, of their longer side, are looked at closely.
const LIKE: f64 = 0.125;
/// Pixels along the longer side of the box around a line are at least so many where they are chosen for it alone: its mean width is half of that side
/// at most, and has eight.
const LARGEST: f64 = 16.0;

/// Share of the larger of two areas that a line drawn again has at least.
const AGAIN: f64 = 0.9;
/// Share of what lies inside one of them alone that is on either side, at least: half and half where a line is drawn again beside, nothing of a ring.
const EITHER: f64 = 0.25;

/// A line that nearly coincides with one before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearCopy {
    /// Number of the line in its region, from 0.
    pub line: usize,
    /// Number of the one before.
    pub of: usize,
    /// The farthest that a point of one lies from the other, in the unit.
    pub apart: f64,
}

impl NearCopy {
    /// What is said of both lines, after their names.
    pub fn says(&self) -> String {
        format!("nearly coincide, at most {} apart, and would cancel", figures(self.apart))
    }
}

/// Lines of a region that nearly coincide with one before that is none of them. `pixel` is the side of the drawing's pixels; it is asked for
/// where two lines are alike.
pub fn near_copies(region: &[Polygon], pixel: &dyn Fn() -> f64) -> Vec<NearCopy> {
    let drawn = |line: &usize| measures(&region[*line])[0] > 0.0;
    let boxed = |line: usize| {
        let [low, high] = bounds(region[line].iter());
        GeomWithData::new([low.x, low.y, high.x, high.y], line)
    };
    let boxes: Vec<_> = (0..region.len()).filter(drawn).map(boxed).collect();
    let tree = RTree::bulk_load(boxes.clone());
    let mut copies: Vec<NearCopy> = Vec::new();
    let mut left_out = HashSet::new();
    for own in &boxes {
        let (corners, line) = (own.geom(), own.data);
        let longer = (corners[2] - corners[0]).max(corners[3] - corners[1]);
        let around = |slack: f64| AABB::from_corners(corners.map(|x| x - slack), corners.map(|x| x + slack));
        let before = |slack: f64| {
            let alike = tree.locate_in_envelope(around(slack)).map(|other| other.data);
            alike.filter(|of| *of < line && !left_out.contains(of)).collect::<BTreeSet<usize>>()
        };
        let alike = before(LIKE * longer);
        if alike.is_empty() {
            continue;
        }
        let nearest = before(APART * pixel().max(longer / LARGEST));
        let found = alike.into_iter().find_map(|of| {
            let lines = [&region[line], &region[of]];
            let near = nearest.contains(&of).then(|| near(lines, pixel)).flatten();
            Some((of, near.or_else(|| drawn_again(lines))?))
        });
        if let Some((of, apart)) = found {
            left_out.insert(line);
            copies.push(NearCopy { line, of, apart });
        }
    }
    copies
}

/// How far two lines are apart, if they nearly coincide.
fn near(lines: [&Polygon; 2], pixel: &dyn Fn() -> f64) -> Option<f64> {
    let alone = |line: &Polygon| {
        pixel_side(&[PlaneDrawing { name: String::new(), z: 0.0, extra: false, regions: vec![vec![line.clone()]] }])
    };
    let [as_drawn, most] = {
        let pixel = pixel();
        [pixel, pixel.max(alone(lines[1]))].map(|side| APART * side)
    };
    // A line that goes twice round another is as near, and is another thing.
    let [[area, length], [other_area, other_length]] = lines.map(|line| measures(line));
    if (area - other_area).abs() > most * length.max(other_length) {
        return None;
    }
    let trees = lines.map(|line| RTree::bulk_load(sides(line).collect()));
    let apart = farthest(lines[0], &trees[1], most)?.max(farthest(lines[1], &trees[0], most)?);
    (apart <= as_drawn || cross(lines[0], &trees[1])).then_some(apart)
}

/// How far two lines are apart, if one is the other drawn again a little beside.
fn drawn_again(lines: [&Polygon; 2]) -> Option<f64> {
    let Overlap { areas, both } = Overlap::new(lines);
    let beyond = areas.map(|area| area - both);
    let alike = both > AGAIN * areas[0].max(areas[1]) && beyond[0].min(beyond[1]) > EITHER * (beyond[0] + beyond[1]);
    let trees = lines.map(|line| RTree::bulk_load(sides(line).collect()));
    if !alike || !cross(lines[0], &trees[1]) {
        return None;
    }
    let apart = [farthest(lines[0], &trees[1], f64::INFINITY)?, farthest(lines[1], &trees[0], f64::INFINITY)?];
    Some(apart[0].max(apart[1]))
}

/// Sides of a line that have a length.
fn sides(line: &Polygon) -> impl Iterator<Item = Line<[f64; 2]>> {
    let ends = line.iter().zip(line.iter().cycle().skip(1));
    ends.filter(|(p, q)| p != q).map(|(p, q)| Line::new(p.to_array(), q.to_array()))
}

/// The farthest that a point of a line lies from a side of the other; none beyond `most`.
fn farthest(line: &Polygon, other: &RTree<Line<[f64; 2]>>, most: f64) -> Option<f64> {
    line.iter().try_fold(0.0, |farthest: f64, p| {
        let (_, squared) = other.nearest_neighbor_iter_with_distance_2(p.to_array()).next()?;
        let apart = squared.sqrt();
        (apart <= most).then_some(farthest.max(apart))
    })
}

/// Whether a side of a line goes from one side of a side of the other to the other side of it.
fn cross(line: &Polygon, other: &RTree<Line<[f64; 2]>>) -> bool {
    let parted = |[a, b]: [DVec2; 2], [p, q]: [DVec2; 2]| {
        let side = |x: DVec2| (b - a).perp_dot(x - a);
        side(p) * side(q) < 0.0
    };
    sides(line).any(|own| {
        let ends = [own.from, own.to].map(DVec2::from);
        let around = AABB::from_corners(own.from, own.to);
        other.locate_in_envelope_intersecting(around).any(|theirs| {
            let theirs = [theirs.from, theirs.to].map(DVec2::from);
            parted(ends, theirs) && parted(theirs, ends)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle([x, y]: [f64; 2], r: f64, points: u32) -> Polygon {
        let turn = std::f64::consts::TAU / f64::from(points);
        (0..points).map(|k| DVec2::new(x, y) + r * DVec2::from_angle(turn * f64::from(k))).collect()
    }

    fn copies(region: &[Polygon], pixel: f64) -> Vec<[usize; 2]> {
        near_copies(region, &|| pixel).iter().map(|copy| [copy.line, copy.of]).collect()
    }

    #[test]
    fn a_line_drawn_again_is_a_copy_and_a_thin_ring_is_none() {
        let disc = circle([100.0, 50.0], 20.0, 60);
        let mut turned = disc.clone();
        turned.rotate_left(7);
        turned.reverse();
        let resampled = circle([100.0, 50.0], 20.0, 61);
        let beside = |by: f64| circle([100.0 + by, 50.0], 20.0, 60);
        for other in [turned, resampled, beside(1e-4), beside(0.01), circle([100.0, 50.0], 19.99, 60)] {
            assert_eq!(copies(&[disc.clone(), other.clone()], 0.15), [[1, 0]], "{:?}", other[0]);
            assert_eq!(copies(&[other, disc.clone()], 0.15), [[1, 0]]);
        }
        // Beside by whole pixels it is one, too.
        for by in [0.3, 1.0, 2.5] {
            assert_eq!(copies(&[disc.clone(), beside(by)], 0.15), [[1, 0]], "{by}");
        }
        // By the pixels that are given a ring is thick, as is one that touches; a part that overlaps is another.
        for other in [
            circle([100.0, 50.0], 19.97, 60),
            circle([100.5, 50.0], 19.5, 60),
            circle([100.0, 50.0], 10.0, 60),
            beside(4.0),
        ] {
            assert_eq!(copies(&[disc.clone(), other.clone()], 0.15), <[[usize; 2]; 0]>::default(), "{:?}", other[0]);
        }
        assert_eq!(copies(&[disc.clone(), circle([100.0, 50.0], 19.99, 60)], 0.05), <[[usize; 2]; 0]>::default());
        // A line that goes round twice is no copy of one that goes once.
        let twice: Polygon = disc.iter().chain(&disc).copied().collect();
        assert_eq!(copies(&[disc.clone(), twice], 0.15), <[[usize; 2]; 0]>::default());
    }

    #[test]
    fn of_three_the_first_stays_and_a_notch_is_seen() {
        let disc = |x: f64, y: f64| circle([x, y], 20.0, 60);
        let region = [disc(0.0, 0.0), disc(90.0, 0.0), disc(0.001, 0.0), disc(0.0, 90.0), disc(0.0, 0.001)];
        assert_eq!(copies(&region, 1.0), [[2, 0], [4, 0]]);
        let mut notched = disc(0.0, 0.0);
        notched[30] *= 0.9;
        assert_eq!(copies(&[disc(0.0, 0.0), notched], 1.0), <[[usize; 2]; 0]>::default());
    }
}
