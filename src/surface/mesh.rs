//! The closed surface of a reconstruction as triangles, by marching cubes on the layers' true heights.

use super::cases::{CASES, EDGES, Patch};
use super::{Layer, Reconstruction};
use crate::stack::Geometry;

/// Vertices stay this far, in cell sides, from the corners of their cells: vertices of different edges stay apart in f32 too, so that a
/// reader that merges equal positions (STL) finds the same closed surface.
const OFF_CORNER: f64 = 1e-3;
/// No vertex yet.
const NONE: u32 = u32::MAX;

/// Triangles in world coordinates (LPS, unit of the stack), counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f64; 3]>,
    /// Vertex numbers of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Enclosed volume `1/6 sum a . (b x c)`, unit cubed.
    pub fn volume(&self) -> f64 {
        // About the first vertex: far from the world's origin the terms would cancel.
        let Some(&o) = self.positions.first() else { return 0.0 };
        self.corners().map(|[a, b, c]| dot(sub(a, o), cross(sub(b, o), sub(c, o)))).sum::<f64>() / 6.0
    }

    /// Surface area, unit squared.
    pub fn area(&self) -> f64 {
        self.corners().map(|[a, b, c]| 0.5 * length(cross(sub(b, a), sub(c, a)))).sum()
    }

    /// Unit normals of the vertices, outward: mean of the triangles around, by area.
    pub fn normals(&self) -> Vec<[f64; 3]> {
        let mut out = vec![[0.0; 3]; self.positions.len()];
        for (t, [a, b, c]) in self.triangles.iter().zip(self.corners()) {
            let n = cross(sub(b, a), sub(c, a));
            for &v in t {
                let sum = &mut out[v as usize];
                *sum = [sum[0] + n[0], sum[1] + n[1], sum[2] + n[2]];
            }
        }
        out.into_iter()
            .map(|n| {
                let l = length(n).max(f64::MIN_POSITIVE);
                n.map(|v| v / l)
            })
            .collect()
    }

    /// Corner positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize]))
    }
}

pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// The body's surface: closed, every edge in exactly two triangles, oriented outward.
///
/// Around the image all is outside; where the body touches its border, the surface runs half a pixel beyond. Where the body is still
/// inside on its first or last layer (`extent`), it gets a flat lid exactly at that height.
pub fn closed_surface(body: &Reconstruction) -> Mesh {
    let slack = 1e-9 * (body.extent[1] - body.extent[0]).abs();
    let layers: Vec<&Layer> =
        body.layers.iter().filter(|l| l.z >= body.extent[0] - slack && l.z <= body.extent[1] + slack).collect();
    let mut builder = Builder::new(body, &layers);
    if !layers.is_empty() {
        for slab in 0..=layers.len() {
            builder.slab(slab);
        }
    }
    let mut mesh = builder.mesh;
    let g = &body.geometry;
    for p in &mut mesh.positions {
        *p = to_world(g, *p);
    }
    // A geometry that mirrors turns the triangles inside out.
    if dot(g.axes[0], cross(g.axes[1], g.axes[2])) < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

/// A point of the stack (`x = i dx`, `y = j dy`, height) in the world.
pub fn to_world(g: &Geometry, p: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| g.origin[a] + p[0] * g.axes[0][a] + p[1] * g.axes[1][a] + p[2] * g.axes[2][a])
}

/// Builds the mesh slab by slab. Slab s lies between layers s - 1 and s; layers -1 and n are outside and lids.
struct Builder<'a> {
    body: &'a Reconstruction,
    layers: &'a [&'a Layer],
    /// Nodes per padded row and number of rows: one ring of outside around the image.
    dims: [usize; 2],
    /// Which nodes are inside, of the slab's two layers.
    inside: [Vec<u8>; 2],
    /// Vertices on edges along x and y of the two layers, and along z between them.
    along_x: [Vec<u32>; 2],
    along_y: [Vec<u32>; 2],
    along_z: Vec<u32>,
    mesh: Mesh,
}

impl<'a> Builder<'a> {
    fn new(body: &'a Reconstruction, layers: &'a [&'a Layer]) -> Self {
        let dims = [body.dims[0] + 2, body.dims[1] + 2];
        let n = dims[0] * dims[1];
        let none = || [vec![NONE; n], vec![NONE; n]];
        Builder {
            body,
            layers,
            dims,
            inside: [vec![0; n], vec![0; n]],
            along_x: none(),
            along_y: none(),
            along_z: vec![NONE; n],
            mesh: Mesh::default(),
        }
    }

    /// Moves up by one layer and fills the cells of the slab below it.
    fn slab(&mut self, slab: usize) {
        self.inside.swap(0, 1);
        self.along_x.swap(0, 1);
        self.along_y.swap(0, 1);
        self.inside[1].fill(0);
        self.along_x[1].fill(NONE);
        self.along_y[1].fill(NONE);
        self.along_z.fill(NONE);
        let [nx, ny] = self.body.dims;
        if let Some(layer) = self.layers.get(slab) {
            for j in 0..ny {
                let to = (j + 1) * self.dims[0] + 1;
                for (s, v) in self.inside[1][to..to + nx].iter_mut().zip(&layer.phi[j * nx..(j + 1) * nx]) {
                    *s = u8::from(*v < 0.0);
                }
            }
        }
        for j in 0..self.dims[1] - 1 {
            let rows = [0, 1].map(|side| [j, j + 1].map(|row| row * self.dims[0]).map(|start| (side, start)));
            let column = |i: usize| {
                let at = |k: usize, r: usize| {
                    let (side, start) = rows[k][r];
                    self.inside[side][start + i]
                };
                at(0, 0) | at(0, 1) << 2 | at(1, 0) << 4 | at(1, 1) << 6
            };
            let mut cells = Vec::new();
            let mut left = column(0);
            for i in 0..self.dims[0] - 1 {
                let right = column(i + 1);
                let pattern = left | right << 1;
                if pattern != 0 && pattern != 0xff {
                    cells.push((i, pattern));
                }
                left = right;
            }
            for (i, pattern) in cells {
                self.cell(slab, i, j, pattern);
            }
        }
    }

    fn cell(&mut self, slab: usize, i: usize, j: usize, pattern: u8) {
        for patch in &CASES[pattern as usize] {
            match patch {
                Patch::Flat(triangles) => {
                    for t in triangles {
                        let corners = t.map(|e| self.vertex(slab, i, j, e));
                        self.mesh.triangles.push(corners);
                    }
                }
                Patch::Fan(path) => {
                    let ring: Vec<u32> = path.iter().map(|&e| self.vertex(slab, i, j, e)).collect();
                    let mut mean = [0.0; 3];
                    for &v in &ring {
                        let p = self.mesh.positions[v as usize];
                        (0..3).for_each(|a| mean[a] += p[a] / ring.len() as f64);
                    }
                    let center = self.push(mean);
                    for (k, &v) in ring.iter().enumerate() {
                        self.mesh.triangles.push([center, v, ring[(k + 1) % ring.len()]]);
                    }
                }
            }
        }
    }

    fn push(&mut self, position: [f64; 3]) -> u32 {
        self.mesh.positions.push(position);
        (self.mesh.positions.len() - 1) as u32
    }

    /// The vertex on edge `e` of the cell with lower corner (i, j) in the slab.
    fn vertex(&mut self, slab: usize, i: usize, j: usize, e: u8) -> u32 {
        let corner = EDGES[e as usize][0];
        let (i, j, side) = (i + (corner & 1), j + (corner >> 1 & 1), corner >> 2);
        let node = j * self.dims[0] + i;
        let axis = e / 4;
        let known = match axis {
            0 => self.along_x[side][node],
            1 => self.along_y[side][node],
            _ => self.along_z[node],
        };
        if known != NONE {
            return known;
        }
        let position = self.crossing(slab, [i, j], side, axis);
        let vertex = self.push(position);
        match axis {
            0 => self.along_x[side][node] = vertex,
            1 => self.along_y[side][node] = vertex,
            _ => self.along_z[node] = vertex,
        }
        vertex
    }

    fn crossing(&self, slab: usize, at: [usize; 2], side: usize, axis: u8) -> [f64; 3] {
        let [dx, dy] = self.body.spacing;
        let [mut x, mut y] = [(at[0] as f64 - 1.0) * dx, (at[1] as f64 - 1.0) * dy];
        // Layer index of the edge's lower end; slab s has layer s - 1 below and s above.
        let Some(low) = (slab + side).checked_sub(1) else {
            return [x, y, self.layers[0].z];
        };
        let share = |a: Option<f32>, b: Option<f32>| match (a, b) {
            (Some(a), Some(b)) => {
                let t = f64::from(a) / (f64::from(a) - f64::from(b));
                if t.is_finite() { t.clamp(OFF_CORNER, 1.0 - OFF_CORNER) } else { 0.5 }
            }
            _ => 0.5,
        };
        match axis {
            0 => {
                x += dx * share(self.value(low, at), self.value(low, [at[0] + 1, at[1]]));
                [x, y, self.layers[low].z]
            }
            1 => {
                y += dy * share(self.value(low, at), self.value(low, [at[0], at[1] + 1]));
                [x, y, self.layers[low].z]
            }
            _ => {
                let z = self.layers[low].z;
                match self.layers.get(low + 1) {
                    Some(above) => [x, y, z + (above.z - z) * share(self.value(low, at), self.value(low + 1, at))],
                    None => [x, y, z],
                }
            }
        }
    }

    /// phi at a padded node, `None` beyond the image.
    fn value(&self, layer: usize, [i, j]: [usize; 2]) -> Option<f32> {
        let [nx, ny] = self.body.dims;
        let (i, j) = (i.checked_sub(1)?, j.checked_sub(1)?);
        (i < nx && j < ny).then(|| self.layers[layer].phi[j * nx + i])
    }
}
