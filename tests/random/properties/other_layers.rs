//! A layer does not depend on which others are asked for: a grid half and an eighth as fine, three layers, one. A crumb alone that would float among
//! the layers at hand, and only then, is on the other side of the surface, as far from it; so is the way that joins a larger piece to the rest.

use super::{Case, Checked, Property, any, made, numbers, within};
use crate::random::measure::{change, common, px};
use crate::random::settings::{ends, inner_heights};
use crate::random::source::Source;

/// Largest change near the surface, px, in double and in single precision.
const BOUNDS: [f64; 2] = [1e-4, 2e-3];

pub const PROPERTY: Property = Property {
    name: "other_layers",
    draw: any,
    check,
    damage: Some(|stack, heights, _, body| {
        let by = 1e-2 * px(stack) as f32 / heights.len() as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v + by));
    }),
};

/// Most pixels of a layer that may have changed sides, as `src/connectivity/grounded.rs` says.
const CRUMB: usize = 12;

fn is_turned(a: f32, b: f32) -> bool {
    a != 0.0 && a == -b
}

fn check(case: &Case, source: &dyn Source) -> Checked {
    let (stack, px) = (&case.stack, px(&case.stack));
    let count = numbers(case).whole(4, 10);
    let coarse = inner_heights(stack, count);
    let [low, high] = ends(stack);
    let part = |z: &[f64]| z.iter().copied().filter(|z| (low..=high).contains(z)).collect::<Vec<f64>>();
    // Heights of finer grids are the very heights of the coarse one where they coincide.
    let finer = |by: usize| {
        let between = |w: &[f64]| (0..by).map(|k| w[0] + (w[1] - w[0]) * k as f64 / by as f64).collect::<Vec<_>>();
        let mut heights: Vec<f64> = coarse.windows(2).flat_map(between).collect();
        heights.push(high);
        heights
    };
    let middle = count / 2;
    let grids = [
        ("half", finer(2)),
        ("an eighth", finer(8)),
        ("three", part(&coarse[middle - 1..=middle + 1])),
        ("one", part(&coarse[middle..=middle])),
    ];
    let all = made(source.layers(stack, &coarse, &case.settings))?;
    let (mut most, mut at) = (0.0, String::new());
    for (name, heights) in grids {
        let some = made(source.layers(stack, &heights, &case.settings))?;
        for (a, b) in common(&all, &some) {
            let turned = a.phi.iter().zip(b.phi.iter()).filter(|(a, b)| is_turned(**a, **b)).count();
            let others = a.phi.iter().zip(b.phi.iter()).filter(|(a, b)| turned > CRUMB || !is_turned(**a, **b));
            let d = change(others, px);
            if d > most {
                (most, at) = (d, format!("the layer at {} is another with {name} of the layers", a.z));
            }
        }
    }
    within(most, BOUNDS[usize::from(source.is_single())], || at)
}
