//! Bodies and checks shared by tests.
#![allow(dead_code)]

use std::collections::HashMap;
use std::path::Path;

use interslice::Reconstruction;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::grid::sparse_image::SparseImage;
use interslice::report::Report;
use interslice::stack::Geometry;
use interslice::surface::Layer;
use interslice::surface::mesh::Mesh;
use interslice::surface::stream::LayerSink;

/// A body from an implicit function of (x, y, z), negative inside; every layer is an output layer.
pub fn body(dims: [usize; 2], heights: &[f64], f: impl Fn(f64, f64, f64) -> f64) -> Reconstruction {
    let spacing = [1.0, 1.0];
    let layers = heights
        .iter()
        .map(|&z| {
            let at = |k: usize| f((k % dims[0]) as f64, (k / dims[0]) as f64, z) as f32;
            let phi = (0..dims[0] * dims[1]).map(at).map(|v| if v == 0.0 { f32::MIN_POSITIVE } else { v });
            Layer { z, phi: SparseImage::of(dims, &phi.collect::<Vec<_>>()), output: true, contour: None }
        })
        .collect();
    Reconstruction {
        dims,
        spacing,
        unit: "mm".into(),
        geometry: Geometry::default(),
        extent: [heights[0], heights[heights.len() - 1]],
        layers,
        report: Report::default(),
    }
}

/// Writes a body into the file or folder `path`, layer by layer.
pub fn write(path: &Path, body: &Reconstruction, mask: bool) {
    let mut outputs =
        Outputs::open(&[path.into()], None, Temporary::Random, &mut Places::default()).expect("it can be made");
    let options = OutputOptions { mask, ..OutputOptions::default() };
    let mut sink = outputs.sink(&options);
    sink.begin(&body.header()).expect("it can be written");
    body.layers.iter().try_for_each(|l| sink.layer(l.clone())).expect("it can be written");
    drop(sink);
    outputs.complete(&mut Report::default()).expect("it can be written");
    outputs.rename().expect("it can be renamed");
}

/// Edges that are not in exactly two triangles, once in each direction, by vertex numbers.
pub fn edge_defects(triangles: &[[u32; 3]]) -> usize {
    let mut edges: HashMap<(u32, u32), [usize; 2]> = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
        }
    }
    edges.values().filter(|uses| **uses != [1, 1]).count()
}

/// The same triangles after merging vertices whose f32 positions are equal, as a reader of STL does.
pub fn merged(mesh: &Mesh) -> Vec<[u32; 3]> {
    let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
    let merged: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = numbers.len() as u32;
            *numbers.entry((p.as_vec3() + 0.0).to_array().map(f32::to_bits)).or_insert(next)
        })
        .collect();
    mesh.triangles.iter().map(|t| t.map(|v| merged[v as usize])).collect()
}

/// Parts of a volume joined through faces: whether the pixels `from` on layer `a` and `to` on layer `b` belong to one.
pub fn connected(layers: &[&[f32]], dims: [usize; 2], from: (usize, usize), to: (usize, usize)) -> bool {
    let n = dims[0] * dims[1];
    let inside = |k: usize| layers[k / n][k % n] < 0.0;
    let mut seen = vec![false; n * layers.len()];
    let mut open = vec![from.0 * n + from.1];
    while let Some(k) = open.pop() {
        if !inside(k) || std::mem::replace(&mut seen[k], true) {
            continue;
        }
        let (i, j) = (k % n % dims[0], k % n / dims[0]);
        open.extend((i > 0).then(|| k - 1));
        open.extend((i + 1 < dims[0]).then_some(k + 1));
        open.extend((j > 0).then(|| k - dims[0]));
        open.extend((j + 1 < dims[1]).then_some(k + dims[0]));
        open.extend((k >= n).then(|| k - n));
        open.extend((k + n < seen.len()).then_some(k + n));
    }
    seen[to.0 * n + to.1]
}
