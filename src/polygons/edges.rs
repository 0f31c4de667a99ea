//! Edges of polygons at which inside and outside meet.
//!
//! A keyhole (an outer line and a hole drawn as one polygon) walks its bridge there and back: under even-odd the two walks cancel, and so
//! must their edges, or pixels near the bridge would be told that a contour is near.

use std::collections::HashMap;

use glam::DVec2;
use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};

use super::Polygon;

/// A straight piece of contour.
pub type Edge = [DVec2; 2];

/// Edges that an odd number of the polygons' sides run along. Points closer than `tolerance` are taken for one, and sides are cut at points
/// that lie on them that closely, so that a bridge cancels however its two walks are divided. Every point has an even number of edges:
/// together they are closed.
pub fn contour_edges(polygons: &[Polygon], tolerance: f64) -> Vec<Edge> {
    let mut weld = Weld { tolerance, points: Vec::new(), cells: HashMap::new() };
    let mut sides = Vec::new();
    for polygon in polygons {
        let numbers: Vec<u32> = polygon.iter().map(|p| weld.number(*p)).collect();
        let next = numbers.iter().cycle().skip(1);
        sides.extend(numbers.iter().zip(next).filter(|(a, b)| a != b).map(|(a, b)| [*a, *b]));
    }
    let points = weld.points;
    let tree = RTree::bulk_load(points.iter().zip(0u32..).map(|(p, k)| GeomWithData::new(p.to_array(), k)).collect());
    let mut order = Vec::new();
    let mut count: HashMap<[u32; 2], usize> = HashMap::new();
    for side in sides {
        for [a, b] in cut(side, &points, &tree, tolerance) {
            let key = [a.min(b), a.max(b)];
            let n = count.entry(key).or_insert(0);
            if *n == 0 {
                order.push(key);
            }
            *n += 1;
        }
    }
    let odd = |key: &[u32; 2]| count.get(key).is_some_and(|n| n % 2 == 1);
    order.into_iter().filter(odd).map(|[a, b]| [points[a as usize], points[b as usize]]).collect()
}

/// Points by number, each farther than `tolerance` from those before.
struct Weld {
    tolerance: f64,
    points: Vec<DVec2>,
    cells: HashMap<[i64; 2], u32>,
}

impl Weld {
    fn number(&mut self, p: DVec2) -> u32 {
        let cell = (p / self.tolerance).floor().as_i64vec2().to_array();
        for dy in -1..=1 {
            for dx in -1..=1 {
                let Some(&k) = self.cells.get(&[cell[0].saturating_add(dx), cell[1].saturating_add(dy)]) else {
                    continue;
                };
                if p.distance(self.points[k as usize]) <= self.tolerance {
                    return k;
                }
            }
        }
        let number = self.points.len() as u32;
        self.points.push(p);
        self.cells.insert(cell, number);
        number
    }
}

/// A side as the chain of points that lie on it.
fn cut([a, b]: [u32; 2], points: &[DVec2], tree: &RTree<GeomWithData<[f64; 2], u32>>, tolerance: f64) -> Vec<[u32; 2]> {
    let (p, q) = (points[a as usize], points[b as usize]);
    let side = q - p;
    let length = side.length();
    let (low, high) = (p.min(q) - tolerance, p.max(q) + tolerance);
    let mut on: Vec<(f64, u32)> = tree
        .locate_in_envelope(AABB::from_corners(low.to_array(), high.to_array()))
        .filter(|c| c.data != a && c.data != b)
        .filter_map(|c| {
            let from = DVec2::from(*c.geom()) - p;
            let along = from.dot(side) / length;
            let beside = from.perp_dot(side).abs() / length;
            (beside <= tolerance && along > 0.0 && along < length).then_some((along, c.data))
        })
        .collect();
    on.sort_by(|s, t| s.0.total_cmp(&t.0).then(s.1.cmp(&t.1)));
    let chain: Vec<u32> = std::iter::once(a).chain(on.into_iter().map(|(_, k)| k)).chain([b]).collect();
    chain.windows(2).map(|w| [w[0], w[1]]).collect()
}

/// Area that lies inside an odd number of the polygons, by the mid-point rule on `lines` rows between the heights `low` and `high`.
pub fn area(edges: &[Edge], [low, high]: [f64; 2], lines: usize) -> f64 {
    let step = (high - low) / lines as f64;
    let mut sum = 0.0;
    for k in 0..lines {
        let y = low + (k as f64 + 0.5) * step;
        let crossed = edges.iter().filter(|[p, q]| (p.y <= y) != (q.y <= y));
        let mut x: Vec<f64> = crossed.map(|[p, q]| p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x)).collect();
        x.sort_by(f64::total_cmp);
        sum += x.chunks_exact(2).map(|pair| pair[1] - pair[0]).sum::<f64>() * step;
    }
    sum
}
