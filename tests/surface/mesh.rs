//! Meshes are closed, edge-manifold and oriented outward whatever the field, and measure what they should.

use crate::support::{body, edge_defects, merged};
use glam::DVec3;
use interslice::grid::sparse_image::SparseImage;
use interslice::surface::contour_lines::contour_lines;
use interslice::surface::mesh::{Mesh, closed_surface};
use proptest::prelude::*;

fn assert_closed(mesh: &Mesh, name: &str) {
    assert_eq!(edge_defects(&mesh.triangles), 0, "{name}: by index");
    assert_eq!(edge_defects(&merged(mesh)), 0, "{name}: after merging equal positions");
    assert!(mesh.volume() > 0.0 || mesh.triangles.is_empty(), "{name}: inside out");
}

/// A reproducible value in [-1, 1) per node.
fn noise(seed: u64, x: f64, y: f64, z: f64) -> f64 {
    let mut k = seed ^ (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64) << 40 ^ ((10.0 * z) as u64) << 20;
    for _ in 0..3 {
        k = (k ^ (k >> 31)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
    }
    (k >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

#[test]
fn noise_in_all_256_cases_is_closed() {
    let heights = [0.0, 1.0, 1.3, 2.9, 3.0, 7.0];
    let mut patterns = [false; 256];
    for seed in 0..400 {
        let bias = [-0.6, -0.2, 0.0, 0.2, 0.6][seed as usize % 5];
        let field = body([7, 6], &heights, |x, y, z| noise(seed, x, y, z) + bias);
        for k in 0..heights.len() - 1 {
            for n in 0..7 * 5 - 1 {
                let bit = |c: usize| {
                    let at = n + (c & 1) + 7 * (c >> 1 & 1);
                    usize::from(field.layers[k + (c >> 2)].phi[at] < 0.0) << c
                };
                patterns[(0..8).map(bit).sum::<usize>()] = true;
            }
        }
        assert_closed(&closed_surface(&field), &format!("seed {seed}"));
    }
    assert!(patterns.iter().all(|p| *p), "every case was tried");
}

proptest! {
    #[test]
    fn random_fields_of_random_magnitude_are_closed(
        values in prop::collection::vec(prop_oneof![
            -1.0f32..1.0, Just(-1e-30f32), Just(1e-30), Just(1e6), Just(-1e6), Just(0.0), -1e-3f32..1e-3
        ], 5 * 4 * 4),
        gaps in prop::collection::vec(0.01f64..20.0, 4),
    ) {
        let heights: Vec<f64> = gaps.iter().scan(0.0, |z, g| { *z += g; Some(*z) }).collect();
        let mut field = body([5, 4], &heights, |_, _, _| 1.0);
        for (layer, v) in field.layers.iter_mut().zip(values.chunks(20)) {
            layer.phi = SparseImage::of([5, 4], v);
        }
        assert_closed(&closed_surface(&field), "random");
    }
}

#[test]
fn a_prism_of_noise_has_the_section_that_contour_lines_have() {
    let (nx, ny) = (12.0, 11.0);
    let mut saddles = 0;
    for seed in 0..60 {
        let bias = [-0.3, 0.0, 0.3][seed as usize % 3];
        let border = |x: f64, y: f64| x < 0.5 || y < 0.5 || x > nx - 1.5 || y > ny - 1.5;
        let value = |x: f64, y: f64| if border(x, y) { 1.0 } else { noise(seed, x, y, 0.0) + bias };
        let prism = body([nx as usize, ny as usize], &[0.0, 0.7, 2.0], |x, y, _| value(x, y));
        let mesh = closed_surface(&prism);
        assert_closed(&mesh, &format!("seed {seed}"));
        let area = |line: &[glam::DVec2]| {
            let next = line.iter().cycle().skip(1);
            0.5 * line.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum::<f64>()
        };
        let lines = contour_lines(&prism.layers[0], prism.dims);
        let section: f64 = lines.iter().map(|line| area(line)).sum();
        // Vertices keep off the corners of cells by a thousandth.
        assert!((mesh.volume() / 2.0 - section).abs() < 0.05, "seed {seed}: {} of {section}", mesh.volume() / 2.0);
        for n in 0..(nx * (ny - 1.0)) as usize - 1 {
            let side = [0, 1, nx as usize, nx as usize + 1].map(|more| prism.layers[0].phi[n + more] < 0.0);
            saddles += usize::from(side[0] == side[3] && side[1] == side[2] && side[0] != side[1]);
        }
    }
    assert!(saddles > 500, "{saddles} cells with a saddle");
}

#[test]
fn a_sphere_has_its_volume_and_area() {
    let errors = [8.0, 16.0, 32.0].map(|r: f64| {
        let n = 2 * r as usize + 6;
        let c = (n - 1) as f64 / 2.0 + 0.21;
        let heights: Vec<f64> = (0..n).map(|k| k as f64).collect();
        let mesh = closed_surface(&body([n, n], &heights, |x, y, z| {
            ((x - c).powi(2) + (y - c).powi(2) + (z - c).powi(2)).sqrt() - r
        }));
        assert_closed(&mesh, "sphere");
        let exact = std::f64::consts::PI * r * r;
        let errors = [mesh.volume() / (4.0 / 3.0 * exact * r) - 1.0, mesh.area() / (4.0 * exact) - 1.0];
        println!("r = {r}: volume {:+.5}, area {:+.5}, {} triangles", errors[0], errors[1], mesh.triangles.len());
        errors
    });
    for kind in 0..2 {
        // Second order: half the size of a cell, a quarter of the error.
        let [a, b, c] = [0, 1, 2].map(|k| errors[k][kind].abs());
        assert!(c < 2e-3 && b < 0.35 * a && c < 0.35 * b, "{errors:?}");
    }
}

#[test]
fn lids_are_flat_at_the_ends() {
    let heights = [2.0, 2.5, 4.0, 9.0];
    let mesh = closed_surface(&body([40, 30], &heights, |x, y, _| (x - 19.0).hypot(y - 14.0) - 10.0));
    assert_closed(&mesh, "cylinder");
    let (low, high) = mesh.positions.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p[2]), b.max(p[2])));
    assert_eq!((low, high), (2.0, 9.0));
    let exact = std::f64::consts::PI * 100.0 * 7.0;
    assert!((mesh.volume() / exact - 1.0).abs() < 5e-3, "{} against {exact}", mesh.volume());
}

#[test]
fn at_the_border_the_surface_runs_half_a_pixel_beyond() {
    let mesh = closed_surface(&body([6, 5], &[0.0, 1.0, 2.0], |_, _, _| -0.5));
    assert_closed(&mesh, "full");
    let range = |a: usize| mesh.positions.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[a]), h.max(p[a])));
    assert_eq!([range(0), range(1), range(2)], [(-0.5, 5.5), (-0.5, 4.5), (0.0, 2.0)]);
    assert!((mesh.volume() - 60.0).abs() < 2.0, "{}", mesh.volume());
}

#[test]
fn a_mirrored_geometry_stays_outward() {
    let mut field = body([20, 20], &[0.0, 1.0, 2.0], |x, y, _| (x - 9.0).hypot(y - 9.0) - 5.0);
    field.geometry.axes[0] = DVec3::NEG_X;
    field.geometry.origin = DVec3::new(100.0, 50.0, 7.0);
    assert_closed(&closed_surface(&field), "mirrored");
}

/// Slabs of more cells than are worked on together, by several threads: strips share vertices, and number them as one thread would that takes cell
/// after cell. A fan asks for its middle, and then for its ring of twelve at most.
#[test]
fn strips_share_vertices_and_number_them_in_order() {
    let bias = |x: f64| if x < 150.0 { 0.0 } else { -0.9 };
    let field = body([301, 240], &[0.0, 1.0, 1.5], |x, y, z| noise(7, x, y, z) + bias(x));
    let threads = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool");
    let mesh = threads(3).install(|| closed_surface(&field));
    assert!(mesh.triangles.len() > 400_000, "{} triangles", mesh.triangles.len());
    assert_closed(&mesh, "noise");
    let mut seen = 0;
    for t in &mesh.triangles {
        for &v in t {
            assert!(v < seen + 14, "vertex {v} comes where {seen} were known");
            seen = seen.max(v + 1);
        }
    }
    assert_eq!(seen as usize, mesh.positions.len());
    assert!(mesh == threads(1).install(|| closed_surface(&field)), "threads change the mesh");
}
