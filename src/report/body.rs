//! Checks of the body as a whole.

use serde::{Deserialize, Serialize};

/// Checks of all layers that are handed on, together.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BodyReport {
    /// Pieces of the body that touch no contour, through faces of pixels.
    pub floating: usize,
    /// Voids within it that touch no contour's outside.
    pub voids: usize,
    /// Pairs of parts of neighbouring contours that overlap and that no link keeps apart.
    pub overlapping: usize,
    /// Pairs of them that are not connected between their contours.
    pub torn: Vec<PartPair>,
    /// Intervals that nothing crosses, though both their contours have parts, by their lower slice, from 0: the body is in pieces there.
    pub apart: Vec<usize>,
    /// Pixels inside a layer below the first contour that lie outside of that contour, and the same above the last, of the layer that has most.
    pub beyond: [usize; 2],
    /// The largest change from one layer to the next near the surface, between the first and the last contour.
    pub largest_step: Option<Step>,
}

impl BodyReport {
    /// Takes in what is known of the section above.
    pub(super) fn join(&mut self, above: BodyReport) {
        self.floating += above.floating;
        self.voids += above.voids;
        self.overlapping += above.overlapping;
        self.torn.extend(above.torn);
        self.apart.extend(above.apart);
        self.beyond = [0, 1].map(|k| self.beyond[k].max(above.beyond[k]));
        let steps = [self.largest_step, above.largest_step].into_iter().flatten();
        // The lower one of two that are equal.
        self.largest_step = steps.reduce(|a, b| if b.px > a.px { b } else { a });
    }
}

/// Two parts of neighbouring contours, numbered as `interslice inspect` does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartPair {
    /// The lower slice, from 0.
    pub slice: usize,
    /// Its part, from 1.
    pub from: u32,
    /// The part of the next slice, from 1.
    pub to: u32,
}

/// A change from layer to layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Height of the lower layer.
    pub from: f64,
    /// Height of the upper one.
    pub to: f64,
    /// Change of the distance where the lower layer's is at most a pixel; px.
    pub px: f64,
}

/// Areas of the body's layers. A pixel counts by how far it lies inside: `1/2 - phi / px`, between 0 and 1.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AreaProfile {
    /// `[height, area]`, lowest first, unit and unit squared.
    pub layers: Vec<[f64; 2]>,
    /// Trapezoidal integral of the area from the first to the last contour, over all layers, unit cubed.
    pub between_contours: f64,
}

impl AreaProfile {
    /// This profile joined with that of the section above, whose first layer is the last one here; nothing where it is not, as there is a gap between them.
    pub(super) fn joined(mut self, above: AreaProfile) -> Option<Self> {
        let [last, first] = [self.layers.last()?, above.layers.first()?];
        if last[0] != first[0] {
            return None;
        }
        self.layers.extend_from_slice(&above.layers[1..]);
        self.between_contours += above.between_contours;
        Some(self)
    }
}
