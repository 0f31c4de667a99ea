//! A block of the surface.

use glam::DVec3;

use super::super::mesh::Mesh;

/// A block: triangles of the surface as it is now, and the samples of the given one that lie within the error of them.
pub(super) struct Block<'m> {
    /// The given surface.
    pub given: &'m Mesh,
    /// Largest distance allowed.
    pub error: f64,
    /// Numbers of the block's vertices, increasing.
    pub vertices: Vec<u32>,
    /// Where these lie now.
    pub positions: Vec<DVec3>,
    /// Its triangles, by places among these.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices that other blocks have as well.
    pub border: Vec<bool>,
    /// Samples, and of each a triangle of the block near it.
    pub samples: Vec<[u32; 2]>,
}
