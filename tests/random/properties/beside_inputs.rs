//! Beside an input the result is the input.

use interslice::settings::{Method, Motion};
use interslice::stack::ContourStack;
use interslice::{Reconstruction, Settings};

use super::{Case, Checked, Fault, Kind, Property, any, drawn, made, within};
use crate::random::measure::{layer_at, px};
use crate::random::source::Source;

/// Largest jump at an input near the surface, px.
const BOUND: f64 = 0.02;
/// Heights beside a contour, in gaps: what moves as straight on as it does there keeps within `BOUND` of the straight line by far.
const BESIDE: f64 = 1.0 / 512.0;
/// Still closer by this factor: nothing has moved.
const CLOSER: f64 = 8.0;

pub const PROPERTY: Property = Property {
    name: "beside_inputs",
    draw: |seed| Case { settings: Settings::default(), ..any(seed) },
    check,
    damage: Some(shifted),
};

/// Where lines a pixel thin cross, a sweep vanishes and the other one has all the weight.
pub const OF_VANISHED_SWEEPS: Property = Property {
    name: "vanished_sweeps",
    draw: |seed| {
        let case = drawn(seed, Kind::Lines);
        let plain = Settings { method: Method::Morph, motion: Motion::None, fair: 0.0, ..Settings::default() };
        Case { settings: plain, ..case }
    },
    check,
    damage: Some(shifted),
};

fn shifted(stack: &ContourStack, _: &[f64], _: &Settings, body: &mut Reconstruction) {
    let by = 0.05 * px(stack) as f32;
    body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi.map(|v| v + by));
}

fn check(case: &Case, source: &dyn Source) -> Checked {
    let jumps = jumps_beside(&case.stack, &case.settings, source)?;
    let (worst, name) = jumps.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    within(worst, BOUND, || name)
}

/// Jumps at every contour from below and above, px.
pub fn jumps_beside(
    stack: &ContourStack,
    settings: &Settings,
    source: &dyn Source,
) -> Result<Vec<(f64, String)>, Fault> {
    let z: Vec<f64> = stack.slices.iter().map(|s| s.z).collect();
    let mut sides = Vec::new();
    for k in 0..z.len() {
        sides.extend((k > 0).then(|| (k, -BESIDE * (z[k] - z[k - 1]))));
        sides.extend((k + 1 < z.len()).then(|| (k, BESIDE * (z[k + 1] - z[k]))));
    }
    let mut heights = z.clone();
    heights.extend(sides.iter().flat_map(|(k, s)| [s / CLOSER, *s, 2.0 * s].map(|s| z[*k] + s)));
    heights.sort_by(f64::total_cmp);
    let body = made(source.layers(stack, &heights, settings))?;
    let jump = |(k, s): (usize, f64)| {
        let side = if s < 0.0 { "below" } else { "above" };
        (jump_beside(&body, px(stack), z[k], s), format!("it jumps {side} slice {k}"))
    };
    Ok(sides.into_iter().map(jump).collect())
}

/// Value at pixel `n` where the border ends a body, unit of the stack: the distance to the image's nearest edge, half a pixel beyond its pixels.
fn border(body: &Reconstruction, n: usize) -> f64 {
    let of = |a: usize, at: usize| -(at.min(body.dims[a] - 1 - at) as f64 + 0.5) * body.spacing[a];
    of(0, n % body.dims[0]).max(of(1, n / body.dims[0]))
}

/// Largest difference near the surface between the layer at `z` and what the layers at `z + s` and `z + 2 s` continue to, or the layer still
/// closer but for what moves between these; px.
fn jump_beside(body: &Reconstruction, px: f64, z: f64, s: f64) -> f64 {
    let at = |s: f64| layer_at(body, z + s).map(|l| &l.phi);
    let (Some(input), Some(closer), Some(one), Some(two)) = (at(0.0), at(s / CLOSER), at(s), at(2.0 * s)) else {
        return f64::INFINITY;
    };
    let of = |n: usize| {
        let [input, closer, one, two] = [input, closer, one, two].map(|phi| f64::from(phi[n]) / px);
        let near = input.abs() < 1.0 || closer.abs() < 1.0 || (input < 0.0) != (closer < 0.0);
        // Where the border ends the body on some of the layers and not on others there is an edge, which is no jump.
        let ended = [input, closer, one, two].map(|v| (v - border(body, n) / px).abs() < 1e-5);
        let near = near && (ended == [true; 4] || ended == [false; 4]);
        let jump = ((closer - input).abs() - (two - one).abs()).max((2.0 * one - two - input).abs());
        if near { jump } else { 0.0 }
    };
    (0..input.len()).map(of).fold(0.0, f64::max)
}
