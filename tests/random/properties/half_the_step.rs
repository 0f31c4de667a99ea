//! Half the Courant number gives the same body.

use interslice::settings::Method;
use interslice::stack::ContourStack;
use interslice::surface::Layer;
use interslice::{Reconstruction, Settings};

use super::{Case, Checked, Property, calm_or_any, made, within};
use crate::random::case::without_events;
use crate::random::measure::{change, common, moved, px};
use crate::random::settings::fine_heights;
use crate::random::source::Source;

/// Largest change without and with events, px.
const BOUNDS: [f64; 2] = [0.05, 0.2];
/// Layers in every interval.
const PARTS: usize = 4;

/// Of the distances of every pixel that is less than a pixel away from the surface: more than the surface's own motion, as its neighbours at kinks and
/// in thin parts may change where it stays.
pub const PROPERTY: Property = Property {
    name: "half_the_step",
    draw,
    check: |case, source| check(case, source, |a, b, stack| change(a.phi.iter().zip(b.phi.iter()), px(stack))),
    damage: Some(damage),
};

/// Of the surface itself.
pub const OF_SURFACES: Property = Property {
    name: "half_the_step_of_surfaces",
    draw,
    check: |case, source| check(case, source, |a, b, stack| moved(a, b, stack.dims, px(stack))),
    damage: Some(damage),
};

fn draw(seed: u64) -> Case {
    let case = calm_or_any(seed);
    let cfl = Settings::default().cfl;
    Case { settings: Settings { method: Method::Morph, cfl, ..case.settings }, ..case }
}

fn damage(stack: &ContourStack, _: &[f64], settings: &Settings, body: &mut Reconstruction) {
    let by = (settings.cfl * px(stack)) as f32;
    body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v - by));
}

fn check(case: &Case, source: &dyn Source, of: fn(&Layer, &Layer, &ContourStack) -> f64) -> Checked {
    let (stack, settings) = (&case.stack, &case.settings);
    let heights = fine_heights(stack, settings, PARTS);
    let halved = Settings { cfl: 0.5 * settings.cfl, ..settings.clone() };
    let whole = made(source.layers(stack, &heights, settings))?;
    let half = made(source.layers(stack, &heights, &halved))?;
    let worst = common(&whole, &half).into_iter().map(|(a, b)| of(a, b, stack)).fold(0.0, f64::max);
    let events = !without_events(stack);
    let with = if events { "with" } else { "without" };
    within(worst, BOUNDS[usize::from(events)], || format!("half the step changes the body, {with} events"))
}
