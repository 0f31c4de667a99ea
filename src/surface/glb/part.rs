//! A mesh of a file, as it is known before it is written.

use std::io;

use crate::stack::appearance::Appearance;
use crate::surface::mesh::MeshSource;
use crate::surface::space::sub;

/// Bytes of three f32.
pub(super) const VERTEX_BYTES: u64 = 12;
/// Bytes of three u32.
pub(super) const TRIANGLE_BYTES: u64 = 12;

/// Facts about a body besides its mesh.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// Name, number and colour.
    pub appearance: Appearance,
    /// Length unit.
    pub unit: String,
    /// Origin of positions, see [`local`](crate::surface::local).
    pub origin: [f64; 3],
}

/// One mesh of a file.
#[derive(Debug)]
pub(super) struct MeshPart {
    pub(super) about: About,
    /// Vertices and triangles.
    pub(super) counts: [u64; 2],
    /// The box around its vertices, as they are stored.
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
}

impl MeshPart {
    /// Facts about a mesh that must be known before it is written.
    pub(super) fn of(mesh: &mut dyn MeshSource, about: &About) -> io::Result<Self> {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        mesh.vertices(&mut |v| {
            for (a, x) in sub(v.position, about.origin).iter().enumerate() {
                (low[a], high[a]) = (low[a].min(*x as f32), high[a].max(*x as f32));
            }
            Ok(())
        })?;
        Ok(MeshPart { about: about.clone(), counts: mesh.counts(), low, high })
    }

    /// Bytes of positions, normals and triangles.
    pub(super) fn lengths(&self) -> [u64; 3] {
        let [vertices, triangles] = self.counts;
        [vertices * VERTEX_BYTES, vertices * VERTEX_BYTES, triangles * TRIANGLE_BYTES]
    }

    /// Whether its origin is not the world's.
    pub(super) fn is_moved(&self) -> bool {
        self.about.origin != [0.0; 3]
    }

    pub(super) fn bytes(&self) -> u64 {
        self.lengths().iter().sum()
    }
}
