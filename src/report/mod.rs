//! The certificate of a reconstruction: what was done and how well each contour is met. Written as JSON.

pub(crate) mod apart;
pub mod body;
pub mod clock;
pub mod contour;
pub mod ends;
pub mod interval;
pub mod profile;
pub mod provenance;
pub mod verdict;
pub(crate) mod warnings;

use serde::{Deserialize, Serialize};

pub use self::body::{AreaProfile, BodyReport, PartPair, Step};
pub use self::contour::{ContourReport, Residual, StepBeside};
pub use self::ends::{BodyEnd, CapReport, CapRule, EndReport};
pub use self::interval::{Event, IntervalReport, LinkReport, LinkedBy, Particles};
pub use self::profile::{Busy, DeviceUse, KernelCost, Profile, StageCost, StageReport};
pub use self::provenance::Provenance;
use crate::settings::Settings;

/// Report of a reconstruction: what was done and how well.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Report {
    /// Version of the program.
    pub version: String,
    /// What it was made of, when and where; filled by whoever writes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
    /// Settings used.
    pub settings: Settings,
    /// Backend that did the work.
    pub backend: String,
    /// Reason for this backend; filled by whoever chose it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub backend_reason: Option<String>,
    /// Cost of a run on a GPU; its kernels are filled in by whoever chose it.
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
    /// Intervals, counted from 0, in which a part ends: how far from its contour depends on all slices of the stack, a little.
    #[serde(skip)]
    pub closing: Vec<usize>,
    /// Warnings to a person: parts that do not shrink at an extrapolated end, fronts that stopped short. Many of one kind are one: their number and
    /// the first three places.
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
        self.closing.extend(above.closing);
        self.body.join(above.body);
        self.judge();
        for stage in above.stages {
            match self.stages.iter_mut().find(|s| s.name == stage.name) {
                Some(own) => own.seconds += stage.seconds,
                None => self.stages.push(stage),
            }
        }
        if let Some(above) = above.profile {
            StageCost::join(&mut self.profile.get_or_insert_default().stages, &above.stages);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Warnings of a body whose parts were made on these machines.
    fn joined(machines: &[&str]) -> Vec<String> {
        let part = |backend: &&str| Report { backend: backend.to_string(), ..Report::default() };
        let mut parts = machines.iter().map(part);
        let mut whole = parts.next().expect("a part");
        parts.for_each(|part| whole.join(part));
        whole.warnings
    }

    #[test]
    fn parts_of_different_drivers_are_told_apart() {
        let (old, new) = ("GPU A (Vulkan, driver 1.0)", "GPU A (Vulkan, driver 1.1)");
        let (two, four) = ("reference path (f64, 2 threads)", "reference path (f64, 4 threads)");
        for same in [&[old, old][..], &[two, four], &[four, two, four]] {
            assert!(joined(same).is_empty(), "{same:?}");
        }
        for apart in [[old, new], [old, two], [four, new]] {
            let warnings = joined(&apart);
            assert!(matches!(&warnings[..], [one] if one.contains("different machines")), "{apart:?}: {warnings:?}");
        }
        assert_eq!(joined(&[old, old, new, old, two]).len(), 2, "each that is new is told");
    }
}
