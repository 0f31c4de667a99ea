//! Half the Courant number gives the same body.

use interslice::Settings;
use interslice::settings::Method;

use super::{Case, Checked, Property, calm_or_any, made, within};
use crate::random::case::without_events;
use crate::random::measure::{change, common, px};
use crate::random::settings::fine_heights;
use crate::random::source::Source;

/// Largest change near the surface without and with events, px.
const BOUNDS: [f64; 2] = [0.05, 0.2];
/// Layers in every interval.
const PARTS: usize = 4;

pub const PROPERTY: Property = Property {
    name: "half_the_step",
    draw: |seed| {
        let case = calm_or_any(seed);
        let cfl = Settings::default().cfl;
        Case { settings: Settings { method: Method::Morph, cfl, ..case.settings }, ..case }
    },
    check,
    damage: Some(|stack, _, settings, body| {
        let by = (settings.cfl * px(stack)) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v - by));
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let (stack, settings) = (&case.stack, &case.settings);
    let heights = fine_heights(stack, settings, PARTS);
    let halved = Settings { cfl: 0.5 * settings.cfl, ..settings.clone() };
    let whole = made(source.layers(stack, &heights, settings))?;
    let half = made(source.layers(stack, &heights, &halved))?;
    let changes = common(&whole, &half).into_iter().map(|(a, b)| change(a.phi.iter().zip(b.phi.iter()), px(stack)));
    let worst = changes.fold(0.0, f64::max);
    let events = !without_events(stack);
    let with = if events { "with" } else { "without" };
    within(worst, BOUNDS[usize::from(events)], || format!("half the step changes the body, {with} events"))
}
