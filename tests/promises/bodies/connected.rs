//! What overlaps stays connected, and nothing floats.

use interslice::Settings;
use interslice::stack::{ContourStack, SliceContent};

use super::{of_zoo, run, steps, ways};
use crate::random::properties::long_pixels::beyond_hulls;
use crate::random::properties::nothing_floats::{floating_in_mesh, floating_in_voxels};
use crate::random::properties::overlaps_connected::torn;
use crate::random::settings::fine_heights;
use crate::shapes::{circle, masks, union};

/// A cylinder of radius 12 that leans by 12 from slice to slice 10 apart, lengths in short pixels: 160 pixels that are `1 / aspect` as long as
/// the others, or as wide.
fn sheared_cylinder(aspect: f64, across: bool) -> ContourStack {
    let (long, short) = (40, 160);
    let mut stack = masks(2, &steps(4, 10.0), &[(); 4].map(|()| circle(0.0, 0.0, 1.0)));
    (stack.dims, stack.spacing) = if across { ([long, short], [aspect, 1.0]) } else { ([short, long], [1.0, aspect]) };
    let [nx, ny] = stack.dims;
    for (k, slice) in stack.slices.iter_mut().enumerate() {
        let inside = |n: usize| {
            let [x, y] = [n % nx, n / nx].map(|v| v as f64);
            let [p, q] = if across { [y, x * aspect] } else { [x, y * aspect] };
            (p - 62.0 - 12.0 * k as f64).hypot(q - 0.5 * aspect * long as f64) < 12.0
        };
        slice.content = SliceContent::Mask((0..nx * ny).map(inside).collect());
    }
    stack
}

#[test]
fn p02_a_sheared_cylinder_on_long_pixels_leaves_no_debris() {
    let mut faults = Vec::new();
    for aspect in [2.5, 3.0, 4.0, 7.0, 8.0] {
        for across in [false, true] {
            let stack = sheared_cylinder(aspect, across);
            let body = run(&stack, &fine_heights(&stack, &Settings::default(), 8), &Settings::default());
            let (beyond, floating) = (beyond_hulls(&stack, &body), floating_in_voxels(&body));
            if beyond > 0 || !floating.is_empty() {
                faults.push(format!("aspect {aspect}, across {across}: {beyond} voxels outside, {floating:?} float"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn p04_overlapping_parts_stay_connected() {
    let beside_a_disc = |x: f64| union(circle(30.0, 45.0, 14.0 + x), circle(70.0, 45.0, 0.4));
    let pixel = masks(90, &steps(3, 8.0), &[0.0, 2.0, 4.0].map(beside_a_disc));
    let mut stacks = vec![("a pixel beside a disc", pixel)];
    stacks.extend(["barely_overlapping", "one_to_four", "four_to_four", "two_to_one"].map(|n| (n, of_zoo(n, 10.0))));
    for (name, stack) in stacks {
        for (way, settings) in ways() {
            let body = run(&stack, &fine_heights(&stack, &settings, 16), &settings);
            let torn = torn(&stack, &body);
            assert!(torn.is_empty(), "{name}, {way}: {torn:?}");
            assert_eq!((floating_in_voxels(&body), floating_in_mesh(&stack, &body)), (vec![], 0), "{name}, {way}");
        }
    }
}
