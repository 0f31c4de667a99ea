//! Report of how well each contour is met.

use serde::{Deserialize, Serialize};

/// One input contour and how well it is met.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ContourReport {
    /// Name of the slice.
    pub name: String,
    /// Height.
    pub z: f64,
    /// A user's added contour.
    pub extra: bool,
    /// 4-connected parts.
    pub components: usize,
    /// 8-connected holes.
    pub holes: usize,
    /// Pixels inside.
    pub pixels: usize,
    /// Pixels of the result at this height whose side differs from the input; computed on the layer itself, must be 0.
    pub differing_pixels: usize,
    /// Area of the result at this height, unit squared; a pixel counts by how far it lies inside.
    #[serde(default)]
    pub area: f64,
    /// The body a thousandth of the gap below.
    #[serde(default)]
    pub below: Option<StepBeside>,
    /// The body a thousandth of the gap above.
    #[serde(default)]
    pub above: Option<StepBeside>,
    /// Distance from this contour at which the sweep from below ends.
    pub arrival_from_below: Option<Residual>,
    /// Distance from this contour at which the sweep from above ends.
    pub arrival_from_above: Option<Residual>,
}

/// The body just beside a contour.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StepBeside {
    /// Its area, unit squared.
    pub area: f64,
    /// Largest change of the distance from the contour's layer to this one, where that is at most a pixel from the contour; px.
    pub jump: f64,
    /// Change that the way to the other contour of the interval explains, px. Looked at where `jump` calls for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub explained: Option<f64>,
}

/// Distance of an arriving front from its contour, px.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Mean over the front's crossings.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

impl Residual {
    /// The larger of both, entry by entry: a contour is met as well as its worst group.
    pub fn absorb(&mut self, other: &Residual) {
        self.mean = self.mean.max(other.mean);
        self.max = self.max.max(other.max);
    }
}
