//! The closed surface of a reconstruction as triangles, and what can be measured on it.

use std::io;

use glam::DVec3;

use super::Reconstruction;
use super::marching::{Builder, Piece};
use super::space::unit;

/// Triangles in world coordinates (LPS, unit of the stack), counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<DVec3>,
    /// Vertex numbers of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Enclosed volume `1/6 sum a . (b x c)`, unit cubed.
    pub fn volume(&self) -> f64 {
        self.measure().volume()
    }

    /// Surface area, unit squared.
    pub fn area(&self) -> f64 {
        self.measure().area()
    }

    /// Adds a piece of a surface, whose pieces come in their order. At most 2^32 vertices in all.
    pub fn add(&mut self, piece: &Piece) {
        self.positions.extend(piece.positions());
        self.triangles.extend(piece.triangles().map(|t| t.map(|v| v as u32)));
    }

    fn measure(&self) -> MeshMeasure {
        let mut measure = MeshMeasure::default();
        measure.add_about(self.positions.first(), self.corners());
        measure
    }

    /// Unit normals of the vertices, outward: mean of the triangles around, by area.
    pub fn normals(&self) -> Vec<DVec3> {
        let mut out = vec![DVec3::ZERO; self.positions.len()];
        for (t, [a, b, c]) in self.triangles.iter().zip(self.corners()) {
            let n = (b - a).cross(c - a);
            t.iter().for_each(|&v| out[v as usize] += n);
        }
        out.into_iter().map(unit).collect()
    }

    /// Corner positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|v| self.positions[v as usize]))
    }
}

/// A vertex of a mesh, as writers need it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Vertex {
    /// World coordinates.
    pub position: DVec3,
    /// Unit normal, outward.
    pub normal: DVec3,
}

/// Is shown vertices.
pub type EachVertex<'e> = dyn FnMut(&Vertex) -> io::Result<()> + 'e;
/// Is shown triangles: numbers of their corners, and these.
pub type EachTriangle<'e> = dyn FnMut([u64; 3], [&Vertex; 3]) -> io::Result<()> + 'e;

/// A mesh that a writer reads in as many passes as its format needs, so that it need not be in memory.
pub trait MeshSource {
    /// Number of vertices and of triangles.
    fn counts(&self) -> [u64; 2];

    /// One pass over all vertices.
    ///
    /// # Errors
    /// The errors of reading; what `each` says.
    fn vertices(&mut self, each: &mut EachVertex<'_>) -> io::Result<()>;

    /// One pass over all triangles.
    ///
    /// # Errors
    /// The errors of reading; what `each` says.
    fn triangles(&mut self, each: &mut EachTriangle<'_>) -> io::Result<()>;
}

impl MeshSource for &Mesh {
    fn counts(&self) -> [u64; 2] {
        [self.positions.len() as u64, self.triangles.len() as u64]
    }

    fn vertices(&mut self, each: &mut EachVertex<'_>) -> io::Result<()> {
        let normals = self.normals();
        self.positions.iter().zip(normals).try_for_each(|(&position, normal)| each(&Vertex { position, normal }))
    }

    fn triangles(&mut self, each: &mut EachTriangle<'_>) -> io::Result<()> {
        let vertex = |(&position, normal)| Vertex { position, normal };
        let vertices: Vec<Vertex> = self.positions.iter().zip(self.normals()).map(vertex).collect();
        self.triangles.iter().try_for_each(|t| each(t.map(u64::from), t.map(|v| &vertices[v as usize])))
    }
}

/// Volume and area, added up triangle by triangle.
#[derive(Debug, Clone, Default)]
pub struct MeshMeasure {
    /// Far from the world's origin the terms of the volume would cancel: they are taken about the first vertex.
    about: Option<DVec3>,
    sixfold: f64,
    area: f64,
}

impl MeshMeasure {
    /// Adds a piece of the surface.
    pub fn add(&mut self, piece: &Piece) {
        self.add_about(piece.positions().first(), piece.corners());
    }

    fn add_about(&mut self, first: Option<&DVec3>, corners: impl Iterator<Item = [DVec3; 3]>) {
        let Some(o) = self.about.or(first.copied()) else { return };
        self.about = Some(o);
        for [a, b, c] in corners {
            self.sixfold += (a - o).dot((b - o).cross(c - o));
            self.area += 0.5 * (b - a).cross(c - a).length();
        }
    }

    /// Enclosed volume, unit cubed.
    pub fn volume(&self) -> f64 {
        self.sixfold / 6.0
    }

    /// Area, unit squared.
    pub fn area(&self) -> f64 {
        self.area
    }
}

/// The body's surface: closed, every edge in exactly two triangles, oriented outward.
///
/// Around the image all is outside; where the body touches its border, the surface runs half a pixel beyond. Where the body is still
/// inside on its first or last layer (`extent`), it gets a flat lid exactly at that height.
///
/// A mesh in memory has at most 2^32 vertices; [`BodyStream`](super::stream::BodyStream) has no such limit.
pub fn closed_surface(body: &Reconstruction) -> Mesh {
    let mut builder = Builder::new(&body.header());
    let mut mesh = Mesh::default();
    let mut add = |piece: &Piece| mesh.add(piece);
    for layer in &body.layers {
        builder.layer(layer);
        builder.pieces(&mut add);
    }
    builder.finish();
    builder.pieces(&mut add);
    mesh
}
