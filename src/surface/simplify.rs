//! A surface with fewer triangles, no farther from the given one than an error: meshoptimizer's edge collapses by quadric error (Garland and
//! Heckbert, 1997), whose own estimate is no bound, so that the distance is measured both ways, and closedness checked, before it counts.
//!
//! Vertices that remain stay where they are. The whole mesh is in memory.

use std::collections::HashMap;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;
use rstar::primitives::CachedEnvelope;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

use super::mesh::{Mesh, MeshSource, cross, dot, length, sub};

/// Part of the error that collapses may estimate at first, and what is left of it where the measured distance is larger after all.
const ESTIMATE: f64 = 0.7;
const LESS: f64 = 0.6;
/// Tries until the surface stays as it is.
const TRIES: usize = 16;
/// One vertex in so many is few: these are kept; where more are missed, the estimate was too large.
const FEW: usize = 100;
/// Most samples along a triangle's side.
const SAMPLES: usize = 24;

/// Makes the simpler surface once, for all the formats that write it.
#[derive(Debug)]
pub struct Simplifier {
    error: f64,
    made: Mutex<Option<Arc<Mesh>>>,
    gave_up: AtomicBool,
}

impl Simplifier {
    /// For surfaces within `error` of the given one, stack's unit.
    pub fn new(error: f64) -> Self {
        Simplifier { error, made: Mutex::new(None), gave_up: AtomicBool::new(false) }
    }

    /// Whether none was found, so that the whole mesh was written.
    pub fn gave_up(&self) -> bool {
        self.gave_up.load(Ordering::Relaxed)
    }

    /// The simpler surface of `mesh`, or where none is found the whole one, which is the same in every call.
    ///
    /// # Errors
    /// Those of reading the mesh; [`io::ErrorKind::InvalidInput`] beyond 2^32 vertices.
    pub fn simpler(&self, mesh: &mut dyn MeshSource) -> io::Result<Arc<Mesh>> {
        let mut made = self.made.lock().map_err(|_| io::Error::other("another output has failed"))?;
        if let Some(made) = made.as_ref() {
            return Ok(made.clone());
        }
        let whole = collected(mesh)?;
        let simpler = simplified(&whole, self.error);
        self.gave_up.store(simpler.is_none() && !whole.triangles.is_empty(), Ordering::Relaxed);
        let simpler = Arc::new(simpler.unwrap_or(whole));
        *made = Some(simpler.clone());
        Ok(simpler)
    }
}

fn collected(mesh: &mut dyn MeshSource) -> io::Result<Mesh> {
    let [vertices, _] = mesh.counts();
    if u32::try_from(vertices).is_err() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "at most 2^32 vertices can be simplified"));
    }
    let mut whole = Mesh::default();
    mesh.vertices(&mut |v| {
        whole.positions.push(v.position);
        Ok(())
    })?;
    mesh.triangles(&mut |t, _| {
        whole.triangles.push(t.map(|v| v as u32));
        Ok(())
    })?;
    Ok(whole)
}

/// A closed surface with fewer triangles whose distance from `mesh` is at most `error`, both ways, as far as samples tell: all vertices and
/// middles of triangles of `mesh`, and the simpler one's triangles on a grid no wider than the error where 24 steps a side suffice. Nothing
/// where none was found.
pub fn simplified(mesh: &Mesh, error: f64) -> Option<Mesh> {
    let first = *mesh.positions.first()?;
    // About the first vertex, so that f32 suffices far from the world's origin.
    let near: Vec<[f32; 3]> = mesh.positions.iter().map(|p| sub(*p, first).map(|x| x as f32)).collect();
    let data = VertexDataAdapter::new(bytemuck::cast_slice(&near), size_of::<[f32; 3]>(), 0).ok()?;
    let given = Distances::new(mesh);
    let mut locked = vec![false; near.len()];
    let mut estimate = ESTIMATE * error;
    for _ in 0..TRIES {
        let options = SimplifyOptions::ErrorAbsolute;
        let corners = mesh.triangles.as_flattened();
        let left = meshopt::simplify_with_locks(corners, &data, &locked, 0, estimate as f32, options, None);
        let triangles: Vec<[u32; 3]> = left.as_chunks().0.to_vec();
        let torn = torn(&triangles);
        if !torn.is_empty() {
            lock_around(mesh, &torn, &mut locked);
            continue;
        }
        let simpler = compact(mesh, &triangles);
        // Slivers and needles vanish at no cost to a quadric: what is missed stays.
        let missed = missed(&simpler, mesh, error);
        let strays = strays(mesh, &triangles, &given, error);
        if missed.is_empty() && strays.is_empty() {
            return Some(simpler);
        }
        if missed.len() < mesh.positions.len() / FEW {
            lock_around(mesh, &missed, &mut locked);
        } else {
            estimate *= LESS;
        }
        if !strays.is_empty() {
            estimate *= LESS;
        }
    }
    None
}

/// Vertices of edges that are not in exactly two triangles, once in each direction.
fn torn(triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut edges: HashMap<(u32, u32), [u8; 2]> = HashMap::with_capacity(triangles.len() * 3 / 2);
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let uses = edges.entry((a.min(b), a.max(b))).or_default();
            uses[usize::from(a > b)] = uses[usize::from(a > b)].saturating_add(1);
        }
    }
    edges.into_iter().filter(|(_, uses)| *uses != [1, 1]).flat_map(|((a, b), _)| [a, b]).collect()
}

/// Keeps the given vertices and all around them where they are.
fn lock_around(mesh: &Mesh, torn: &[u32], locked: &mut [bool]) {
    let before = locked.to_vec();
    torn.iter().for_each(|&v| locked[v as usize] = true);
    for _ in 0..2 {
        let held = locked.to_vec();
        for t in mesh.triangles.iter().filter(|t| t.iter().any(|&v| held[v as usize] && !before[v as usize])) {
            t.iter().for_each(|&v| locked[v as usize] = true);
        }
    }
}

/// Only the vertices that are used, in their order.
fn compact(mesh: &Mesh, triangles: &[[u32; 3]]) -> Mesh {
    let mut used = vec![false; mesh.positions.len()];
    triangles.as_flattened().iter().for_each(|&v| used[v as usize] = true);
    let mut numbers = vec![0; used.len()];
    let mut positions = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        numbers[v] = positions.len() as u32;
        positions.push(mesh.positions[v]);
    }
    Mesh { positions, triangles: triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect() }
}

/// Vertices of the given surface that are farther than `error` from the simpler one, or whose triangles' middles are.
fn missed(simpler: &Mesh, given: &Mesh, error: f64) -> Vec<u32> {
    let to_simpler = Distances::new(simpler);
    let is_far = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|v| given.positions[v as usize]);
        let middle = std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0);
        [a, b, c, middle].into_iter().any(|p| !to_simpler.within(p, error))
    };
    given.triangles.par_iter().filter(is_far).flat_map_iter(|t| *t).collect()
}

/// Corners of the simpler surface's triangles, by the numbers of the given one, some sample of which is farther than `error` from that.
fn strays(given: &Mesh, triangles: &[[u32; 3]], to_given: &Distances, error: f64) -> Vec<u32> {
    let is_far = |t: &&[u32; 3]| {
        let corners = t.map(|v| given.positions[v as usize]);
        samples(corners, error).any(|p| !to_given.within(p, error))
    };
    triangles.par_iter().filter(is_far).flat_map_iter(|t| *t).collect()
}

/// Points of a triangle, corners included, no farther apart than `step` if they are not too many.
fn samples([a, b, c]: [[f64; 3]; 3], step: f64) -> impl Iterator<Item = [f64; 3]> {
    let longest = [sub(b, a), sub(c, b), sub(a, c)].into_iter().map(length).fold(0.0, f64::max);
    let n = ((longest / step).ceil() as usize).clamp(2, SAMPLES);
    (0..=n).flat_map(move |i| {
        (0..=n - i).map(move |j| {
            let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
            std::array::from_fn(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
        })
    })
}

/// Distances from a surface.
#[derive(Debug)]
pub struct Distances(RTree<CachedEnvelope<Triangle>>);

impl Distances {
    /// From all triangles of `mesh`.
    pub fn new(mesh: &Mesh) -> Self {
        Distances(RTree::bulk_load(mesh.corners().map(|c| CachedEnvelope::new(Triangle(c))).collect()))
    }

    /// Whether `p` is at most `reach` from the surface.
    pub fn within(&self, p: [f64; 3], reach: f64) -> bool {
        self.0.locate_within_distance(p, reach * reach).next().is_some()
    }

    /// Distance of `p`; infinite where there is no triangle.
    pub fn from(&self, p: [f64; 3]) -> f64 {
        self.0.nearest_neighbor(p).map_or(f64::INFINITY, |t| t.distance_2(&p).sqrt())
    }
}

#[derive(Debug)]
struct Triangle([[f64; 3]; 3]);

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        AABB::from_points(&self.0)
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, p: &[f64; 3]) -> f64 {
        let d = sub(*p, nearest(self.0, *p));
        dot(d, d)
    }
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
