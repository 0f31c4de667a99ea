//! Distances from a surface, and points of triangles at which they are measured.

use rstar::primitives::CachedEnvelope;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

use super::super::mesh::Mesh;
use super::super::space::{cross, dot, length, sub};

/// Most steps of samples along a triangle's longest side.
const STEPS: usize = 1000;

/// Points of a triangle, corners and middle included, in rows along its longest side; neither rows nor points in them are farther apart than
/// `step`.
pub(super) fn samples(corners: [[f64; 3]; 3], step: f64) -> impl Iterator<Item = [f64; 3]> {
    let sides: [f64; 3] = std::array::from_fn(|k| length(sub(corners[(k + 1) % 3], corners[k])));
    let first = (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0);
    let [a, b, c] = std::array::from_fn(|k| corners[(first + k) % 3]);
    let longest = sides[first].max(f64::MIN_POSITIVE);
    let height = length(cross(sub(b, a), sub(c, a))) / longest;
    let steps = move |length: f64| ((length / step).ceil() as usize).clamp(1, STEPS);
    let rows = steps(height);
    let between = |p: [f64; 3], q: [f64; 3], t: f64| -> [f64; 3] { std::array::from_fn(|k| p[k] + t * (q[k] - p[k])) };
    let middle = std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0);
    let grid = (0..=rows).flat_map(move |i| {
        let up = i as f64 / rows as f64;
        let columns = steps(longest * (1.0 - up));
        let (from, to) = (between(a, c, up), between(b, c, up));
        (0..=columns).map(move |j| between(from, to, j as f64 / columns as f64))
    });
    std::iter::once(middle).chain(grid)
}

/// Distances from a surface.
#[derive(Debug)]
pub struct TriangleTree(RTree<CachedEnvelope<Triangle>>);

impl TriangleTree {
    /// The tree of all triangles of `mesh`.
    pub fn new(mesh: &Mesh) -> Self {
        TriangleTree::of(mesh.corners())
    }

    /// The tree of triangles given by their corners.
    pub(super) fn of(corners: impl Iterator<Item = [[f64; 3]; 3]>) -> Self {
        let triangle = |(n, corners)| CachedEnvelope::new(Triangle { corners, number: n as u32 });
        TriangleTree(RTree::bulk_load(corners.enumerate().map(triangle).collect()))
    }

    /// A triangle at most `reach` from `p`, by its number.
    pub(super) fn within(&self, p: [f64; 3], reach: f64) -> Option<u32> {
        self.0.locate_within_distance(p, reach * reach).next().map(|t| t.number)
    }

    /// The triangle nearest to `p`, by its number.
    pub(super) fn nearest(&self, p: [f64; 3]) -> Option<u32> {
        self.0.nearest_neighbor(p).map(|t| t.number)
    }

    /// Distance of `p`; infinite where there is no triangle.
    pub fn from(&self, p: [f64; 3]) -> f64 {
        self.0.nearest_neighbor(p).map_or(f64::INFINITY, |t| t.distance_2(&p).sqrt())
    }
}

#[derive(Debug)]
struct Triangle {
    corners: [[f64; 3]; 3],
    number: u32,
}

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        AABB::from_points(&self.corners)
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, p: &[f64; 3]) -> f64 {
        distance_2(self.corners, *p)
    }
}

/// Squared distance of `p` from a triangle.
pub(super) fn distance_2(corners: [[f64; 3]; 3], p: [f64; 3]) -> f64 {
    let d = sub(p, nearest(corners, p));
    dot(d, d)
}

/// The point of a triangle nearest to `p` (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
fn nearest([a, b, c]: [[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    let along = |from: [f64; 3], way: [f64; 3], t: f64| std::array::from_fn(|k| from[k] + t * way[k]);
    let (ab, ac, ap, bp, cp) = (sub(b, a), sub(c, a), sub(p, a), sub(p, b), sub(p, c));
    let (d1, d2, d3, d4, d5, d6) = (dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return along(a, ab, d1 / (d1 - d3));
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return along(a, ac, d2 / (d2 - d6));
    }
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return along(b, sub(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let n = cross(ab, ac);
    let size = dot(n, n);
    if size == 0.0 {
        return a;
    }
    along(p, n, -dot(ap, n) / size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_a_triangle_is_the_best_of_many() {
        let t = [[0.0, 0.0, 0.0], [3.0, 0.5, 0.2], [1.0, 2.0, -0.5]];
        for k in 0..500 {
            let x = |m: f64| ((f64::from(k) * m).sin() * 43758.5).fract() * 6.0;
            let p = [x(1.3), x(2.7), x(3.9)];
            let found = length(sub(p, nearest(t, p)));
            let best = samples(t, 1e-3).map(|q| length(sub(p, q))).fold(f64::INFINITY, f64::min);
            assert!(found <= best + 1e-12 && best - found < 0.1, "{p:?}: {found} {best}");
        }
    }
}
