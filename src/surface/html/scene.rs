//! Scene that the page draws, as numbers in base64: 16 bits a coordinate, a normal in two bytes.

use std::io;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use serde::Serialize;

use super::super::mesh::MeshSource;
use super::super::render::{FLATTEST, Polyline};
use super::cluster::ShownMesh;
use crate::stack::Geometry;

/// Most triangles and points of lines, so that the page stays below 10 MB.
const TRIANGLES: usize = 300_000;
const POINTS: usize = 100_000;
/// The largest quantised coordinate.
const MOST: f64 = 65535.0;

/// The surface and the lines on it, in a right-handed frame whose third axis is the stack's.
#[derive(Debug, Serialize)]
pub struct PageScene {
    /// Sides of the box around the body, stack's unit.
    size: DVec3,
    /// Length of one step of a quantised coordinate, stack's unit.
    step: f64,
    /// Heights are drawn so many times larger.
    pub stretch: f64,
    /// Height of the box's floor in the frame.
    floor: f64,
    /// Vertices: x, y, z as u16, the octahedral normal as two i8.
    vertices: String,
    /// Triangles: three u32.
    triangles: String,
    /// Points of the lines: x, y, z and 1 + number of the contour as u16, 0 where a line ends here.
    lines: String,
    /// Triangles of the whole surface.
    #[serde(skip)]
    pub all: u64,
    /// Triangles drawn.
    #[serde(skip)]
    pub drawn: usize,
    /// Side of the cells in which vertices were joined, 0 for none.
    #[serde(skip)]
    pub cell: f64,
}

impl PageScene {
    /// Lowest and highest point, as heights count; nothing where there is no surface.
    pub fn heights(&self) -> Option<[f64; 2]> {
        (self.all > 0).then_some([self.floor, self.floor + self.size.z])
    }

    /// The scene of a mesh and its contour lines.
    ///
    /// # Errors
    /// The errors of reading the mesh.
    pub fn new(geometry: &Geometry, mesh: &mut dyn MeshSource, lines: &[(usize, Polyline)]) -> io::Result<Self> {
        let [x, _, z] = geometry.axes;
        let frame = DMat3::from_cols(x, z.cross(x), z).transpose();
        let seen = |p: DVec3| frame * p;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut widen = |p: DVec3| (low, high) = (low.min(p), high.max(p));
        lines.iter().flat_map(|(_, line)| line).for_each(|p| widen(seen(*p)));
        mesh.vertices(&mut |v| {
            widen(seen(v.position));
            Ok(())
        })?;
        if low.x > high.x {
            (low, high) = (DVec3::ZERO, DVec3::ZERO);
        }
        let size = high - low;
        let stretch = (FLATTEST * size.x.max(size.y) / size.z.max(f64::MIN_POSITIVE)).max(1.0);
        let drawn = |p: DVec3| (seen(p) - low) * DVec3::new(1.0, 1.0, stretch);
        let shown = ShownMesh::new(mesh, &drawn, TRIANGLES)?;
        let step = size.max_element().max(f64::MIN_POSITIVE) / MOST;
        let quantised = |p: DVec3| ((seen(p) - low) / step).round().as_u16vec3().to_array();
        let mut vertices = Vec::with_capacity(8 * shown.vertices.len());
        for v in &shown.vertices {
            vertices.extend(quantised(v.position).iter().flat_map(|c| c.to_le_bytes()));
            vertices.extend(octahedral(seen(v.normal)).map(|c| c as u8));
        }
        let triangles: Vec<u8> = shown.triangles.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        let points: usize = lines.iter().map(|(_, line)| line.len()).sum();
        let every = points.div_ceil(POINTS).max(1);
        let mut drawn = Vec::new();
        for (number, line) in lines {
            let last = line.len().saturating_sub(1);
            for (k, p) in line.iter().enumerate().filter(|(k, _)| k.is_multiple_of(every) || *k == last) {
                let number = if k == last { 0 } else { (number + 1).min(MOST as usize) as u16 };
                drawn.extend(quantised(*p).iter().chain(&[number]).flat_map(|c| c.to_le_bytes()));
            }
        }
        let [_, all] = mesh.counts();
        Ok(PageScene {
            size,
            step,
            stretch,
            floor: low.z - z.dot(geometry.origin),
            vertices: STANDARD.encode(vertices),
            triangles: STANDARD.encode(triangles),
            lines: STANDARD.encode(drawn),
            all,
            drawn: shown.triangles.len(),
            cell: shown.cell,
        })
    }
}

/// A unit vector on the octahedron, unfolded into a square (Meyer et al., 2010).
fn octahedral(n: DVec3) -> [i8; 2] {
    let DVec3 { x, y, z } = n / n.abs().element_sum().max(f64::MIN_POSITIVE);
    let away = |v: f64| if v < 0.0 { -1.0 } else { 1.0 };
    let [x, y] = if z < 0.0 { [(1.0 - y.abs()) * away(x), (1.0 - x.abs()) * away(y)] } else { [x, y] };
    [x, y].map(|v| (127.0 * v).round() as i8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::Mesh;

    #[test]
    fn normals_come_back_from_two_bytes() {
        for k in 0..1000 {
            let z = f64::from(k) / 499.5 - 1.0;
            let (r, a) = ((1.0 - z * z).max(0.0).sqrt(), 2.4 * f64::from(k));
            let n = DVec3::new(r * a.cos(), r * a.sin(), z);
            let [x, y] = octahedral(n).map(|v| f64::from(v) / 127.0);
            let z = 1.0 - x.abs() - y.abs();
            let fold = (-z).max(0.0);
            let back = DVec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize();
            assert!(n.dot(back) > 0.9995, "{n:?} {back:?}");
        }
    }

    #[test]
    fn a_large_surface_is_thinned_to_the_bound() {
        let n = 500u32;
        let at = |i: u32, j: u32| DVec3::new(f64::from(i), f64::from(j), (0.02 * f64::from(i)).sin() * 30.0);
        let mut mesh = Mesh { positions: (0..n * n).map(|k| at(k % n, k / n)).collect(), triangles: Vec::new() };
        for k in (0..n * (n - 1)).filter(|k| k % n + 1 < n) {
            mesh.triangles.extend([[k, k + 1, k + n], [k + 1, k + n + 1, k + n]]);
        }
        let scene = PageScene::new(&Geometry::default(), &mut &mesh, &[]).expect("memory can be read");
        assert!(scene.drawn <= TRIANGLES && scene.drawn > TRIANGLES / 3, "{} triangles", scene.drawn);
        assert!(scene.cell > 0.0 && scene.all == mesh.triangles.len() as u64);
        let bytes = serde_json::to_string(&scene).expect("it can be told").len();
        assert!(bytes < 10 << 20, "{bytes} bytes");
    }
}
