//! Report of an interval between two neighbouring contours.

use serde::{Deserialize, Serialize};

/// One interval: what happened between two neighbouring contours.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct IntervalReport {
    /// Height of the lower contour.
    pub z_low: f64,
    /// Height of the upper contour.
    pub z_high: f64,
    /// Groups that morph together.
    pub groups: usize,
    /// Topology events, upward.
    pub events: Vec<Event>,
    /// Pairs of parts that were linked or kept apart.
    pub links: Vec<LinkReport>,
    /// Tracker particles, both directions.
    pub particles: Particles,
    /// Time steps of the morphs, both directions and all groups.
    pub trace_steps: usize,
    /// Band pixels updated by those steps.
    pub trace_pixels: usize,
    /// Time steps of the sweeps.
    pub sweep_steps: usize,
    /// Band pixels updated by those steps.
    pub sweep_pixels: usize,
}

/// A pair of parts about which something was known before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkReport {
    /// Component number below.
    pub from: u32,
    /// Component number above.
    pub to: u32,
    /// Joined, or kept apart.
    pub join: bool,
    /// Source of the statement.
    pub by: LinkedBy,
    /// Share of a part's pixels that lie in the other one in the frame in which the slices are compared, of the part that has more of them.
    pub meet: f64,
}

/// Source of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinkedBy {
    /// The user's links.
    File,
    /// `link` auto.
    Auto,
    /// The motion that the slices show, which takes apart what overlaps across a slit as it is drawn.
    Motion,
}

/// Tracker particles of an interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Particles {
    /// Put on the contours.
    pub seeded: usize,
    /// Reached the next contour.
    pub arrived: usize,
    /// Lost on the way: their piece of contour has no counterpart.
    pub died: usize,
}

/// A change of topology between two neighbouring contours, seen from below.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Event {
    /// One or more parts become several.
    Split {
        /// Component numbers below.
        from: Vec<usize>,
        /// Component numbers above.
        to: Vec<usize>,
    },
    /// Several parts become one.
    Merge {
        /// Component numbers below.
        from: Vec<usize>,
        /// Component numbers above.
        to: Vec<usize>,
    },
    /// A part without partner below.
    Birth {
        /// Component number above.
        component: usize,
    },
    /// A part without partner above.
    Death {
        /// Component number below.
        component: usize,
    },
    /// A hole opens on the way up.
    HoleBirth {
        /// Pixels of the hole in the upper contour.
        pixels: usize,
    },
    /// A hole closes on the way up.
    HoleDeath {
        /// Pixels of the hole in the lower contour.
        pixels: usize,
    },
}
