//! The first pass through a volume: which labels or grey values there are, and which slices of each axis are painted.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use crate::error::Result;
use crate::input::volume::sheets::{Counting, Sheets};
use crate::input::volume::{Volume, VoxelRun};
use crate::stack::cut::Cut;

/// Labels from 0 to here are counted in a table.
const TABLE: usize = 1 << 16;
/// Most other labels that are told apart.
const MOST_OTHERS: usize = 1 << 16;

/// Labels whose slices are known one by one.
const MEMBERS: usize = 256;

/// Survey of what a volume holds.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Voxels of each label but 0.
    pub labels: BTreeMap<i64, u64>,
    /// For each label and axis the first and last slice on which it is.
    pub extents: BTreeMap<i64, [[usize; 2]; 3]>,
    /// For each label and axis the slices on which it is; nothing where one label is wanted, or there are more than some hundreds.
    pub slices: BTreeMap<i64, [Vec<bool>; 3]>,
    /// Whether there are more labels than were told apart.
    pub more: bool,
    /// Least and largest grey value, where that is what voxels are.
    pub greys: Option<[f64; 2]>,
    /// For each axis and each slice across it: whether it has a voxel that is wanted.
    pub painted: [Vec<bool>; 3],
    /// Slices that stand alone; of labels only.
    pub sheets: Sheets,
    /// Places along the file's rows where a label meets another: neither is 0.
    pub borders: u64,
}

/// Fewest values of a volume that may be grey: no list of organs is told apart from an image by less.
const GREY: usize = 64;
/// Voxels per place where a value meets another, along rows, below which they are grey. In brain images there are 1.0 to 1.2 (noise), of 8 bits and
/// smooth 1.5; of cells of 4 voxels across that fill the volume, the smallest that anybody labels, 3, and of labels that touch none the more: what is
/// painted on slices across the rows has no neighbours at all there.
const ALIKE: f64 = 2.0;

impl Survey {
    /// Goes through the volume; `label` is what is wanted, else all that is not 0.
    ///
    /// # Errors
    /// The errors of [`Volume::labels`].
    pub fn of(volume: &Volume, label: Option<i64>) -> Result<Self> {
        let mut survey = Survey { painted: volume.grid.dims.map(|n| vec![false; n]), ..Survey::default() };
        let mut table = vec![0u64; TABLE];
        let mut extents: HashMap<i64, [[usize; 2]; 3]> = HashMap::new();
        let mut slices: HashMap<i64, [Vec<bool>; 3]> = HashMap::new();
        let mut sheets = Counting::new(volume.grid.dims, volume.stored);
        volume.labels(|run| {
            let (mut start, mut before) = (0, 0);
            // Labels come in long stretches of the same.
            for stretch in run.values.chunk_by(|a, b| a == b) {
                let (value, length) = (stretch[0], stretch.len());
                let places = start..start + length;
                start += length;
                match usize::try_from(value) {
                    Ok(v) if v < TABLE => table[v] += length as u64,
                    _ => survey.count(value, length as u64),
                }
                survey.borders += u64::from(value != 0 && before != 0);
                before = value;
                if value != 0 && (extents.len() < TABLE + MOST_OTHERS || extents.contains_key(&value)) {
                    let extent = extents.entry(value).or_insert([[usize::MAX, 0]; 3]);
                    for (axis, [low, high]) in extent.iter_mut().enumerate() {
                        let along = usize::from(axis == run.along);
                        *low = (*low).min(run.first[axis] + along * places.start);
                        *high = (*high).max(run.first[axis] + along * (places.end - 1));
                    }
                }
                if value != 0 && label.is_none() && slices.len() <= MEMBERS {
                    let on = slices.entry(value).or_insert_with(|| volume.grid.dims.map(|n| vec![false; n]));
                    paint(on, &run, places.clone());
                }
                if wanted(label, value) {
                    let mut first = run.first;
                    first[run.along] += places.start;
                    sheets.paint(first, length);
                    paint(&mut survey.painted, &run, places);
                }
            }
        })?;
        if slices.len() <= MEMBERS {
            survey.slices = slices.into_iter().collect();
        }
        let counted = table.into_iter().enumerate().skip(1).filter(|(_, n)| *n > 0);
        survey.labels.extend(counted.map(|(label, n)| (label as i64, n)));
        survey.extents = extents.into_iter().filter(|(label, _)| survey.labels.contains_key(label)).collect();
        survey.sheets = sheets.finish();
        Ok(survey)
    }

    /// Message where labels are many and neighbours hardly ever have the same: grey values.
    pub fn grey(&self) -> Option<String> {
        let voxels: u64 = self.labels.values().sum();
        let (count, alike) = (self.labels.len(), voxels as f64 / self.borders as f64);
        if count < GREY || alike >= ALIKE {
            return None;
        }
        let ends = self.labels.keys().next().zip(self.labels.keys().next_back());
        let range = ends.map_or(String::new(), |(low, high)| format!(" from {low} to {high}"));
        Some(format!(
            "has {count} different values{range}, few neighbours the same: grey values, not labels; cut them with `--level`, or choose one \
             with `--label`"
        ))
    }

    /// Goes through a volume of grey values; what is inside by `cut` is wanted.
    ///
    /// # Errors
    /// The errors of [`Volume::greys`]; [`Error::Setting`] for a level that no contour can have.
    pub fn inside(volume: &Volume, cut: Cut) -> Result<Self> {
        let mut survey = Survey { painted: volume.grid.dims.map(|n| vec![false; n]), ..Survey::default() };
        let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
        volume.greys(|run| {
            let mut start = 0;
            for stretch in run.values.chunk_by(|a, b| (cut.depth(*a) < 0.0) == (cut.depth(*b) < 0.0)) {
                let places = start..start + stretch.len();
                start = places.end;
                (low, high) = stretch.iter().fold((low, high), |(low, high), v| (low.min(*v), high.max(*v)));
                if cut.depth(stretch[0]) < 0.0 {
                    paint(&mut survey.painted, &run, places);
                }
            }
        })?;
        cut.check([low, high], "the volume's values")?;
        survey.greys = Some([low, high]);
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

/// Notes on the slices of each axis that these places of a run are painted.
fn paint<T>(slices: &mut [Vec<bool>; 3], run: &VoxelRun<'_, T>, places: Range<usize>) {
    for (axis, painted) in slices.iter_mut().enumerate() {
        let first = run.first[axis];
        if axis == run.along {
            painted[first + places.start..first + places.end].fill(true);
        } else {
            painted[first] = true;
        }
    }
}

/// Whether a voxel is inside.
pub(crate) fn wanted(label: Option<i64>, value: i64) -> bool {
    label.map_or(value != 0, |label| value == label)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_values_are_many_and_hardly_alike() {
        let survey = |count: usize, alike: u64| Survey {
            labels: (1..=count as i64).map(|label| (label, 10 * alike)).collect(),
            borders: 10 * count as u64,
            ..Survey::default()
        };
        assert!(survey(GREY, 1).grey().is_some_and(|message| message.contains("64 different values from 1 to 64")));
        for labels in [survey(GREY - 1, 1), survey(GREY, 2), survey(4 * GREY, 3)] {
            assert_eq!(labels.grey(), None);
        }
    }
}
