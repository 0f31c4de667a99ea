//! Distances are numbers, never 0, and within the promised bound.

use super::{Case, Checked, Property, any, made, within};
use crate::random::measure::px;
use crate::random::settings::any_heights;
use crate::random::source::Source;

/// Layers in every interval.
const PARTS: usize = 4;

pub const PROPERTY: Property = Property {
    name: "bounded",
    draw: any,
    check,
    damage: Some(|stack, _, settings, body| {
        let last = body.layers.len() - 1;
        body.layers[last].phi[0] = (settings.margin() as f64 * px(stack) * 1.01) as f32;
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &any_heights(case, PARTS), &case.settings))?;
    let size = |v: &f32| if v.is_finite() && *v != 0.0 { f64::from(v.abs()) / px(stack) } else { f64::INFINITY };
    let largest = body.layers.iter().flat_map(|l| l.phi.iter()).map(size).fold(0.0, f64::max);
    // A rounding of f32 more, where units are turned into each other.
    within(largest, case.settings.margin() as f64 * (1.0 + 1e-6), || format!("a distance is {largest:.2} px"))
}
