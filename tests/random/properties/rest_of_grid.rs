//! What lies beyond the contours, and whether there is a grid at all there, changes no bit of a layer between them.

use super::{Case, Checked, Property, any, made, numbers, within};
use crate::random::measure::{change, common, px};
use crate::random::settings::{ends, inner_heights, mean_gap};
use crate::random::source::Source;

pub const PROPERTY: Property = Property {
    name: "rest_of_grid",
    draw: any,
    check,
    damage: Some(|stack, heights, _, body| {
        if heights.last() > Some(&ends(stack)[1]) {
            body.layers.iter_mut().for_each(|l| l.phi[0] += 1e-6);
        }
    }),
};

/// Counts values with other bits.
fn check(case: &Case, source: &dyn Source) -> Checked {
    let (stack, px) = (&case.stack, px(&case.stack));
    let mut n = numbers(case);
    let inner = inner_heights(stack, n.whole(5, 14));
    let [low, high] = ends(stack);
    let step = inner[1] - inner[0];
    let reach = n.between(0.2, 3.0) * mean_gap(stack);
    let by = |step: f64, from: f64, reach: f64| {
        let count = (reach / step).clamp(1.0, 24.0) as usize;
        (1..=count).map(move |k| from + step.copysign(reach) * k as f64).collect::<Vec<_>>()
    };
    let below = |step: f64| by(step, low, reach).iter().map(|z| 2.0 * low - z).rev().collect::<Vec<_>>();
    let rests = [
        [vec![], by(step, high, step)],
        [below(step), by(step, high, reach)],
        [below(n.ratio(0.2, 5.0) * step), by(n.ratio(0.2, 5.0) * step, high, reach)],
    ];
    let alone = made(source.layers(stack, &inner, &case.settings))?;
    let (mut differing, mut most) = (0usize, 0.0f64);
    for [below, above] in rests {
        let heights = [below, inner.clone(), above].concat();
        let body = made(source.layers(stack, &heights, &case.settings))?;
        let between = |z: f64| (low..=high).contains(&z);
        let pairs: Vec<_> = common(&alone, &body).into_iter().filter(|(a, _)| between(a.z)).collect();
        differing += inner.len().saturating_sub(pairs.len()) * stack.dims[0] * stack.dims[1];
        for (a, b) in pairs {
            differing += a.phi.iter().zip(b.phi.iter()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            most = most.max(change(a.phi.iter().zip(b.phi.iter()), px));
        }
    }
    within(differing as f64, 0.0, || {
        format!("{differing} values have other bits, by up to {most:.3} px near the surface")
    })
}
