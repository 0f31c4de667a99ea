//! Labels that are thinner than what lies around them.

use interslice::grid::components::label4;
use interslice::stack::ReadOptions;

use crate::own_slices::{SIZES, areas, decided};

/// A wall of a pixel that leans by 45 degrees through a body, and cuts it in two. Alone both lie over it between slices, deeper than it is thick.
#[test]
fn a_wall_of_a_pixel_is_not_torn_by_the_body_that_it_crosses() {
    let [nx, ny, nz] = SIZES;
    let label = |n: usize| {
        let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)];
        let body = (i as f64 - 31.5).hypot(j as f64 - 23.5) < 22.0;
        if body { 1 + u8::from(i == 16 + k) } else { 0 }
    };
    let truth: Vec<u8> = (0..nx * ny * nz).map(label).collect();
    let mut voxels = truth.clone();
    voxels.chunks_mut(nx * ny).enumerate().filter(|(k, _)| k % 5 > 0).for_each(|(_, slice)| slice.fill(0));
    let layers = decided(&voxels, &ReadOptions::default(), 1).0;
    let (mut common, all) = (0, areas(&layers, 2).iter().sum::<usize>() + truth.iter().filter(|l| **l == 2).count());
    for (layer, truth) in layers.iter().zip(truth.chunks(nx * ny)) {
        let wall: Vec<bool> = layer.phi.iter().map(|l| *l == 2.0).collect();
        common += wall.iter().zip(truth).filter(|(is, of)| **is && **of == 2).count();
        assert_eq!(label4(&wall, [nx, ny]).count, 1, "pieces of the wall at {}", layer.z);
    }
    let dice = 2.0 * common as f64 / all as f64;
    assert!(dice > 0.9, "{dice:.3}");
}
