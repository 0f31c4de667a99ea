//! Among many bodies chance is no evidence: those that are not on the same place of both slices stay apart.

use interslice::Settings;
use interslice::settings::{Method, Motion};
use interslice::stack::{ContourStack, SliceContent};

use super::steps;
use crate::REFERENCE;
use crate::random::measure::pieces;
use crate::random::numbers::Numbers;
use crate::random::source::Source;
use crate::shapes::{circle, masks};

/// Side of the image, and what its margin leaves free, px of the longer side.
const SIDE: f64 = 110.0;
const FREE: f64 = 8.0;
/// Radius of the discs, and least distance of their centres.
const RADIUS: f64 = 4.3;
const APART: f64 = 11.0;

/// Discs on two slices, each on the one or the other and none over another one, and how many.
fn crowd(seed: u64, spacing: [f64; 2]) -> (ContourStack, usize) {
    let mut numbers = Numbers::new(seed);
    let mut centres: Vec<([f64; 2], bool)> = Vec::new();
    for _ in 0..20_000 {
        let at = [0; 2].map(|_| numbers.between(FREE, SIDE - FREE));
        if centres.iter().all(|(c, _)| (c[0] - at[0]).hypot(c[1] - at[1]) >= APART) {
            centres.push((at, numbers.chance(0.5)));
        }
    }
    let mut stack = masks(2, &steps(2, 8.0), &[(); 2].map(|()| circle(0.0, 0.0, 1.0)));
    stack.spacing = spacing;
    stack.dims = spacing.map(|side| (SIDE / side) as usize);
    let [nx, ny] = stack.dims;
    for (slice, of) in stack.slices.iter_mut().zip([false, true]) {
        let inside = |n: usize| {
            let (x, y) = ((n % nx) as f64 * spacing[0], (n / nx) as f64 * spacing[1]);
            centres.iter().any(|(c, on)| *on == of && (c[0] - x).hypot(c[1] - y) < RADIUS)
        };
        slice.content = SliceContent::Mask((0..nx * ny).map(inside).collect());
    }
    (stack, centres.len())
}

/// Discs of a few crowds that are pieces by themselves, a share of them all.
fn apart(seeds: std::ops::Range<u64>, spacing: [f64; 2], settings: &Settings, source: &dyn Source) -> f64 {
    let of = |seed| {
        let (stack, count) = crowd(seed, spacing);
        let body = source.layers(&stack, &steps(17, 0.5), settings).expect("the stack is valid");
        let layers: Vec<_> = body.layers.iter().filter(|layer| layer.output).collect();
        let (_, found) = pieces(&layers, stack.dims, false);
        assert!(count > 40 && found as usize <= count, "{found} pieces of {count} discs");
        [f64::from(found), count as f64]
    };
    let sums = seeds.map(of).fold([0.0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
    sums[0] / sums[1]
}

/// 0.60 of the discs were pieces by themselves (square pixels), the others joined to what lay beside them on the other slice.
#[test]
fn what_meets_by_chance_stays_apart() {
    for (spacing, seeds) in [([1.0, 1.0], 0..4), ([0.5, 1.0], 4..6), ([1.0, 0.5], 6..8)] {
        for method in [Method::Morph, Method::Field] {
            let settings = Settings { method, ..Settings::default() };
            let share = apart(seeds.clone(), spacing, &settings, &REFERENCE);
            println!("{spacing:?}, {method:?}: {share}");
            assert!(share > 0.9, "{spacing:?}, {method:?}: {share}");
        }
    }
    let still = Settings { motion: Motion::None, ..Settings::default() };
    assert_eq!(apart(0..1, [1.0; 2], &still, &REFERENCE), 1.0);
}

#[cfg(feature = "gpu")]
#[test]
fn what_meets_by_chance_stays_apart_on_a_gpu() {
    crate::on_gpu(|source| {
        let share = apart(0..1, [1.0; 2], &Settings::default(), source);
        assert!(share > 0.9, "{share}");
    });
}
