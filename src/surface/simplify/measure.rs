//! Distance of a block that was made simpler from the given surface, both ways.

use std::collections::HashMap;

use glam::DVec3;

use super::super::mesh::Mesh;
use super::block::Block;
use super::distances::{TriangleTree, distance_2, samples};

/// Part of the error that a sample may be away: the rest is for what lies between samples, up to 0.107 of an error of 0.02 on a mesh of the paper's
/// Fig. 10.
const WITHIN: f64 = 0.85;
/// Distance between samples: as a part of the error, and at least as a part of the given triangles' sides, on the given triangles and on the
/// new ones.
const STEP: f64 = 0.5;
const GIVEN_STEP: f64 = 1.0 / 6.0;
const NEW_STEP: f64 = 1.0 / 6.0;

/// Means to measure a block with.
pub(super) struct BlockError {
    /// Number of each triangle of the block.
    numbers: HashMap<[u32; 3], u32>,
    /// The given triangles whose middles the block has, and for each the block's triangle near its middle.
    corners: Vec<[DVec3; 3]>,
    beside: Vec<u32>,
    given: TriangleTree,
    /// Between samples of given triangles, and of new ones.
    steps: [f64; 2],
    reach: f64,
}

/// Samples that are too far: vertices of the block around them, and how many there are.
pub(super) struct Far {
    pub around: Vec<u32>,
    pub count: usize,
}

impl Far {
    fn add(&mut self, around: [u32; 3]) {
        self.around.extend(around);
        self.count += 1;
    }
}

impl BlockError {
    /// The means for `block`.
    pub fn new(block: &Block<'_>) -> Self {
        let first_middle = block.given.positions.len() as u32;
        let middles = block.samples.iter().filter(|[s, _]| *s >= first_middle);
        let (corners, beside): (Vec<_>, Vec<_>) =
            middles.map(|[s, t]| (corners_of(block.given, (s - first_middle) as usize), *t)).unzip();
        let sides = corners.iter().map(|[a, b, _]| b.distance(*a)).sum::<f64>() / corners.len().max(1) as f64;
        BlockError {
            numbers: block.triangles.iter().zip(0..).map(|(t, n)| (*t, n)).collect(),
            given: TriangleTree::of(corners.iter().copied()),
            corners,
            beside,
            steps: [GIVEN_STEP, NEW_STEP].map(|part| (STEP * block.error).max(part * sides)),
            reach: WITHIN * block.error,
        }
    }

    /// One of `triangles`, whose vertices lie at `positions`, near each sample of the block, where all are near, and all samples of these near the
    /// given surface.
    pub fn near(&self, block: &Block<'_>, triangles: &[[u32; 3]], positions: &[DVec3]) -> Result<Vec<u32>, Far> {
        let corners: Vec<_> = triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let is_moved = |t: &[u32; 3]| t.iter().any(|&v| positions[v as usize] != block.positions[v as usize]);
        // What has stayed need not be measured again.
        let mut still = vec![None; block.triangles.len()];
        let mut is_new = vec![true; triangles.len()];
        for (n, t) in triangles.iter().enumerate() {
            if let Some(&old) = self.numbers.get(t).filter(|_| !is_moved(t)) {
                still[old as usize] = Some(n as u32);
                is_new[n] = false;
            }
        }
        let new = TriangleTree::of(corners.iter().copied());
        let mut to_new = Nearby { of: &new, corners: &corners, reach: self.reach, last: 0 };
        let mut far = Far { around: Vec::new(), count: 0 };
        let mut near = Vec::with_capacity(block.samples.len());
        for &[sample, old] in &block.samples {
            let place = || place(block.given, sample);
            near.push(match still[old as usize] {
                Some(kept) => kept,
                None => to_new.find(place()).unwrap_or_else(|| {
                    far.add(block.triangles[old as usize]);
                    0
                }),
            });
        }
        if far.count == 0 {
            let moved = self.corners.iter().zip(&self.beside).filter(|(_, old)| still[**old as usize].is_none());
            for (given, &old) in moved {
                if to_new.covers(given) {
                    continue;
                }
                let is_far = |p: &DVec3| to_new.find(*p).is_none() && self.was_near(block, *p);
                samples(*given, self.steps[0]).filter(is_far).for_each(|_| far.add(block.triangles[old as usize]));
            }
        }
        let mut to_given = Nearby { of: &self.given, corners: &self.corners, reach: self.reach, last: 0 };
        let new_ones = triangles.iter().zip(&corners).zip(is_new).filter(|(_, is_new)| *is_new);
        for ((t, corners), _) in new_ones {
            for p in samples(*corners, self.steps[1]).filter(|p| to_given.find(*p).is_none()) {
                far.add(*t);
                if let Some(given) = self.given.nearest(p) {
                    far.around.extend(block.triangles[self.beside[given as usize] as usize]);
                }
            }
        }
        if far.count == 0 { Ok(near) } else { Err(far) }
    }

    /// Whether `p` was near the block as it was: where not, it is near another one, which has to keep it.
    fn was_near(&self, block: &Block<'_>, p: DVec3) -> bool {
        let is_near = |t: &[u32; 3]| distance_2(t.map(|v| block.positions[v as usize]), p) <= self.reach * self.reach;
        block.triangles.iter().any(is_near)
    }
}

/// Finds triangles near points that are mostly near the same one as the point before.
struct Nearby<'d> {
    of: &'d TriangleTree,
    corners: &'d [[DVec3; 3]],
    reach: f64,
    last: u32,
}

impl Nearby<'_> {
    fn find(&mut self, p: DVec3) -> Option<u32> {
        if self.is_near(p) {
            return Some(self.last);
        }
        let found = self.of.within(p, self.reach)?;
        self.last = found;
        Some(found)
    }

    fn is_near(&self, p: DVec3) -> bool {
        self.corners.get(self.last as usize).is_some_and(|c| distance_2(*c, p) <= self.reach * self.reach)
    }

    /// Whether all of a triangle is near the last one found: its distances from that are largest at its corners.
    fn covers(&self, triangle: &[DVec3; 3]) -> bool {
        triangle.iter().all(|p| self.is_near(*p))
    }
}

/// A sample of the given surface: its vertices, then its triangles' middles.
fn place(given: &Mesh, sample: u32) -> DVec3 {
    let sample = sample as usize;
    given.positions.get(sample).copied().unwrap_or_else(|| {
        let [a, b, c] = corners_of(given, sample - given.positions.len());
        (a + b + c) / 3.0
    })
}

fn corners_of(mesh: &Mesh, triangle: usize) -> [DVec3; 3] {
    mesh.triangles[triangle].map(|v| mesh.positions[v as usize])
}
