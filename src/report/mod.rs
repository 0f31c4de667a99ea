//! The certificate of a reconstruction: what was done and how well each contour is met. Written as JSON.

pub mod verdict;

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::settings::Settings;

/// Report of a reconstruction: what was done and how well.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Report {
    /// Version of the program.
    pub version: String,
    /// Settings used.
    pub settings: Settings,
    /// Backend that did the work.
    pub backend: String,
    /// Reason for this backend; filled by whoever chose it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub backend_reason: Option<String>,
    /// Cost of its kernels; filled by whoever asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<Profile>,
    /// Pixels per slice.
    pub dims: [usize; 2],
    /// Pixel spacing.
    pub spacing: [f64; 2],
    /// Length unit.
    pub unit: String,
    /// Volume of the body, unit cubed (of the mesh; filled by whoever makes one).
    pub volume: Option<f64>,
    /// Area of the surface, unit squared.
    pub area: Option<f64>,
    /// Area of the body over its height (at most some thousand layers; filled with the volume).
    #[serde(default)]
    pub areas: Option<AreaProfile>,
    /// Origin of the positions in `.stl` and `.glb`, where that is not the world's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub local_origin: Option<[f64; 3]>,
    /// Gain of the body beyond its first and last contour.
    #[serde(default)]
    pub ends: Vec<EndReport>,
    /// One entry per input contour.
    pub contours: Vec<ContourReport>,
    /// Checks of the body as a whole.
    #[serde(default)]
    pub body: BodyReport,
    /// Checks that failed, in words; empty where everything holds.
    #[serde(default)]
    pub broken: Vec<String>,
    /// One entry per interval between neighbouring contours.
    pub intervals: Vec<IntervalReport>,
    /// Seconds per stage, in the order they ran.
    pub stages: Vec<StageReport>,
    /// Warnings to a person: parts that do not shrink at an extrapolated end, fronts that stopped short.
    pub warnings: Vec<String>,
}

impl Report {
    /// Takes in the report of the section above: its first contour is the last one here.
    pub fn join(&mut self, above: Report) {
        let mut contours = above.contours.into_iter();
        if let (Some(last), Some(first)) = (self.contours.last_mut(), contours.next()) {
            // Each section has computed the layers from its first contour on, and has swept up to its last.
            last.differing_pixels = first.differing_pixels;
            last.arrival_from_above = first.arrival_from_above;
            last.area = first.area;
            last.above = first.above;
        }
        self.contours.extend(contours);
        self.ends.extend(above.ends);
        self.areas = self.areas.take().zip(above.areas).and_then(|(below, above)| below.joined(above));
        self.intervals.extend(above.intervals);
        self.body.join(above.body);
        self.judge();
        for stage in above.stages {
            match self.stages.iter_mut().find(|s| s.name == stage.name) {
                Some(own) => own.seconds += stage.seconds,
                None => self.stages.push(stage),
            }
        }
        let new = above.warnings.into_iter().filter(|w| !self.warnings.contains(w)).collect::<Vec<_>>();
        self.warnings.extend(new);
        if !self.backend.split("; ").any(|known| known == above.backend) {
            if machine(&self.backend) != machine(&above.backend) {
                let (own, other) = (machine(&self.backend), machine(&above.backend));
                self.warnings.push(format!(
                    "parts come from different machines, whose results differ by hundredths of a pixel: {own}; {other}"
                ));
            }
            self.backend = format!("{}; {}", self.backend, above.backend);
        }
    }
}

/// Part of a backend's name on which the result depends: not the number of threads.
fn machine(backend: &str) -> &str {
    if backend.starts_with("reference") { "reference" } else { backend }
}

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
}

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
    /// Pixels inside a layer below the first contour that lie outside of that contour, and the same above the last, of the layer that has most.
    pub beyond: [usize; 2],
    /// The largest change from one layer to the next near the surface, between the first and the last contour.
    pub largest_step: Option<Step>,
}

impl BodyReport {
    /// Takes in what is known of the section above.
    fn join(&mut self, above: BodyReport) {
        self.floating += above.floating;
        self.voids += above.voids;
        self.overlapping += above.overlapping;
        self.torn.extend(above.torn);
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

/// Areas of the body's layers. A pixel counts by how far it lies inside: `1/2 - phi / px`, between 0 and 1.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AreaProfile {
    /// `[height, area]`, lowest first, unit and unit squared.
    pub layers: Vec<[f64; 2]>,
    /// Trapezoidal integral of the area from the first to the last contour, over all layers, unit cubed.
    pub between_contours: f64,
}

impl AreaProfile {
    /// With the profile of the section above, whose first layer is the last one here; nothing where it is not, as there is a gap between them.
    fn joined(mut self, above: AreaProfile) -> Option<Self> {
        let [last, first] = [self.layers.last()?, above.layers.first()?];
        if last[0] != first[0] {
            return None;
        }
        self.layers.extend_from_slice(&above.layers[1..]);
        self.between_contours += above.between_contours;
        Some(self)
    }
}

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

/// Cost of a GPU's kernels, added up by name.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Profile {
    /// Per kernel.
    pub kernels: BTreeMap<Cow<'static, str>, KernelCost>,
    /// Submissions.
    pub submissions: u64,
    /// Bytes sent to the device.
    pub bytes_up: u64,
    /// Bytes read back.
    pub bytes_down: u64,
    /// Share of its time that the device worked; absent unless timed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub busy: Option<Busy>,
}

/// Time in which a device had work, by its own clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Busy {
    /// Time from the beginning to the end of submissions, none of it twice, seconds.
    pub seconds: f64,
    /// Time from the beginning of the first to the end of the last, seconds.
    pub of_seconds: f64,
}

/// Cost of one kernel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelCost {
    /// Dispatches.
    pub dispatches: u64,
    /// Seconds on the device; 0 unless timed.
    pub seconds: f64,
    /// Pixels updated, where they are counted.
    pub pixels: u64,
}

/// Time spent in a stage.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StageReport {
    /// Name of the stage.
    pub name: Cow<'static, str>,
    /// Wall seconds.
    pub seconds: f64,
}
