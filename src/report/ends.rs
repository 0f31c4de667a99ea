//! Report of what the ends add to the body.

use serde::{Deserialize, Serialize};

/// Gain of the body beyond its first or last contour, by the rule used and by others; as swept, before the fairing. The rule `flat` gains
/// nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EndReport {
    /// Side: below the first contour or above the last.
    pub side: BodyEnd,
    /// Height of that contour.
    pub z: f64,
    /// Its area, unit squared.
    pub area: f64,
    /// Volume by the rule in use, unit cubed.
    pub used: f64,
    /// Volume by `half-slice`: the contour's area through half the gap to its neighbour, unit cubed.
    pub half_slice: f64,
    /// Volume by `extrapolate`: its caps, integrated, unit cubed.
    pub extrapolate: f64,
    /// Closure of each part under `extrapolate` and `peak`; empty under other rules.
    #[serde(default)]
    pub caps: Vec<CapReport>,
}

/// Rule that was used for the end of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CapRule {
    /// The area is quadratic through the last three contours: sphere, ellipsoid, paraboloid.
    Quadratic,
    /// The area goes on by the line of the third and the fourth contour and falls from there by a square: a rod that is rounded off.
    Rounded,
    /// The square root of the area is linear through the last two contours, as the quadratic of three would never end.
    Cone,
    /// The area is linear through the last two contours, as there is no third: paraboloid.
    Paraboloid,
    /// The area is linear by the slope of the contour itself, as no other contour is this part's alone: paraboloid.
    Slope,
    /// The tip is given; the slope is what the areas or the contour say.
    Peak,
    /// The tip is given, and nothing shrinks towards it.
    Upright,
    /// Nothing shrinks: a flat end.
    Flat,
}

/// Closure of a part beyond the first or last contour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CapReport {
    /// Component number.
    pub part: u32,
    /// Rule by which it closes.
    pub rule: CapRule,
    /// Height beyond its contour, unit.
    pub height: f64,
}

/// An end of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BodyEnd {
    /// Below the first contour.
    Bottom,
    /// Above the last.
    Top,
}
