//! No overshoot: discs about one centre stay between their two neighbours.

use std::f64::consts::PI;

use interslice::Settings;
use interslice::settings::{EndRule, SlopeRule};

use super::{Case, Checked, Kind, Property, drawn, made, within};
use crate::random::measure::{area, px};
use crate::random::settings::fine_heights;
use crate::random::source::Source;

/// By this much a radius may leave the range of its neighbours, px.
const BOUND: f64 = 0.1;
/// Layers in every interval.
const PARTS: usize = 8;

pub const PROPERTY: Property = Property {
    name: "discs_in_range",
    draw: |seed| {
        let case = drawn(seed, Kind::Discs);
        let slope = if seed.is_multiple_of(3) { SlopeRule::Pchip } else { SlopeRule::Hyman };
        let (end_bottom, end_top) = (EndRule::Flat, EndRule::Flat);
        // Parts that are kept apart end between their slices.
        Case { settings: Settings { slope, end_bottom, end_top, links: Vec::new(), ..case.settings }, ..case }
    },
    check,
    damage: Some(|stack, _, _, body| {
        let by = 0.3 * px(stack) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v - by));
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let (stack, px) = (&case.stack, px(&case.stack));
    let body = made(source.layers(stack, &fine_heights(stack, &case.settings, PARTS), &case.settings))?;
    let radius = |area: f64| (area / PI).sqrt();
    let contours: Vec<f64> = body.layers.iter().filter(|l| l.contour.is_some()).map(|l| radius(area(l, px))).collect();
    let (mut most, mut at) = (0.0, String::new());
    for layer in body.layers.iter().filter(|l| l.contour.is_none()) {
        let i = stack.slices.partition_point(|s| s.z <= layer.z).clamp(1, contours.len() - 1) - 1;
        let [low, high] = [contours[i].min(contours[i + 1]), contours[i].max(contours[i + 1])];
        let r = radius(area(layer, px));
        let by = (r - high).max(low - r);
        if by > most {
            (most, at) = (
                by,
                format!(
                    "radius {r:.2} px at {}, between slices of {:.2} and {:.2}",
                    layer.z,
                    contours[i],
                    contours[i + 1]
                ),
            );
        }
    }
    within(most, BOUND, || at)
}
