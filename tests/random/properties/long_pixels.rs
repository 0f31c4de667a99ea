//! Pixels up to eight times as long as wide: nothing lies outside the body.

use interslice::settings::{EndRule, SlopeRule};
use interslice::stack::ContourStack;
use interslice::{Reconstruction, Settings};

use super::{Case, Checked, Kind, Property, drawn, made, within};
use crate::random::measure::{hull, outside, px};
use crate::random::settings::fine_heights;
use crate::random::source::Source;

/// Layers in every interval.
const PARTS: usize = 8;
/// By this many long pixels an inside pixel may lie outside the hull.
const SLACK: f64 = 2.0;

pub const PROPERTY: Property = Property {
    name: "long_pixels",
    draw: |seed| {
        let case = drawn(seed, Kind::Sheared);
        let (end_bottom, end_top) = (EndRule::Flat, EndRule::Flat);
        Case { settings: Settings { slope: SlopeRule::Hyman, end_bottom, end_top, ..case.settings }, ..case }
    },
    check,
    damage: Some(|stack, _, _, body| {
        let inside = -0.3 * px(stack) as f32;
        body.layers.iter_mut().filter(|l| l.contour.is_none()).for_each(|l| l.phi[0] = inside);
    }),
};

fn check(case: &Case, source: &dyn Source) -> Checked {
    let stack = &case.stack;
    let body = made(source.layers(stack, &fine_heights(stack, &case.settings, PARTS), &case.settings))?;
    let beyond = beyond_hulls(stack, &body);
    within(beyond as f64, 0.0, || format!("{beyond} voxels lie outside, pixels are {:?}", stack.spacing))
}

/// Voxels more than two long pixels outside the convex hull of both neighbouring contours, in which a sheared cylinder lies.
pub fn beyond_hulls(stack: &ContourStack, body: &Reconstruction) -> usize {
    let [nx, ny] = stack.dims;
    let place = |n: usize| [stack.spacing[0] * (n % nx) as f64, stack.spacing[1] * (n / nx) as f64];
    let mut beyond = 0;
    for pair in stack.slices.windows(2) {
        let drawn = (0..nx * ny).filter(|n| pair.iter().any(|s| s.content.inside(*n)));
        let hull = hull(drawn.map(place).collect());
        let is_beyond = |n: usize| outside(&hull, place(n)) > SLACK * px(stack);
        for layer in body.layers.iter().filter(|l| l.z > pair[0].z && l.z < pair[1].z) {
            beyond += layer.phi.iter().enumerate().filter(|(n, v)| **v < 0.0 && is_beyond(*n)).count();
        }
    }
    beyond
}
