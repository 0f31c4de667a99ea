//! Bodies that the image's border cuts: they come out nearly as in a larger image, end at the border, and keep every promise there.

use crate::shapes::*;
use interslice::progress::Silent;
use interslice::surface::Layer;
use interslice::surface::mesh::closed_surface;
use interslice::{Budget, ContourStack, Means, Reconstruction, Reference, Section, Settings};
use interslice::{reconstruct_section, reconstruct_with};

/// Pixels of the image along either axis.
const N: usize = 56;
/// Pixels of a larger image whose part from column `CUT` on is the image's.
const LARGE: usize = 102;
const CUT: usize = 46;
/// Distance from the border at which bodies are compared, px.
const BAND: usize = 8;

/// Share of a body within `BAND` of the border in which it may differ from the one in the larger image. Measured 0.029 of masks and of grey slices;
/// where the border is a wall it is 0.052 and 0.063.
const DIFFERING: f64 = 0.04;

/// Cylinders that leave the image: tilt in x and y, px per px of height, and radius.
const CYLINDERS: [[f64; 3]; 5] =
    [[0.5, 0.0, 12.0], [0.6, 0.2, 10.5], [0.7, -0.2, 13.0], [0.8, 0.1, 12.0], [0.9, 0.0, 14.0]];

/// Makes a stack: masks or grey slices.
type Make = fn(usize, &[f64], &[Shape]) -> ContourStack;

/// Names and makers of either kind.
const KINDS: [(&str, Make); 2] = [("masks", masks), ("grey", levels)];

/// A cylinder cut every 10 px, in an image that begins at column `first`.
fn cylinder(make: Make, [tilt, turn, radius]: [f64; 3], n: usize, first: usize) -> ContourStack {
    let heights = [0.0, 10.0, 20.0, 30.0, 40.0];
    let slice = |z: f64| circle(50.0 + tilt * (z - 20.0) - first as f64, 25.0 + turn * (z - 20.0), radius);
    make(n, &heights, &heights.map(slice))
}

fn body(stack: &ContourStack) -> Reconstruction {
    let heights: Vec<f64> = (0..=40).map(f64::from).collect();
    reconstruct_with(stack, &heights, &Settings::default(), &Reference, &Silent).expect("a valid stack")
}

#[test]
fn a_body_cut_by_the_border_is_nearly_that_of_a_larger_image() {
    for (kind, make) in KINDS {
        let (mut differing, mut inside) = (0, 0);
        for cylinder_of in CYLINDERS {
            let [own, larger] = [(N, CUT), (LARGE, 0)].map(|(n, first)| body(&cylinder(make, cylinder_of, n, first)));
            assert_eq!(own.layers.len(), larger.layers.len());
            for (own, larger) in own.layers.iter().zip(&larger.layers).filter(|(own, _)| own.output) {
                for (i, j) in (0..N).flat_map(|j| (0..BAND).map(move |i| (i, j))) {
                    let [own, larger] = [own.phi.at(i, j), larger.phi.at(i + CUT, j)].map(|v| v < 0.0);
                    differing += usize::from(own != larger);
                    inside += usize::from(larger);
                }
            }
        }
        println!("{kind}: {differing} pixels of {inside} differ");
        assert!(inside > 20_000 && (differing as f64) < DIFFERING * inside as f64, "{kind}: {differing} of {inside}");
    }
}

#[test]
fn it_is_exact_at_its_slices_and_ends_half_a_pixel_beyond_the_image() {
    for ((kind, make), cylinder_of) in KINDS.into_iter().flat_map(|kind| CYLINDERS.map(|cylinder| (kind, cylinder))) {
        let body = body(&cylinder(make, cylinder_of, N, CUT));
        let report = &body.report;
        assert!(report.contours.iter().all(|c| c.differing_pixels == 0), "{kind} {cylinder_of:?}");
        let loose = report.body.floating + report.body.voids + report.body.torn.len();
        assert_eq!(loose, 0, "{kind} {cylinder_of:?}");
        for layer in &body.layers {
            for j in (0..N).filter(|&j| layer.phi.at(0, j) < 0.0) {
                assert!(layer.phi.at(0, j) >= -0.5, "{kind} {cylinder_of:?}: {} at row {j}", layer.phi.at(0, j));
            }
        }
        let mesh = closed_surface(&body);
        let first = mesh.positions.iter().fold(f64::MAX, |first, p| first.min(p[0]));
        assert_eq!(first, -0.5, "{kind} {cylinder_of:?}");
    }
}

/// Organs in images that are cropped to their boxes touch the border, but it does not cut them.
#[test]
fn a_body_that_touches_the_border_is_that_of_a_larger_image() {
    let heights = [0.0, 8.0, 16.0, 24.0];
    let stack = |n: usize, first: f64| {
        let slice = |(x, r): (f64, f64)| circle(x - first, 24.0, r);
        masks(n, &heights, &[(60.0, 11.0), (59.0, 13.4), (59.0, 13.4), (61.0, 12.0)].map(slice))
    };
    let [own, larger] = [(N, 46.0), (LARGE, 0.0)].map(|(n, first)| body(&stack(n, first)));
    assert_eq!(own.layers.len(), larger.layers.len());
    for (own, larger) in own.layers.iter().zip(&larger.layers) {
        for (i, j) in (0..40).flat_map(|j| (0..40).map(move |i| (i, j))) {
            assert_eq!(own.phi.at(i, j).to_bits(), larger.phi.at(i + 46, j).to_bits(), "({i}, {j}, {})", own.z);
        }
    }
}

#[test]
fn sections_are_the_whole() {
    // A tube that leaves the image and comes back, again and again.
    let heights: Vec<f64> = (0..40).map(|k| 5.0 * f64::from(k)).collect();
    let slice = |z: &f64| circle(6.0 + 9.0 * (0.06 * z).sin(), 25.0 + 4.0 * (0.05 * z).cos(), 9.0);
    let asked: Vec<f64> = (0..=97).map(|k| 2.0 * f64::from(k)).collect();
    let settings = Settings::default();
    for (kind, make) in KINDS {
        let stack = make(N, &heights, &heights.iter().map(slice).collect::<Vec<_>>());
        let run = |section: &Section| {
            let mut layers = Vec::new();
            let mut keep = |layer: Layer| {
                layers.push(layer);
                Ok(())
            };
            let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::unlimited() };
            reconstruct_section(&stack, section, &asked, &settings, &means, &mut keep).expect("a valid stack");
            layers
        };
        let whole = run(&Section::whole(&stack));
        let parts: Vec<Layer> =
            (1..=4).flat_map(|k| run(&Section::part(&stack, &settings, k, 4).expect("a part"))).collect();
        assert_eq!(whole.len(), parts.len(), "{kind}");
        for (a, b) in whole.iter().zip(&parts) {
            let same = a.z == b.z && a.phi.iter().zip(b.phi.iter()).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same, "{kind} at {}", a.z);
        }
    }
}
