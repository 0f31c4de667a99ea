//! Every input slice is met pixel by pixel.

use super::{Case, Checked, Property, any, made, within};
use crate::random::settings::any_heights;
use crate::random::source::Source;

/// Layers in every interval.
const PARTS: usize = 3;

pub const PROPERTY: Property = Property {
    name: "exact",
    draw: any,
    check,
    damage: Some(|_, _, _, body| {
        body.layers.iter_mut().filter(|l| l.contour == Some(1)).for_each(|l| l.phi[7] = -l.phi[7]);
    }),
};

/// Counts pixels that differ.
fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &any_heights(case, PARTS), &case.settings))?;
    let (mut met, mut differing) = (0, 0usize);
    for layer in &body.layers {
        let Some(k) = layer.contour else { continue };
        met += 1;
        differing +=
            stack.slices[k].content.sides().iter().zip(layer.phi.iter()).filter(|(m, v)| **m != (**v < 0.0)).count();
    }
    differing += (stack.slices.len() - met) * stack.dims[0] * stack.dims[1];
    within(differing as f64, 0.0, || format!("{differing} pixels differ from their slices"))
}
