//! Parts of two neighbouring slices side by side: what overlaps, what misses its partner, and which of those look like one and the same.

use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::ops::RangeInclusive;

use glam::DVec2;

use crate::grid::components::Components;
use crate::grid::seen::Seen;

/// Area ratios of parts that may be the same.
const SIMILAR: RangeInclusive<f64> = 0.5..=2.0;
/// Least intersection over union of such parts once their centroids lie on each other.
const LEAST_IOU: f64 = 0.6;
/// Parts whose distances differ by less than this are as near, px: rounding must not decide which is the nearer.
const AS_NEAR: f64 = 1e-9;

/// A solid part of a slice.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its number, from 1.
    pub number: u32,
    /// Its pixels.
    pub nodes: Vec<usize>,
    /// Mean position of its pixels, pixels.
    pub centroid: DVec2,
    /// Radius of the circle of the same area, px.
    pub radius: f64,
}

/// All parts of a slice, by number; `h` is the pixel's size in units of its larger side.
pub fn parts(solids: &Components, dims: [usize; 2], h: [f64; 2]) -> Vec<Part> {
    parts_seen(solids, dims, h, &Seen::ALL)
}

/// The same, each of its pixels that are `seen`.
pub fn parts_seen(solids: &Components, [nx, _]: [usize; 2], h: [f64; 2], seen: &Seen) -> Vec<Part> {
    let mut nodes: Vec<Vec<usize>> = vec![Vec::new(); solids.count + 1];
    let counts = |(node, label): &(usize, &u32)| **label > 0 && seen.has(*node, nx);
    for (node, &label) in solids.labels.iter().enumerate().filter(counts) {
        nodes[label as usize].push(node);
    }
    let part = |(number, nodes): (u32, Vec<usize>)| {
        let count = nodes.len() as f64;
        // Whole numbers: the order of the sum does not matter.
        let sum = nodes.iter().fold([0, 0], |s, n| [s[0] + n % nx, s[1] + n / nx]);
        let radius = (count * h[0] * h[1] / PI).sqrt();
        Part { number, centroid: DVec2::from(sum.map(|s| s as f64)) / count, radius, nodes }
    };
    (0..).zip(nodes).skip(1).map(part).collect()
}

/// Pairs of parts that share a pixel.
pub fn overlaps(low: &Components, high: &Components) -> BTreeSet<(u32, u32)> {
    low.labels.iter().zip(&high.labels).filter(|(a, b)| **a > 0 && **b > 0).map(|(a, b)| (*a, *b)).collect()
}

/// Two parts without partner, one of them the other's nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Part below.
    pub from: u32,
    /// Part above.
    pub to: u32,
    /// Distance of the centroids in radii of the larger part.
    pub distance: f64,
    /// Area above over area below.
    pub area_ratio: f64,
    /// Intersection over union once the centroids lie on each other.
    pub iou: f64,
    /// Each is the other's nearest.
    pub mutual: bool,
}

impl Candidate {
    /// Whether they are taken for one and the same: mutual, similar, and less than `reach` radii apart.
    pub fn convinces(&self, reach: f64) -> bool {
        self.mutual && self.distance < reach && SIMILAR.contains(&self.area_ratio) && self.iou > LEAST_IOU
    }
}

/// Candidates among the parts of two slices that have no partner, `known` pairs left out. Of two that are as near neither is the nearest: their numbers
/// say in which order an image's rows are read, no more.
pub fn candidates(
    low: &[Part],
    high: &[Part],
    known: &BTreeSet<(u32, u32)>,
    partners: &BTreeSet<(u32, u32)>,
    dims: [usize; 2],
    h: [f64; 2],
) -> Vec<Candidate> {
    let lone_low: Vec<&Part> = low.iter().filter(|p| !partners.iter().any(|(a, _)| *a == p.number)).collect();
    let lone_high: Vec<&Part> = high.iter().filter(|p| !partners.iter().any(|(_, b)| *b == p.number)).collect();
    let allowed = |a: &Part, b: &Part| !known.contains(&(a.number, b.number));
    let nearest = |own: &Part, others: &[&Part], allowed: &dyn Fn(&Part) -> bool| {
        let mut allowed: Vec<_> = others.iter().filter(|p| allowed(p)).map(|p| (apart(own, p, h), p.number)).collect();
        allowed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, second) = (allowed.first()?, allowed.get(1));
        second.is_none_or(|second| second.0 - first.0 > AS_NEAR).then_some(first.1)
    };
    let of_low: Vec<(u32, u32)> =
        lone_low.iter().filter_map(|a| nearest(a, &lone_high, &|b| allowed(a, b)).map(|b| (a.number, b))).collect();
    let of_high: Vec<(u32, u32)> =
        lone_high.iter().filter_map(|b| nearest(b, &lone_low, &|a| allowed(a, b)).map(|a| (a, b.number))).collect();
    let pairs: BTreeSet<(u32, u32)> = of_low.iter().chain(&of_high).copied().collect();
    let candidate = |(from, to): (u32, u32)| {
        let (a, b) = (&low[from as usize - 1], &high[to as usize - 1]);
        Candidate {
            from,
            to,
            distance: apart(a, b, h) / a.radius.max(b.radius),
            area_ratio: b.nodes.len() as f64 / a.nodes.len() as f64,
            iou: aligned_iou(a, b, dims),
            mutual: of_low.contains(&(from, to)) && of_high.contains(&(from, to)),
        }
    };
    pairs.into_iter().map(candidate).collect()
}

/// Distance of the centroids, px of the larger side.
fn apart(a: &Part, b: &Part, h: [f64; 2]) -> f64 {
    let way = DVec2::from(h) * (a.centroid - b.centroid);
    libm::hypot(way.x, way.y)
}

/// Intersection over union after a shift by whole pixels that brings the centroids together.
fn aligned_iou(a: &Part, b: &Part, [nx, ny]: [usize; 2]) -> f64 {
    let shift = (b.centroid - a.centroid).round().as_i64vec2();
    let moved = |&n: &usize| {
        let (i, j) = ((n % nx) as i64 + shift.x, (n / nx) as i64 + shift.y);
        let within = (0..nx as i64).contains(&i) && (0..ny as i64).contains(&j);
        within.then_some((j * nx as i64 + i) as usize)
    };
    // Nodes of a part are in row order.
    let common = a.nodes.iter().filter_map(moved).filter(|n| b.nodes.binary_search(n).is_ok()).count();
    common as f64 / (a.nodes.len() + b.nodes.len() - common) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::label4;

    #[test]
    fn of_two_parts_that_are_as_near_neither_is_the_nearest() {
        let dims = [9, 3];
        let at = |columns: &[usize]| {
            let inside: Vec<bool> = (0..27).map(|n| n / 9 == 1 && columns.contains(&(n % 9))).collect();
            parts(&label4(&inside, dims), dims, [1.0; 2])
        };
        let found = |high: &[usize]| {
            let all = candidates(&at(&[4]), &at(high), &BTreeSet::new(), &BTreeSet::new(), dims, [1.0; 2]);
            all.iter().map(|c| (c.to, c.mutual)).collect::<Vec<_>>()
        };
        assert_eq!(found(&[2, 6]), [(1, false), (2, false)]);
        assert_eq!(found(&[2, 7]), [(1, true), (2, false)]);
        assert_eq!(found(&[1, 6]), [(1, false), (2, true)]);
    }

    #[test]
    fn a_part_is_what_lies_on_the_image() {
        let solids = label4(&[true; 24], [6, 4]);
        let of = |seen: &Seen| parts_seen(&solids, [6, 4], [1.0; 2], seen)[0].clone();
        let [all, own] = [of(&Seen::ALL), of(&Seen::image([4..6, 0..4]))];
        assert_eq!((all.nodes.len(), all.centroid), (24, DVec2::new(2.5, 1.5)));
        assert_eq!((own.nodes.len(), own.centroid), (8, DVec2::new(4.5, 1.5)));
        assert!((PI * own.radius.powi(2) - 8.0).abs() < 1e-12);
    }
}
