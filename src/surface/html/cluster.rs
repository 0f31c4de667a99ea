//! A mesh with few triangles for looking at: vertices in one cell of a grid become one, at their mean (Rossignac and Borrel, 1993). Needs
//! memory for what is left only. Not closed in general.

use std::collections::HashMap;
use std::io;

use glam::{DVec3, IVec3};

use super::super::mesh::{MeshSource, Vertex};
use super::super::space::unit;

/// Map from a point to its place as it is drawn.
pub type Seen<'s> = dyn Fn(DVec3) -> DVec3 + 's;

/// Triangles to look at.
#[derive(Debug, Clone, Default)]
pub struct ShownMesh {
    /// Vertices.
    pub vertices: Vec<Vertex>,
    /// Their numbers.
    pub triangles: Vec<[u32; 3]>,
    /// Side of the grid's cells as drawn; 0 where all vertices are their own.
    pub cell: f64,
}

impl ShownMesh {
    /// `mesh` as it is, or on the finest of the grids tried that leaves at most `most` triangles.
    ///
    /// # Errors
    /// The errors of reading the mesh.
    pub fn new(mesh: &mut dyn MeshSource, seen: &Seen<'_>, most: usize) -> io::Result<Self> {
        let [_, triangles] = mesh.counts();
        if triangles <= most as u64 {
            return Self::whole(mesh);
        }
        let mut area = 0.0;
        mesh.triangles(&mut |_, corners| {
            let [a, b, c] = corners.map(|v| seen(v.position));
            area += 0.5 * (b - a).cross(c - a).length();
            Ok(())
        })?;
        // A cell of a plane has about two triangles, of a slanting one more.
        let mut cell = (2.0 * area / most as f64).sqrt();
        loop {
            let made = Self::clustered(mesh, seen, cell)?;
            if made.triangles.len() <= most {
                return Ok(made);
            }
            cell *= 1.2;
        }
    }

    fn whole(mesh: &mut dyn MeshSource) -> io::Result<Self> {
        let mut shown = ShownMesh::default();
        mesh.vertices(&mut |v| {
            shown.vertices.push(*v);
            Ok(())
        })?;
        mesh.triangles(&mut |t, _| {
            shown.triangles.push(t.map(|v| v as u32));
            Ok(())
        })?;
        Ok(shown)
    }

    fn clustered(mesh: &mut dyn MeshSource, seen: &Seen<'_>, cell: f64) -> io::Result<Self> {
        // Two sheets in one cell stay apart.
        let key = |v: &Vertex| -> (IVec3, usize, bool) {
            let axis = v.normal.abs().max_position();
            ((seen(v.position) / cell).floor().as_ivec3(), axis, v.normal[axis] < 0.0)
        };
        let mut numbers = HashMap::new();
        let mut first = None;
        let mut shown = ShownMesh { cell, ..ShownMesh::default() };
        let mut counts: Vec<f64> = Vec::new();
        mesh.vertices(&mut |v| {
            let next = shown.vertices.len() as u32;
            let number = *numbers.entry(key(v)).or_insert(next) as usize;
            if number == shown.vertices.len() {
                shown.vertices.push(Vertex::default());
                counts.push(0.0);
            }
            let sum = &mut shown.vertices[number];
            let low = *first.get_or_insert(v.position);
            sum.position += v.position - low;
            sum.normal += v.normal;
            counts[number] += 1.0;
            Ok(())
        })?;
        let low = first.unwrap_or_default();
        for (v, count) in shown.vertices.iter_mut().zip(counts) {
            v.position = low + v.position / count;
            v.normal = unit(v.normal);
        }
        let mut last = None;
        mesh.triangles(&mut |_, corners| {
            let t = corners.map(|v| numbers.get(&key(v)).copied().unwrap_or_default());
            // Neighbours often become the same triangle.
            if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] && last != Some(t) {
                shown.triangles.push(t);
                last = Some(t);
            }
            Ok(())
        })?;
        Ok(shown)
    }
}
