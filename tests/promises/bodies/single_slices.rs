//! A part that is drawn on one slice only ends half way to both neighbours, whatever its shape, its size and the gap.

use super::ways;
use crate::REFERENCE;
use crate::random::source::Source;
use crate::shapes::{Shape, circle, masks, nothing, square, without};

const SIDE: usize = 96;
const NAMES: [&str; 5] = ["small disc", "disc", "square", "bar", "ring"];

fn shape(name: &str) -> Shape {
    match name {
        "small disc" => circle(48.0, 48.0, 5.0),
        "disc" => circle(48.0, 48.0, 20.0),
        "square" => square(48.0, 48.0, 14.0, 0.4),
        "bar" => Box::new(|x, y| ((x - 48.0).abs() - 6.0).max((y - 48.0).abs() - 33.0)),
        _ => without(circle(48.0, 48.0, 32.0), circle(48.0, 48.0, 18.0)),
    }
}

fn ends_half_way(names: &[&str], gaps: &[f64], source: &dyn Source) {
    for (name, gap) in names.iter().flat_map(|name| gaps.iter().map(move |gap| (name, gap))) {
        let stack = masks(SIDE, &[0.0, *gap, 2.0 * gap], &[nothing(), shape(name), nothing()]);
        // Shares of the gap beyond the slice, to both sides.
        let heights = [-0.9, -0.56, -0.44, 0.0, 0.44, 0.56, 0.9].map(|share| gap * (1.0 + share));
        for (way, settings) in ways() {
            let body = source.layers(&stack, &heights, &settings).expect("the stack is valid");
            let outputs = body.layers.iter().filter(|layer| layer.output);
            let reached: Vec<bool> = outputs.map(|layer| layer.phi.iter().any(|phi| *phi < 0.0)).collect();
            assert_eq!(reached, [false, false, true, true, true, false, false], "{name}, gap {gap}, {way}");
        }
    }
}

/// A bar and a ring ended at 0.23 of the gap, a disc at 0.42, as what vanishes there had a say in how far the gap was.
#[test]
fn a_part_on_one_slice_ends_half_way() {
    ends_half_way(&NAMES, &[0.5, 4.0, 30.0], &REFERENCE);
}

#[cfg(feature = "gpu")]
#[test]
fn a_part_on_one_slice_ends_half_way_on_a_gpu() {
    crate::on_gpu(|source| ends_half_way(&["ring", "bar"], &[8.0], source));
}
