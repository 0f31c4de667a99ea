//! Name and colour of a body, as its input says.

use serde::{Deserialize, Serialize};

/// Name and colour of a label or ROI.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Appearance {
    /// Its name in the input.
    pub name: Option<String>,
    /// Its number there: the label's value, the ROI's number.
    pub number: Option<i64>,
    /// Its colour there, sRGB.
    pub colour: Option<[u8; 3]>,
    /// What else 3D Slicer knows of a segment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment: Option<Segment>,
}

/// What 3D Slicer tells segments apart by, and what it knows of one, as its `.seg.nrrd` has it: handed on as it came.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Its name in scripts: `Segment_1`.
    pub id: Option<String>,
    /// Terminology and status: `Segmentation.Status:completed|TerminologyEntry:...|`.
    pub tags: Option<String>,
}

impl Appearance {
    /// A label that has no name.
    pub fn label(number: i64) -> Self {
        Appearance { number: Some(number), ..Appearance::default() }
    }

    /// Bodies merged into one: their names, the colour of the first that has one.
    pub fn merged<'a>(all: impl Iterator<Item = &'a Appearance> + Clone) -> Self {
        let names: Vec<&str> = all.clone().filter_map(|a| a.name.as_deref()).collect();
        let mut numbers = all.clone().filter_map(|a| a.number);
        Appearance {
            name: Some(names.join(" + ")).filter(|name| !name.is_empty()),
            number: numbers.next().filter(|_| numbers.next().is_none()),
            colour: all.clone().find_map(|a| a.colour),
            segment: None,
        }
    }
}
