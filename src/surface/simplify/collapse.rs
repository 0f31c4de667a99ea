//! A block of the surface made simpler, its border kept: tried with locks around what fails, until what is measured is within the error.

use glam::DVec3;
use meshopt::{SimplifyOptions, SimplifyVertex};

use super::block::Block;
use super::measure::{BlockError, Far};
use super::sound::{euler, torn_within};
use crate::progress::Stop;

/// Part of the error that collapses may estimate at first, and what is left of it where that fails in many places.
const ESTIMATE: f64 = 0.6;
const LESS: f64 = 0.7;
/// Tries until the block stays as it is.
const TRIES: usize = 24;
/// One sample in so many is few: what is around it is kept; where more fail, the estimate was too large as well.
const FEW: usize = 200;
/// Tears until one more ring of triangles around them is kept.
const TEARS: usize = 4;

/// Result of simplifying a block.
pub(super) struct Simpler {
    /// Triangles, by the given surface's vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices that lie elsewhere now, and where.
    pub moved: Vec<(u32, DVec3)>,
    /// Triangle near each sample of the block.
    pub near: Vec<u32>,
}

impl Block<'_> {
    /// A simpler block of the same Euler number; nothing where none was found, or `stop` is asked for.
    pub fn simpler(&self, stop: &Stop) -> Option<Simpler> {
        if stop.is_asked() {
            return None;
        }
        let measure = BlockError::new(self);
        let number = euler(&self.triangles);
        let mut locked = self.border.clone();
        let [low, high] = self
            .positions
            .iter()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)]);
        // Of a larger error the tries would not come down to one that leaves a body.
        let mut estimate = ESTIMATE * self.error.min((high - low).length());
        let (mut tears, mut fars) = (0, 0);
        for _ in 0..TRIES {
            if stop.is_asked() {
                return None;
            }
            let (triangles, positions) = self.collapsed(&locked, estimate)?;
            let torn = torn_within(&triangles, &self.triangles, &self.border);
            if !torn.is_empty() {
                self.lock(&torn, 1 + tears / TEARS, &mut locked);
                tears += 1;
                continue;
            }
            if euler(&triangles) != number {
                estimate *= LESS;
                continue;
            }
            match measure.near(self, &triangles, &positions) {
                Ok(near) => {
                    let triangles = triangles.iter().map(|t| t.map(|v| self.vertices[v as usize])).collect();
                    let places = self.vertices.iter().zip(&self.positions).zip(positions);
                    let moved = places.filter(|((_, from), to)| *from != to).map(|((v, _), to)| (*v, to)).collect();
                    return Some(Simpler { triangles, moved, near });
                }
                Err(Far { around, count }) if count * FEW > self.samples.len() => {
                    // Slivers and needles vanish at no cost to a quadric, whatever the estimate.
                    if fars > 0 {
                        self.lock(&around, 0, &mut locked);
                    }
                    estimate *= LESS;
                    fars += 1;
                }
                Err(Far { around, .. }) => {
                    fars += 1;
                    self.lock(&around, fars, &mut locked);
                }
            }
        }
        None
    }

    /// Triangles by edge collapses, and where the vertices lie then: a vertex that takes in others comes to where the planes around them are nearest, as a body
    /// that is round everywhere would lose volume by a choice of its own vertices. Nothing where none was found.
    fn collapsed(&self, locked: &[bool], estimate: f64) -> Option<(Vec<[u32; 3]>, Vec<DVec3>)> {
        let first = *self.positions.first()?;
        // About the first vertex, so that f32 suffices far from the world's origin.
        let before: Vec<[f32; 3]> = self.positions.iter().map(|p| (*p - first).as_vec3().to_array()).collect();
        let flag = |locked: &bool| if *locked { SimplifyVertex::Lock } else { SimplifyVertex::None };
        let flags: Vec<SimplifyVertex> = locked.iter().map(flag).collect();
        let (mut corners, mut after) = (self.triangles.as_flattened().to_vec(), before.clone());
        let options = SimplifyOptions::ErrorAbsolute;
        let (places, limit) = (&mut after[..], estimate as f32);
        let left =
            meshopt::simplify_with_update(&mut corners, places, &mut [], &[], 0, Some(&flags), 0, limit, options, None);
        if left == corners.len() {
            return None;
        }
        corners.truncate(left);
        let triangles: Vec<[u32; 3]> = corners.as_chunks().0.to_vec();
        let moved = |((old, before), after): ((&DVec3, &[f32; 3]), &[f32; 3])| {
            let is_moved = before != after && after.iter().all(|v| v.is_finite());
            if is_moved { first + DVec3::from(after.map(f64::from)) } else { *old }
        };
        let mut positions: Vec<DVec3> = self.positions.iter().zip(&before).zip(&after).map(moved).collect();
        self.keep_sides(&triangles, &mut positions);
        Some((triangles, positions))
    }

    /// Takes back what has turned a triangle over.
    fn keep_sides(&self, triangles: &[[u32; 3]], positions: &mut [DVec3]) {
        let normal = |t: &[u32; 3], at: &[DVec3]| {
            let [a, b, c] = t.map(|v| at[v as usize]);
            (b - a).cross(c - a)
        };
        loop {
            let is_turned = |t: &&[u32; 3]| {
                let is_moved = t.iter().any(|&v| positions[v as usize] != self.positions[v as usize]);
                is_moved && normal(t, &self.positions).dot(normal(t, positions)) <= 0.0
            };
            let turned: Vec<u32> = triangles.iter().filter(is_turned).copied().flatten().collect();
            if turned.is_empty() {
                return;
            }
            turned.into_iter().for_each(|v| positions[v as usize] = self.positions[v as usize]);
        }
    }

    /// Keeps vertices and `rings` of triangles around them as they are.
    fn lock(&self, around: &[u32], rings: usize, locked: &mut [bool]) {
        let mut held = vec![false; locked.len()];
        around.iter().for_each(|&v| held[v as usize] = true);
        for _ in 0..rings {
            let before = held.clone();
            for t in self.triangles.iter().filter(|t| t.iter().any(|&v| before[v as usize])) {
                t.iter().for_each(|&v| held[v as usize] = true);
            }
        }
        locked.iter_mut().zip(held).for_each(|(locked, held)| *locked |= held);
    }
}
