//! Which pixels of a layer are near its surface, by the v that is averaged.

use std::ops::Range;

use crate::spline::smoothstep;

/// Pixels with a smaller |v| / B are wholly near the surface, those with a larger than SATURATED not at all.
const NEAR: f32 = 0.4;
pub const SATURATED: f32 = 0.85;
/// At a contour the difference fades out between these: layers beside it read it there, near their own surface.
const FADE: [f32; 2] = [0.82, 0.88];

/// How near the surface a pixel at `|v| / B` is, 1 to 0.
pub fn nearness(ratio: f32) -> f64 {
    smoothstep(f64::from((SATURATED - ratio) / (SATURATED - NEAR)))
}

/// How much of a contour's difference counts at a pixel at `|v| / B`, 1 to 0.
pub fn fade(ratio: f32) -> f64 {
    smoothstep(f64::from((FADE[1] - ratio) / (FADE[1] - FADE[0])))
}

/// The largest `|v| / B` at which the difference of a layer is known, of one at a contour or of another.
pub fn widest(at_contour: bool) -> f32 {
    if at_contour { FADE[1] } else { SATURATED }
}

/// The stretches of a row of v that are nearer the surface than `far`.
pub fn nearer(v: &[f32], far: f32) -> impl Iterator<Item = Range<usize>> {
    let mut at = 0;
    v.chunk_by(move |a, b| (a.abs() < far) == (b.abs() < far)).filter_map(move |some| {
        at += some.len();
        (some[0].abs() < far).then(|| at - some.len()..at)
    })
}
