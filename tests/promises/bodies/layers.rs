//! A layer does not depend on others, and beside an input it is the input.

use interslice::Settings;
use interslice::surface::Layer;

use super::{holds, of_zoo, run, steps, ways};
use crate::REFERENCE;
use crate::random::measure::{area, layer_at};
use crate::random::properties::beside_inputs::jumps_beside;
use crate::shapes::zoo::bar;
use crate::shapes::{circle, masks, plain};

#[test]
fn p03_a_layer_does_not_depend_on_others() {
    let concentric = masks(90, &steps(4, 8.0), &[20.0, 26.0, 16.0, 22.0].map(|r| circle(45.0, 45.0, r)));
    for stack in [concentric, of_zoo("one_to_two", 10.0)] {
        for (_, settings) in ways() {
            holds("other_layers", &stack, settings);
        }
    }
}

#[test]
fn p03_beside_an_input_is_the_input() {
    for name in ["one_to_two", "one_to_one", "square_to_circle"] {
        holds("beside_inputs", &of_zoo(name, 10.0), Settings::default());
    }
}

#[test]
fn p07_no_jump_where_a_sweep_vanishes() {
    let line = |angle: f64| bar(1.0, angle);
    let mut faults = Vec::new();
    for angle in [0.4, 0.8, 1.2, 1.57] {
        let stack = masks(90, &steps(3, 10.0), &[line(0.1), line(0.1 + angle), line(0.1)]);
        let jumps = jumps_beside(&stack, &plain(), &REFERENCE).expect("the stack is valid");
        let surface = |layer: &Layer| area(layer, 1.0);
        faults.extend(jumps.into_iter().filter(|(jump, _)| *jump > 0.02).map(|jump| (angle, jump)));
        // A thousandth of the gap beside each line there is the line, by area: 13.8 px of distance and half of its area were gone.
        let heights = [0.0, 0.01, 9.99, 10.0, 10.01, 19.99, 20.0];
        let body = run(&stack, &heights, &plain());
        for (beside, input) in [(1, 0), (2, 3), (4, 3), (5, 6)] {
            let at = |k: usize| layer_at(&body, heights[k]).expect("it was asked for");
            let [beside, input] = [beside, input].map(|k| surface(at(k)));
            assert!((beside / input - 1.0).abs() < 0.02, "{angle}: {beside} px beside {input}");
        }
    }
    assert!(faults.is_empty(), "{faults:?}");
}
