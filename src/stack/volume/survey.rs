//! The first pass through a volume: which labels there are, and which slices of each axis are painted.

use std::collections::BTreeMap;

use super::Volume;
use crate::error::Result;

/// Labels from 0 to here are counted in a table.
const TABLE: usize = 1 << 16;
/// Most other labels that are told apart.
const MOST_OTHERS: usize = 1 << 16;

/// What a volume holds.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Voxels of each label but 0.
    pub labels: BTreeMap<i64, u64>,
    /// Whether there are more labels than were told apart.
    pub more: bool,
    /// For each axis and each slice across it: whether it has a voxel that is wanted.
    pub painted: [Vec<bool>; 3],
}

impl Survey {
    /// Goes through the volume; `label` is what is wanted, else all that is not 0.
    ///
    /// # Errors
    /// As [`Volume::labels`].
    pub fn of(volume: &Volume, label: Option<i64>) -> Result<Self> {
        let mut survey = Survey { painted: volume.grid.dims.map(|n| vec![false; n]), ..Survey::default() };
        let mut table = vec![0u64; TABLE];
        volume.labels(|run| {
            let mut start = 0;
            // Labels come in long stretches of the same.
            for stretch in run.labels.chunk_by(|a, b| a == b) {
                let (value, length) = (stretch[0], stretch.len());
                let places = start..start + length;
                start += length;
                match usize::try_from(value) {
                    Ok(v) if v < TABLE => table[v] += length as u64,
                    _ => survey.count(value, length as u64),
                }
                if wanted(label, value) {
                    for (axis, painted) in survey.painted.iter_mut().enumerate() {
                        let first = run.first[axis];
                        if axis == run.along {
                            painted[first + places.start..first + places.end].fill(true);
                        } else {
                            painted[first] = true;
                        }
                    }
                }
            }
        })?;
        let counted = table.into_iter().enumerate().skip(1).filter(|(_, n)| *n > 0);
        survey.labels.extend(counted.map(|(label, n)| (label as i64, n)));
        Ok(survey)
    }

    fn count(&mut self, label: i64, voxels: u64) {
        if let Some(n) = self.labels.get_mut(&label) {
            *n += voxels;
        } else if self.labels.len() < MOST_OTHERS {
            self.labels.insert(label, voxels);
        } else {
            self.more = true;
        }
    }
}

/// Whether a voxel is inside.
pub(super) fn wanted(label: Option<i64>, value: i64) -> bool {
    label.map_or(value != 0, |label| value == label)
}
