//! Bodies as large as the paper's, made of formulas: the data of its figures are not published.

/// Height of the trunk's planes: unequal gaps, as a scan with planes left out has them.
pub const TRUNK_HEIGHTS: [f64; 12] = [0.0, 9.0, 18.0, 30.0, 39.0, 54.0, 63.0, 72.0, 87.0, 96.0, 105.0, 120.0];

/// The smaller value, rounded off where both are within `k`.
fn joined(a: f64, b: f64, k: f64) -> f64 {
    let near = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * k * near * near
}

/// Distance-like function of an ellipse about `c` with half axes `r`.
fn ellipse([x, y]: [f64; 2], c: [f64; 2], r: [f64; 2]) -> f64 {
    (((x - c[0]) / r[0]).hypot((y - c[1]) / r[1]) - 1.0) * r[0].min(r[1])
}

/// A closed body between heights 0 and 97: an ellipsoid, bent, with a waist.
pub fn bent_body(x: f64, y: f64, z: f64) -> bool {
    let s = (z - 48.5) / 48.5;
    let waist = 1.0 - 0.35 * (-(s / 0.35).powi(2)).exp();
    let size = (1.0 - s * s).max(0.0).sqrt() * waist;
    let (u, v) = (x - 61.0 - 9.0 * (2.5 * s).sin(), y - 93.0 - 14.0 * s);
    (u / 42.0).hypot(v / 66.0) < size
}

/// A pelvis's parts at height `s` from 0 to 1 in an image of 420 x 300: two wings that spread upwards, a wedge behind, an arch in front, and two
/// round heads in their sockets below.
pub fn girdle(x: f64, y: f64, s: f64) -> bool {
    let side = (x - 209.5).abs();
    // A wing is a bent strip, thin where it spreads.
    let spread = 88.0 + 62.0 * s * s;
    let bend = side - spread + 0.0035 * (y - 150.0).powi(2) * (1.0 - 0.5 * s);
    let length = (y - 146.0 + 18.0 * s).abs() - 82.0 + 26.0 * (1.0 - s);
    let wing = (bend.abs() - (7.0 + 15.0 * (1.0 - s).powi(3))).max(length);
    let wedge = ellipse([x, y], [209.5, 222.0 + 14.0 * (s - 0.5)], [22.0 + 30.0 * s, 17.0 + 9.0 * s]).max(0.22 - s);
    let arch = ellipse([x, y], [209.5, 62.0 + 30.0 * s], [74.0 - 40.0 * s, 15.0 - 14.0 * s]).max(40.0 * (s - 0.42));
    let head = ellipse([side, y], [124.0, 138.0], [1.0; 2]) + 1.0;
    let head = head - (27.0f64.powi(2) - (110.0 * (s - 0.22)).powi(2)).max(0.0).sqrt();
    let bone = joined(joined(wing, wedge, 8.0), arch, 10.0);
    // Between socket and head there is a gap.
    bone.max(4.0 - head) < 0.0 || head < 0.0
}

/// Height of a mountain in an image of 276 x 276, in metres above its lowest contour: a peak with a crater open to the north, a shoulder, ridges.
pub fn mountain(x: f64, y: f64) -> f64 {
    let (u, v) = (x - 137.5, y - 142.0);
    let (r, a) = (u.hypot(v), v.atan2(u));
    let ridges = 1.0 + 0.09 * (5.0 * a + 0.03 * r).sin() + 0.05 * (11.0 * a - 0.05 * r).cos();
    let peak = 1150.0 * (-(r / (86.0 * ridges)).powf(1.3)).exp();
    let crater = 520.0 * (-(u / 22.0).powi(2) - ((v + 18.0) / 34.0).powi(2)).exp();
    let shoulder = 260.0 * (-((u + 74.0) / 26.0).powi(2) - ((v - 40.0) / 34.0).powi(2)).exp();
    peak - crater + shoulder - 120.0
}

/// A trunk with arms at height `z` (mm) in an image of 155 x 522 pixels of 0.958 x 2.194 mm.
pub fn trunk(x: f64, y: f64, z: f64) -> bool {
    let at = [0.958 * (x - 77.0), 2.194 * (y - 260.5)];
    let s = z / 120.0;
    let chest = ellipse(at, [4.0 * s, 0.0], [58.0 + 8.0 * s, 190.0 + 70.0 * s * s]);
    let arm = |side: f64| ellipse(at, [6.0 - 10.0 * s, side * (395.0 - 70.0 * s)], [34.0 + 8.0 * s, 62.0 + 14.0 * s]);
    joined(chest, arm(1.0).min(arm(-1.0)), 30.0) < 0.0
}
