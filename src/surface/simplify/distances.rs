//! Distances from a surface, and points of triangles at which they are measured.

use glam::DVec3;
use rstar::primitives::CachedEnvelope;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

use super::super::mesh::Mesh;

/// Most steps of samples along a triangle's longest side.
const STEPS: usize = 1000;

/// Points of a triangle, corners and middle included, in rows along its longest side; neither rows nor points in them are farther apart than
/// `step`.
pub(super) fn samples(corners: [DVec3; 3], step: f64) -> impl Iterator<Item = DVec3> {
    let sides: [f64; 3] = std::array::from_fn(|k| corners[(k + 1) % 3].distance(corners[k]));
    let first = (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0);
    let [a, b, c] = std::array::from_fn(|k| corners[(first + k) % 3]);
    let longest = sides[first].max(f64::MIN_POSITIVE);
    let height = (b - a).cross(c - a).length() / longest;
    let steps = move |length: f64| ((length / step).ceil() as usize).clamp(1, STEPS);
    let rows = steps(height);
    let between = |p: DVec3, q: DVec3, t: f64| p + t * (q - p);
    let middle = (a + b + c) / 3.0;
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
    pub(super) fn of(corners: impl Iterator<Item = [DVec3; 3]>) -> Self {
        let triangle = |(n, corners)| CachedEnvelope::new(Triangle { corners, number: n as u32 });
        TriangleTree(RTree::bulk_load(corners.enumerate().map(triangle).collect()))
    }

    /// A triangle at most `reach` from `p`, by its number.
    pub(super) fn within(&self, p: DVec3, reach: f64) -> Option<u32> {
        self.0.locate_within_distance(p.to_array(), reach * reach).next().map(|t| t.number)
    }

    /// The triangle nearest to `p`, by its number.
    pub(super) fn nearest(&self, p: DVec3) -> Option<u32> {
        self.0.nearest_neighbor(p.to_array()).map(|t| t.number)
    }

    /// Distance of `p`; infinite where there is no triangle.
    pub fn from(&self, p: DVec3) -> f64 {
        self.0.nearest_neighbor(p.to_array()).map_or(f64::INFINITY, |t| distance_2(t.corners, p).sqrt())
    }
}

#[derive(Debug)]
struct Triangle {
    corners: [DVec3; 3],
    number: u32,
}

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b, c] = self.corners;
        AABB::from_corners(a.min(b).min(c).to_array(), a.max(b).max(c).to_array())
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, p: &[f64; 3]) -> f64 {
        distance_2(self.corners, (*p).into())
    }
}

/// Squared distance of `p` from a triangle.
pub(super) fn distance_2(corners: [DVec3; 3], p: DVec3) -> f64 {
    p.distance_squared(nearest(corners, p))
}

/// The point of a triangle nearest to `p` (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
fn nearest([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap, bp, cp) = (b - a, c - a, p - a, p - b, p - c);
    let (d1, d2, d3, d4, d5, d6) = (ab.dot(ap), ac.dot(ap), ab.dot(bp), ac.dot(bp), ab.dot(cp), ac.dot(cp));
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
        return a + d1 / (d1 - d3) * ab;
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + d2 / (d2 - d6) * ac;
    }
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
    }
    let n = ab.cross(ac);
    let size = n.length_squared();
    if size == 0.0 {
        return a;
    }
    p + -ap.dot(n) / size * n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_a_triangle_is_the_best_of_many() {
        let t = [DVec3::ZERO, DVec3::new(3.0, 0.5, 0.2), DVec3::new(1.0, 2.0, -0.5)];
        for k in 0..500 {
            let x = |m: f64| ((f64::from(k) * m).sin() * 43758.5).fract() * 6.0;
            let p = DVec3::new(x(1.3), x(2.7), x(3.9));
            let found = p.distance(nearest(t, p));
            let best = samples(t, 1e-3).map(|q| p.distance(q)).fold(f64::INFINITY, f64::min);
            assert!(found <= best + 1e-12 && best - found < 0.1, "{p:?}: {found} {best}");
        }
    }
}
