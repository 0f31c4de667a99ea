//! Report of a run with many labels, written as JSON.

use serde::{Deserialize, Serialize};

use crate::report::{AreaProfile, Provenance, Report};

/// Report of what was done and how well.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LabelsReport {
    /// Version of the program.
    pub version: String,
    /// What it was made of, when and where; filled by whoever writes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
    /// Backend that did the work, and why.
    pub backend: String,
    /// One entry per label, by number.
    pub labels: Vec<LabelReport>,
    /// Labels that could not be reconstructed.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Way in which slices were read that could be read in another way too.
    #[serde(default)]
    pub reading: Option<String>,
    /// Notes on the input for a person.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Borders decided between labels; nothing where overlaps were kept.
    pub borders: Option<Borders>,
    /// Wall seconds.
    pub seconds: f64,
}

/// A label that could not be reconstructed.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its number.
    pub label: i64,
    /// Its name, where the input says it.
    pub name: Option<String>,
    /// Why.
    pub why: String,
}

impl LeftOut {
    /// "label 5 `liver`".
    pub fn of(&self) -> String {
        let name = self.name.as_ref().map_or(String::new(), |name| format!(" `{name}`"));
        format!("label {}{name}", self.label)
    }
}

impl std::fmt::Display for LeftOut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: left out, {}", self.of(), self.why)
    }
}

/// One label.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LabelReport {
    /// Its number.
    pub label: i64,
    /// Whether it is another body than alone.
    pub changed: bool,
    /// Output voxels.
    pub voxels: Option<u64>,
    /// Pixels of drawn slices whose side differs from the input, in the label's own run and after all was decided; must be 0.
    pub differing_pixels: u64,
    /// Volume of its mesh, unit cubed.
    pub volume: Option<f64>,
    /// Area of its surface, unit squared.
    pub area: Option<f64>,
    /// Area of the body over its height.
    #[serde(default)]
    pub areas: Option<AreaProfile>,
    /// Its own run, before anything was decided; but `body.floating` counts the pieces of the label that is written, and `broken` says so.
    pub run: Report,
}

/// Share of what a label has between its slices by itself below which a person is told that others were painted there.
const TOLD: f64 = 0.5;

impl LabelReport {
    /// A warning for a label of which others, painted where it would go on, leave little between its slices.
    pub(crate) fn overruled(&self) -> Option<String> {
        let left = self.areas.as_ref()?.between_contours;
        let alone: f64 = self.run.contours.windows(2).map(|c| 0.5 * (c[0].area + c[1].area) * (c[1].z - c[0].z)).sum();
        let share = 100.0 * left / alone;
        (left < TOLD * alone).then(|| {
            format!(
                "others leave {share:.0} % of what its slices say of the space between them, as what is painted stays and, with `complete_slices`, slices \
                 without it are empty; --keep-overlaps gives every label whole"
            )
        })
    }
}

/// Borders decided between labels.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Borders {
    /// Output voxels that several labels had.
    pub overlap_voxels: u64,
    /// Output voxels that none had, inside the union of labels that touch.
    pub gap_voxels: u64,
    /// Pixels of layers that touched no slice of their label once all was decided, and went to others or to none.
    #[serde(default)]
    pub floating_pixels: u64,
    /// Labels that are other bodies than alone.
    pub changed_labels: usize,
    /// Labels that were reconstructed as one body too.
    pub unions: Vec<Vec<i64>>,
}
