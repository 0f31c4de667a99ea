//! The surface from pass to pass: cut into blocks, made simpler block by block, joined again.

use glam::DVec3;
use rayon::prelude::*;

use super::super::mesh::Mesh;
use super::block::Block;
use super::collapse::Simpler;
use super::cut::{blocks, grouped};
use super::sound::torn;
use crate::progress::Stop;

/// The surface as it is now.
pub(super) struct Surface<'m> {
    given: &'m Mesh,
    /// Where the given vertices have come to.
    pub positions: Vec<DVec3>,
    /// Triangles, by the given vertices.
    pub now: Vec<[u32; 3]>,
    /// Triangle no farther than the error from each sample of the given surface: its vertices, then its triangles' middles.
    near: Vec<u32>,
}

impl<'m> Surface<'m> {
    /// The given one.
    pub fn new(given: &'m Mesh) -> Self {
        let mut near = vec![0; given.positions.len()];
        for (t, n) in given.triangles.iter().zip(0..) {
            t.iter().for_each(|&v| near[v as usize] = n);
        }
        near.extend(0..given.triangles.len() as u32);
        Surface { given, positions: given.positions.clone(), now: given.triangles.clone(), near }
    }

    /// Simpler block by block, where blocks have at most so many samples; where `stop` is asked for, the other blocks stay as they are.
    pub fn pass(self, error: f64, most: usize, share: f64, stop: &Stop) -> Self {
        let mut weights = vec![1u32; self.now.len()];
        self.near.iter().for_each(|&t| weights[t as usize] += 1);
        let members = blocks(&self.positions, &self.now, &weights, most, share);
        drop(weights);
        let mut owner = vec![0; self.now.len()];
        let mut place = vec![0; self.now.len()];
        for (block, members) in members.iter().enumerate() {
            for (n, &t) in members.iter().enumerate() {
                (owner[t as usize], place[t as usize]) = (block as u32, n as u32);
            }
        }
        let border = border(self.given.positions.len(), &self.now, &owner);
        let samples = grouped(self.near.iter().map(|&t| owner[t as usize]), members.len());
        drop(owner);
        let cut = Cut { members, samples, place, border };
        let block = |b: usize| self.block(&cut, b, error).simpler(stop);
        let made: Vec<Option<Simpler>> = (0..cut.members.len()).into_par_iter().map(block).collect();
        self.joined(&cut, made)
    }

    fn block(&self, cut: &Cut, number: usize, error: f64) -> Block<'m> {
        let members = &cut.members[number];
        let mut vertices: Vec<u32> = members.iter().flat_map(|&t| self.now[t as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |v: u32| vertices.partition_point(|&w| w < v) as u32;
        let sample = |&s: &u32| [s, cut.place[self.near[s as usize] as usize]];
        Block {
            given: self.given,
            error,
            triangles: members.iter().map(|&t| self.now[t as usize].map(local)).collect(),
            border: vertices.iter().map(|&v| cut.border[v as usize]).collect(),
            positions: vertices.iter().map(|&v| self.positions[v as usize]).collect(),
            samples: cut.samples[number].iter().map(sample).collect(),
            vertices,
        }
    }

    /// The surface of the blocks' simpler ones, as far as they fit together; the others stay as they were.
    fn joined(mut self, cut: &Cut, mut made: Vec<Option<Simpler>>) -> Self {
        let (now, whose) = loop {
            let (mut now, mut whose) = (Vec::new(), Vec::new());
            for (b, (made, members)) in made.iter().zip(&cut.members).enumerate() {
                match made {
                    Some(made) => now.extend(&made.triangles),
                    None => now.extend(members.iter().map(|&t| self.now[t as usize])),
                }
                whose.resize(now.len(), b);
            }
            let torn = torn(&now);
            if torn.is_empty() {
                break (now, whose);
            }
            let mut is_torn = vec![false; self.given.positions.len()];
            torn.iter().for_each(|&v| is_torn[v as usize] = true);
            let broken = now.iter().zip(&whose).filter(|(t, _)| t.iter().any(|&v| is_torn[v as usize]));
            broken.for_each(|(_, &b)| made[b] = None);
        };
        let mut near = vec![0; self.near.len()];
        for (b, (made, samples)) in made.iter().zip(&cut.samples).enumerate() {
            let start = whose.partition_point(|&w| w < b) as u32;
            for (n, &s) in samples.iter().enumerate() {
                let stayed = || cut.place[self.near[s as usize] as usize];
                near[s as usize] = start + made.as_ref().map_or_else(stayed, |made| made.near[n]);
            }
        }
        for (v, to) in made.into_iter().flatten().flat_map(|made| made.moved) {
            self.positions[v as usize] = to;
        }
        Surface { now, near, ..self }
    }
}

/// A surface cut into blocks.
struct Cut {
    /// Triangles and samples of each block.
    members: Vec<Vec<u32>>,
    samples: Vec<Vec<u32>>,
    /// Place of each triangle in its block.
    place: Vec<u32>,
    /// Vertices of more than one block.
    border: Vec<bool>,
}

/// Vertices of more than one block.
fn border(count: usize, triangles: &[[u32; 3]], owner: &[u32]) -> Vec<bool> {
    let mut first = vec![u32::MAX; count];
    let mut border = vec![false; count];
    for (t, &block) in triangles.iter().zip(owner) {
        for v in t.map(|v| v as usize) {
            border[v] |= first[v] != u32::MAX && first[v] != block;
            first[v] = block;
        }
    }
    border
}
