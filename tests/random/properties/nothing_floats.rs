//! Every piece of the body touches an input, in voxels and in the mesh.

use std::collections::BTreeMap;

use glam::DVec3;
use interslice::Reconstruction;
use interslice::stack::ContourStack;
use interslice::surface::Layer;
use interslice::surface::mesh::closed_surface;

use super::overlaps_connected::PARTS;
use super::{Case, Checked, Property, any, made, within};
use crate::random::measure::{pieces, px};
use crate::random::settings::any_heights;
use crate::random::source::Source;

pub const PROPERTY: Property = Property {
    name: "nothing_floats",
    draw: any,
    check,
    damage: Some(|stack, _, _, body| {
        let inside = -0.3 * px(stack) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).skip(PARTS / 2).take(1).for_each(|l| l.phi[0] = inside);
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &any_heights(case, PARTS), &case.settings))?;
    let (voxels, mesh) = (floating_in_voxels(&body), floating_in_mesh(stack, &body));
    let most = voxels.iter().max().unwrap_or(&0);
    within((voxels.len() + mesh) as f64, 0.0, || {
        format!("{} pieces of voxels float, up to {most} voxels, and {mesh} of the mesh", voxels.len())
    })
}

/// Voxels of each piece that has no pixel on a contour's layer.
pub fn floating_in_voxels(body: &Reconstruction) -> Vec<usize> {
    let layers: Vec<&Layer> = body.layers.iter().collect();
    let (labels, count) = pieces(&layers, body.dims, true);
    let n = body.dims[0] * body.dims[1];
    let (mut sizes, mut held) = (vec![0; count as usize + 1], vec![false; count as usize + 1]);
    for (k, label) in labels.iter().enumerate() {
        sizes[*label as usize] += 1;
        held[*label as usize] |= layers[k / n].contour.is_some();
    }
    (1..=count as usize).filter(|p| !held[*p]).map(|p| sizes[p]).collect()
}

/// Pieces of the mesh around something (a void is none) that reach the height of no contour.
pub fn floating_in_mesh(stack: &ContourStack, body: &Reconstruction) -> usize {
    let mesh = closed_surface(body);
    let mut joined: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(joined: &mut [u32], mut v: u32) -> u32 {
        while joined[v as usize] != v {
            joined[v as usize] = joined[joined[v as usize] as usize];
            v = joined[v as usize];
        }
        v
    }
    for [a, b, c] in &mesh.triangles {
        for (a, b) in [(a, b), (b, c)] {
            let (a, b) = (root(&mut joined, *a), root(&mut joined, *b));
            joined[a as usize] = b;
        }
    }
    // Lowest and highest point, and six times the volume about the first corner.
    let mut found: BTreeMap<u32, ([f64; 2], DVec3, f64)> = BTreeMap::new();
    for (t, [a, b, c]) in mesh.triangles.iter().zip(mesh.corners()) {
        let piece = found.entry(root(&mut joined, t[0])).or_insert(([a.z, a.z], a, 0.0));
        for p in [a, b, c] {
            piece.0 = [piece.0[0].min(p.z), piece.0[1].max(p.z)];
        }
        let [a, b, c] = [a, b, c].map(|p| p - piece.1);
        piece.2 += a.dot(b.cross(c));
    }
    let slack = 1e-9 * stack.slices.iter().map(|s| s.z.abs()).fold(0.0, f64::max);
    let touches = |[low, high]: [f64; 2]| stack.slices.iter().any(|s| s.z >= low - slack && s.z <= high + slack);
    found.values().filter(|(reach, _, volume)| *volume > 0.0 && !touches(*reach)).count()
}
