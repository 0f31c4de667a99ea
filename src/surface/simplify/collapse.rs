//! A block of the surface made simpler, its border kept: tried with locks around what fails, until what is measured is within the error.

use glam::DVec3;
use meshopt::{SimplifyOptions, VertexDataAdapter};

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
    /// Triangle near each sample of the block.
    pub near: Vec<u32>,
}

impl Block<'_> {
    /// A simpler block of the same Euler number; nothing where none was found, or `stop` is asked for.
    pub fn simpler(&self, stop: &Stop) -> Option<Simpler> {
        if stop.is_asked() {
            return None;
        }
        let positions: Vec<DVec3> = self.vertices.iter().map(|&v| self.given.positions[v as usize]).collect();
        let first = *positions.first()?;
        // About the first vertex, so that f32 suffices far from the world's origin.
        let near: Vec<[f32; 3]> = positions.iter().map(|p| (*p - first).as_vec3().to_array()).collect();
        let data = VertexDataAdapter::new(bytemuck::cast_slice(&near), size_of::<[f32; 3]>(), 0).ok()?;
        let measure = BlockError::new(self, positions);
        let number = euler(&self.triangles);
        let mut locked = self.border.clone();
        let mut estimate = ESTIMATE * self.error;
        let (mut tears, mut fars) = (0, 0);
        for _ in 0..TRIES {
            if stop.is_asked() {
                return None;
            }
            let options = SimplifyOptions::ErrorAbsolute;
            let corners = self.triangles.as_flattened();
            let left = meshopt::simplify_with_locks(corners, &data, &locked, 0, estimate as f32, options, None);
            if left.len() == corners.len() {
                return None;
            }
            let triangles: Vec<[u32; 3]> = left.as_chunks().0.to_vec();
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
            match measure.near(self, &triangles) {
                Ok(near) => {
                    let triangles = triangles.iter().map(|t| t.map(|v| self.vertices[v as usize])).collect();
                    return Some(Simpler { triangles, near });
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
