//! A mesh with few triangles for looking at: vertices in one cell of a grid become one, at their mean (Rossignac and Borrel, 1993). Needs
//! memory for what is left only. Not closed in general.

use std::collections::HashMap;
use std::io;

use super::super::mesh::{MeshSource, Vertex, unit};

/// Triangles to look at.
#[derive(Debug, Clone, Default)]
pub struct Shown {
    /// Vertices.
    pub vertices: Vec<Vertex>,
    /// Their numbers.
    pub triangles: Vec<[u32; 3]>,
    /// Side of the grid's cells; 0 where all vertices are their own.
    pub cell: f64,
}

impl Shown {
    /// `mesh` as it is, or on the finest of the grids tried that leaves at most `most` triangles.
    ///
    /// # Errors
    /// Those of reading the mesh.
    pub fn new(mesh: &mut dyn MeshSource, most: usize) -> io::Result<Self> {
        let [_, triangles] = mesh.counts();
        if triangles <= most as u64 {
            return Self::whole(mesh);
        }
        let mut area = 0.0;
        let mut low = [f64::INFINITY; 3];
        mesh.triangles(&mut |_, corners| {
            let p = corners.map(|v| v.position);
            let [a, b] = [1, 2].map(|k| super::super::mesh::sub(p[k], p[0]));
            area += 0.5 * super::super::mesh::length(super::super::mesh::cross(a, b));
            (0..3).for_each(|k| low[k] = low[k].min(p[0][k]));
            Ok(())
        })?;
        // A cell of a plane has about two triangles, of a slanting one more.
        let mut cell = (2.0 * area / most as f64).sqrt();
        loop {
            let made = Self::clustered(mesh, low, cell)?;
            if made.triangles.len() <= most {
                return Ok(made);
            }
            cell *= 1.2;
        }
    }

    fn whole(mesh: &mut dyn MeshSource) -> io::Result<Self> {
        let mut shown = Shown::default();
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

    fn clustered(mesh: &mut dyn MeshSource, low: [f64; 3], cell: f64) -> io::Result<Self> {
        let key = |v: &Vertex| -> [i32; 3] { std::array::from_fn(|a| ((v.position[a] - low[a]) / cell).floor() as i32) };
        let mut numbers: HashMap<[i32; 3], u32> = HashMap::new();
        let mut shown = Shown { cell, ..Shown::default() };
        let mut counts: Vec<f64> = Vec::new();
        mesh.vertices(&mut |v| {
            let next = shown.vertices.len() as u32;
            let number = *numbers.entry(key(v)).or_insert(next) as usize;
            if number == shown.vertices.len() {
                shown.vertices.push(Vertex::default());
                counts.push(0.0);
            }
            let sum = &mut shown.vertices[number];
            for a in 0..3 {
                sum.position[a] += v.position[a] - low[a];
                sum.normal[a] += v.normal[a];
            }
            counts[number] += 1.0;
            Ok(())
        })?;
        for (v, count) in shown.vertices.iter_mut().zip(counts) {
            v.position = std::array::from_fn(|a| low[a] + v.position[a] / count);
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
