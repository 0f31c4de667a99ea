//! Marching cubes on the layers' true heights, slab by slab: a slab needs its two layers and the vertices of the slab below, no more.

use std::collections::HashMap;

use super::Layer;
use super::cases::{CASES, EDGES, Patch};
use super::mesh::{cross, dot, to_world};
use super::stream::Header;
use crate::packed::Packed;
use crate::stack::Geometry;

/// Vertices stay this far, in cell sides, from the corners of their cells: vertices of different edges stay apart in f32 too, so that a
/// reader that merges equal positions (STL) finds the same closed surface.
const OFF_CORNER: f64 = 1e-3;

/// What a slab adds to the surface. Its triangles have corners of its own and of the slab below, of no other.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    /// Numbers of the first vertices of the slab below and of this one.
    starts: [u64; 2],
    /// Positions of the vertices of both, world coordinates.
    positions: [Vec<[f64; 3]>; 2],
    /// Vertex numbers of the new triangles, counter-clockwise seen from outside.
    triangles: Vec<[u64; 3]>,
}

impl Piece {
    /// Positions of the new vertices.
    pub fn positions(&self) -> &[[f64; 3]] {
        &self.positions[1]
    }

    /// Vertex numbers of the new triangles, counted from the surface's first vertex.
    pub fn triangles(&self) -> &[[u64; 3]] {
        &self.triangles
    }

    /// Corner positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|v| self.of(v, &self.positions)))
    }

    /// Whether a vertex is one of this slab and not of the one below, and its place among these.
    pub(super) fn place(&self, vertex: u64) -> (usize, usize) {
        let slab = usize::from(vertex >= self.starts[1]);
        (slab, (vertex - self.starts[slab]) as usize)
    }

    /// What belongs to a vertex.
    fn of(&self, vertex: u64, both: &[Vec<[f64; 3]>; 2]) -> [f64; 3] {
        let (slab, at) = self.place(vertex);
        both[slab][at]
    }
}

/// A layer, or the outside below the first and above the last.
#[derive(Debug, Default)]
struct Plane {
    z: Option<f64>,
    phi: Packed<f32>,
}

/// Builds the surface slab by slab, from the lowest layer to the highest and the outside above it.
#[derive(Debug)]
pub struct Builder {
    /// Pixels per layer.
    image: [usize; 2],
    spacing: [f64; 2],
    geometry: Geometry,
    /// A geometry that mirrors turns the triangles inside out.
    mirrors: bool,
    /// Heights between which layers count.
    extent: [f64; 2],
    /// Nodes per padded row and number of rows: one ring of outside around the image.
    dims: [usize; 2],
    /// The slab's two layers.
    planes: [Plane; 2],
    /// Which of their nodes are inside.
    inside: [Vec<u8>; 2],
    /// Vertices of the slab below and of this one by their edges, three per lower node, counted within their slab: an edge of the lower
    /// layer that is crossed was crossed in the slab below, so its vertex is one of that.
    along: [HashMap<usize, u32>; 2],
    /// Positions of the vertices of the slab below and of this one, in the stack.
    positions: [Vec<[f64; 3]>; 2],
    piece: Piece,
}

impl Builder {
    /// Nothing yet.
    pub fn new(header: &Header) -> Self {
        let dims = header.dims.map(|n| n + 2);
        let [low, high] = header.extent;
        let slack = 1e-9 * (high - low).abs();
        let g = header.geometry;
        Builder {
            image: header.dims,
            spacing: header.spacing,
            geometry: g,
            mirrors: dot(g.axes[0], cross(g.axes[1], g.axes[2])) < 0.0,
            extent: [low - slack, high + slack],
            dims,
            planes: Default::default(),
            inside: Default::default(),
            along: Default::default(),
            positions: Default::default(),
            piece: Piece::default(),
        }
    }

    /// What the next layer adds: the slab below it; nothing where it lies beyond the body's extent.
    pub fn layer(&mut self, layer: &Layer) -> Option<&Piece> {
        if layer.z < self.extent[0] || layer.z > self.extent[1] {
            return None;
        }
        self.planes.swap(0, 1);
        let plane = &mut self.planes[1];
        plane.z = Some(layer.z);
        plane.phi = Packed::of(self.image, &layer.phi);
        self.slab();
        Some(&self.piece)
    }

    /// What closes the surface above the last layer; nothing where there was none.
    pub fn finish(&mut self) -> Option<&Piece> {
        self.planes[1].z?;
        self.planes.swap(0, 1);
        self.planes[1].z = None;
        self.slab();
        Some(&self.piece)
    }

    /// Fills the cells between the two layers.
    fn slab(&mut self) {
        // Nothing is used again: a lid needs far more than the slabs after it.
        let n = self.dims[0] * self.dims[1];
        self.inside.swap(0, 1);
        self.along.swap(0, 1);
        self.along[1] = HashMap::new();
        self.positions.swap(0, 1);
        self.positions[1] = Vec::new();
        self.piece.positions.swap(0, 1);
        self.piece.positions[1] = Vec::new();
        self.piece.starts = [self.piece.starts[1], self.piece.starts[1] + self.positions[0].len() as u64];
        self.piece.triangles = Vec::new();
        self.inside[1].clear();
        self.inside.iter_mut().for_each(|one| one.resize(n, 0));
        let [nx, ny] = self.image;
        if self.planes[1].z.is_some() {
            let mut row = vec![0.0; nx];
            for j in 0..ny {
                let to = (j + 1) * self.dims[0] + 1;
                self.planes[1].phi.read(0, j, &mut row);
                for (s, v) in self.inside[1][to..to + nx].iter_mut().zip(&row) {
                    *s = u8::from(*v < 0.0);
                }
            }
        }
        let mut cells = Vec::new();
        for j in 0..self.dims[1] - 1 {
            let rows = [0, 1].map(|side| [j, j + 1].map(|row| row * self.dims[0]).map(|start| (side, start)));
            let column = |i: usize| {
                let at = |k: usize, r: usize| {
                    let (side, start) = rows[k][r];
                    self.inside[side][start + i]
                };
                at(0, 0) | at(0, 1) << 2 | at(1, 0) << 4 | at(1, 1) << 6
            };
            cells.clear();
            let mut left = column(0);
            for i in 0..self.dims[0] - 1 {
                let right = column(i + 1);
                let pattern = left | right << 1;
                if pattern != 0 && pattern != 0xff {
                    cells.push((i, pattern));
                }
                left = right;
            }
            for &(i, pattern) in &cells {
                self.cell(i, j, pattern);
            }
        }
        let geometry = &self.geometry;
        self.piece.positions[1].extend(self.positions[1].iter().map(|p| to_world(geometry, *p)));
        if self.mirrors {
            self.piece.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
    }

    fn cell(&mut self, i: usize, j: usize, pattern: u8) {
        for patch in &CASES[pattern as usize] {
            match patch {
                Patch::Flat(triangles) => {
                    for t in triangles {
                        let corners = t.map(|e| self.vertex(i, j, e));
                        self.piece.triangles.push(corners);
                    }
                }
                Patch::Fan(path) => {
                    let ring: Vec<u64> = path.iter().map(|&e| self.vertex(i, j, e)).collect();
                    let mut mean = [0.0; 3];
                    for &v in &ring {
                        let p = self.piece.of(v, &self.positions);
                        (0..3).for_each(|a| mean[a] += p[a] / ring.len() as f64);
                    }
                    let center = self.piece.starts[1] + u64::from(self.push(mean));
                    for (k, &v) in ring.iter().enumerate() {
                        self.piece.triangles.push([center, v, ring[(k + 1) % ring.len()]]);
                    }
                }
            }
        }
    }

    /// Adds a vertex; its place in the slab.
    fn push(&mut self, position: [f64; 3]) -> u32 {
        self.positions[1].push(position);
        (self.positions[1].len() - 1) as u32
    }

    /// The vertex on edge `e` of the cell with lower corner (i, j).
    fn vertex(&mut self, i: usize, j: usize, e: u8) -> u64 {
        let corner = EDGES[e as usize][0];
        let (i, j, side) = (i + (corner & 1), j + (corner >> 1 & 1), corner >> 2);
        let node = j * self.dims[0] + i;
        let axis = e / 4;
        let (slab, edge) = (if axis == 2 { 1 } else { side }, 3 * node + usize::from(axis));
        if let Some(&known) = self.along[slab].get(&edge) {
            return self.piece.starts[slab] + u64::from(known);
        }
        let position = self.crossing([i, j], side, axis);
        let vertex = self.push(position);
        self.along[slab].insert(edge, vertex);
        self.piece.starts[1] + u64::from(vertex)
    }

    fn crossing(&self, at: [usize; 2], side: usize, axis: u8) -> [f64; 3] {
        let [dx, dy] = self.spacing;
        let [mut x, mut y] = [(at[0] as f64 - 1.0) * dx, (at[1] as f64 - 1.0) * dy];
        let share = |a: Option<f32>, b: Option<f32>| match (a, b) {
            (Some(a), Some(b)) => {
                let t = f64::from(a) / (f64::from(a) - f64::from(b));
                if t.is_finite() { t.clamp(OFF_CORNER, 1.0 - OFF_CORNER) } else { 0.5 }
            }
            _ => 0.5,
        };
        let [below, above] = [0, 1].map(|side| self.planes[side].z);
        let own = if side == 0 { below } else { above };
        let z = match axis {
            0 => {
                x += dx * share(self.value(side, at), self.value(side, [at[0] + 1, at[1]]));
                own
            }
            1 => {
                y += dy * share(self.value(side, at), self.value(side, [at[0], at[1] + 1]));
                own
            }
            _ => match (below, above) {
                (Some(low), Some(high)) => Some(low + (high - low) * share(self.value(0, at), self.value(1, at))),
                _ => below.or(above), // a lid
            },
        };
        // On one of both sides there is a layer.
        [x, y, z.unwrap_or_default()]
    }

    /// phi at a padded node, `None` beyond the image.
    fn value(&self, side: usize, [i, j]: [usize; 2]) -> Option<f32> {
        let [nx, ny] = self.image;
        let (i, j) = (i.checked_sub(1)?, j.checked_sub(1)?);
        (i < nx && j < ny).then(|| self.planes[side].phi.at(i, j))
    }
}
