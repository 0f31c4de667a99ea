//! Labels that fill what is painted leave no cracks between each other, whichever of them is not on every slice.

use crate::own_slices::{SIZES, decided};
use interslice::stack::ReadOptions;

const SLICES: [usize; 7] = [0, 5, 10, 15, 20, 25, 30];

/// Cells about random centres, which fill the slices that are painted; one of them, if any, is left to its neighbours on one slice.
fn cells(count: usize, seed: u64, skipped: Option<(u8, usize)>) -> Vec<u8> {
    let [nx, ny, nz] = SIZES;
    let mut state = seed;
    let mut next = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as usize % (16 * n)) as f64 / 16.0
    };
    let centres: Vec<[f64; 3]> = (0..count).map(|_| [next(nx), next(ny), next(nz)]).collect();
    let mut voxels = vec![0; nx * ny * nz];
    for k in SLICES {
        for (n, voxel) in voxels[k * nx * ny..][..nx * ny].iter_mut().enumerate() {
            let away = |c: &[f64; 3]| {
                let [x, y, z] = [(n % nx) as f64 - c[0], (n / nx) as f64 - c[1], k as f64 - c[2]];
                x * x + y * y + z * z
            };
            let there = (1..).zip(&centres).filter(|(label, _)| skipped != Some((*label, k)));
            *voxel = there.min_by(|a, b| away(a.1).total_cmp(&away(b.1))).map_or(0, |(label, _)| label);
        }
    }
    voxels
}

/// Voxels without a label between slices on both of which every pixel is painted.
fn cracks(voxels: &[u8]) -> (usize, Option<String>) {
    let (layers, _, reading) = decided(voxels, &ReadOptions::default(), 1);
    (layers.iter().map(|layer| layer.phi.iter().filter(|label| **label == 0.0).count()).sum(), reading)
}

#[test]
fn a_label_that_is_not_on_one_slice_leaves_no_cracks_between_the_others() {
    for seed in 1..3 {
        let whole = cells(9, seed, None);
        assert_eq!(cracks(&whole).0, 0, "seed {seed}: every label on all of its slices");
        let on = |label: u8, k: usize| whole[k * SIZES[0] * SIZES[1]..][..SIZES[0] * SIZES[1]].contains(&label);
        let skips: Vec<(u8, usize)> = (1..=9)
            .flat_map(|label| SLICES[1..6].iter().map(move |k| (label, *k)))
            .filter(|(label, k)| on(*label, *k) && on(*label, k - 5) && on(*label, k + 5))
            .collect();
        for skipped in skips.into_iter().step_by(11) {
            let (cracks, reading) = cracks(&cells(9, seed, Some(skipped)));
            let told = reading.is_some_and(|said| said.contains(&format!("label {}: interpolated", skipped.0)));
            assert!(told, "seed {seed}: label {} goes on across slice {}", skipped.0, skipped.1);
            assert_eq!(cracks, 0, "seed {seed}: label {} is not on slice {}", skipped.0, skipped.1);
        }
    }
}
