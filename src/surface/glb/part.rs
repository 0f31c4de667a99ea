//! A mesh of a file, as it is known before it is written.

use std::io;

use glam::{DVec3, Vec3};

use super::frame::SceneFrame;
use crate::stack::appearance::Appearance;
use crate::surface::mesh::MeshSource;

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
    pub origin: DVec3,
    /// How a scene (`.glb`) lies.
    pub frame: SceneFrame,
}

/// One mesh of a file.
#[derive(Debug)]
pub(super) struct MeshPart {
    pub(super) about: About,
    /// Vertices and triangles.
    pub(super) counts: [u64; 2],
    /// The box around its vertices, as they are stored.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

impl MeshPart {
    /// Facts about a mesh that must be known before it is written.
    pub(super) fn of(mesh: &mut dyn MeshSource, about: &About) -> io::Result<Self> {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        mesh.vertices(&mut |v| {
            let p = (v.position - about.origin).as_vec3();
            (low, high) = (low.min(p), high.max(p));
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
        self.about.origin != DVec3::ZERO
    }

    pub(super) fn bytes(&self) -> u64 {
        self.lengths().iter().sum()
    }
}
