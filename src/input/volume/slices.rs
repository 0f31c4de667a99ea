//! The second pass through a volume: the slices that are chosen, as masks of what is painted or cut where grey values cross a level.

use crate::error::{Error, Result};
use crate::input::volume::Volume;
use crate::input::volume::axis::Choice;
use crate::input::volume::survey::{Survey, wanted};
use crate::stack::cut::Cut;
use crate::stack::mask::MaskBits;
use crate::stack::options::ReadOptions;
use crate::stack::{ContourStack, Geometry, HeightGrid, LevelSlice, Slice, SliceContent};
use crate::storage::room;

/// Labels that a message names.
const NAMED: usize = 12;

/// The chosen slices of `label`, of all labels, or of the grey level. Heights are distances along the axis from the volume's first slice, and the volume's own slices
/// are the output grid. Pixels run along the other two axes in the file's order.
///
/// # Errors
/// [`Error::Setting`] for slices that are not there; [`Error::Format`] where none of them is painted; those of [`Volume::labels`].
pub fn stack(
    volume: &Volume,
    survey: &Survey,
    choice: &Choice,
    options: &ReadOptions,
    label: Option<i64>,
) -> Result<ContourStack> {
    let chosen = chosen(volume, survey, choice.axis, options, label)?;
    let axis = choice.axis;
    let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
    let grid = &volume.grid;
    let (dims, spacing, axes) = (grid.dims, grid.spacing(), grid.axes());
    let contents = match options.cut() {
        Some(cut) => levels(volume, &chosen, [u, v, axis], cut)?,
        None => masks(volume, &chosen, [u, v, axis], label)?,
    };
    let letter = ['i', 'j', 'k'][axis];
    let slices = chosen
        .into_iter()
        .zip(contents)
        .map(|(k, content)| Slice { name: format!("{letter}={k}"), z: k as f64 * spacing[axis], extra: false, content })
        .collect();
    Ok(ContourStack {
        dims: [dims[u], dims[v]],
        spacing: [spacing[u], spacing[v]],
        unit: grid.unit.clone(),
        slices,
        z_out: Some(HeightGrid { start: 0.0, step: spacing[axis], count: dims[axis] }),
        geometry: Geometry {
            origin: grid.origin,
            axes: [axes[u], axes[v], axes[axis]],
            order: [u, v, axis],
            space: grid.space,
        },
        known: None,
    })
}

fn chosen(
    volume: &Volume,
    survey: &Survey,
    axis: usize,
    options: &ReadOptions,
    label: Option<i64>,
) -> Result<Vec<usize>> {
    let painted = &survey.painted[axis];
    let count = painted.len();
    let setting = |name: &str, message: String| Err(Error::Setting { name: name.into(), message });
    let chosen: Vec<usize> = match (&options.slices, options.keep) {
        (Some(list), _) => {
            if let Some(&k) = list.iter().find(|&&k| k >= count) {
                return setting("slices", format!("must name slices 0 to {}; got {k}", count - 1));
            }
            let mut list = list.clone();
            list.sort_unstable();
            list.dedup();
            list
        }
        (None, Some(0)) => return setting("keep", "must be at least 1; got 0".into()),
        (None, Some(keep)) => (0..count).step_by(keep).collect(),
        // Every slice of grey values says something, an empty one too.
        (None, None) => (0..count).filter(|&k| painted[k] || survey.greys.is_some()).collect(),
    };
    if !chosen.iter().any(|&k| painted[k]) {
        if let Some(cut) = options.cut() {
            let (count, side) = (chosen.len(), cut.side());
            let message = format!("none of the {count} chosen slices has a value {side} the level {}", cut.level);
            return Err(Error::Format { path: volume.path.clone(), message });
        }
        let all = options.slices.is_none() && options.keep.is_none();
        let missing = match label {
            Some(label) if all => format!("has no label {label}"),
            None if all => "has no label".into(),
            Some(label) => format!("none of the {} chosen slices has label {label}", chosen.len()),
            None => format!("none of the {} chosen slices has a label", chosen.len()),
        };
        let message = match survey.labels.len() {
            0 => format!("{missing}: all voxels are 0"),
            _ => format!("{missing}; labels are {}", listed(survey.labels.keys())),
        };
        return Err(Error::Format { path: volume.path.clone(), message });
    }
    Ok(chosen)
}

/// Labels for a message.
pub(crate) fn listed<'l>(labels: impl ExactSizeIterator<Item = &'l i64>) -> String {
    let more = if labels.len() > NAMED { ", ..." } else { "" };
    labels.take(NAMED).map(i64::to_string).collect::<Vec<_>>().join(", ") + more
}

/// Masks of the slices `chosen` across the axis `w`, row-major along `u` and `v`.
fn masks(volume: &Volume, chosen: &[usize], [u, v, w]: [usize; 3], label: Option<i64>) -> Result<Vec<SliceContent>> {
    let dims = volume.grid.dims;
    let [nx, ny] = [dims[u], dims[v]];
    // Masks are runs; one at a time is read as pixels.
    room::check_room(nx as f64 * ny as f64).map_err(|m| {
        let message = format!("the pixels of a slice, {nx}x{ny}, {m}");
        Error::Format { path: volume.path.clone(), message }
    })?;
    let places = places(chosen, dims[w]);
    let mut masks = vec![MaskBits::new(dims[u] * dims[v]); chosen.len()];
    volume.labels(|run| {
        let node = run.first[u] + run.first[v] * dims[u];
        if run.along == w {
            let slices = places[run.first[w]..].iter().zip(run.values);
            for (place, _) in slices.filter(|(_, value)| wanted(label, **value)) {
                if let Some(place) = *place {
                    masks[place].set(node, true);
                }
            }
        } else if let Some(place) = places[run.first[w]] {
            let step = if run.along == u { 1 } else { dims[u] };
            for (pixel, value) in (node..).step_by(step).zip(run.values) {
                masks[place].set(pixel, wanted(label, *value));
            }
        }
    })?;
    Ok(masks.into_iter().map(|mask| SliceContent::Mask(mask.finish())).collect())
}

/// Level sets of the slices `chosen` across the axis `w`, row-major along `u` and `v`.
fn levels(volume: &Volume, chosen: &[usize], [u, v, w]: [usize; 3], cut: Cut) -> Result<Vec<SliceContent>> {
    let dims = volume.grid.dims;
    let [nx, ny] = [dims[u], dims[v]];
    // Across the axis that the file stores last one slice is read after the other, across others all at the same time.
    let count = if w == volume.stored[2] { 1 } else { chosen.len() };
    room::check_room(size_of::<f32>() as f64 * nx as f64 * ny as f64 * count as f64).map_err(|m| {
        let message = format!("the grey values of {count} slices of {nx}x{ny} px {m}");
        Error::Format { path: volume.path.clone(), message }
    })?;
    let places = places(chosen, dims[w]);
    let mut levels: Vec<Option<LevelSlice>> = vec![None; chosen.len()];
    let mut read: Vec<(Vec<f32>, usize)> = vec![(Vec::new(), 0); chosen.len()];
    volume.greys(|run| {
        let mut at = run.first;
        for value in run.values {
            if let Some(place) = places[at[w]] {
                let (values, known) = &mut read[place];
                if *known == 0 {
                    values.resize(nx * ny, 0.0);
                }
                values[at[u] + at[v] * nx] = cut.depth(*value);
                *known += 1;
                if *known == nx * ny {
                    levels[place] = Some(LevelSlice::new(values, nx));
                    *values = Vec::new();
                }
            }
            at[run.along] += 1;
        }
    })?;
    // Every reader gives all voxels or says what is missing.
    Ok(levels.into_iter().map(|level| SliceContent::Level(level.unwrap_or_default())).collect())
}

/// For each slice across an axis its place among the chosen ones.
fn places(chosen: &[usize], slices: usize) -> Vec<Option<usize>> {
    let mut places = vec![None; slices];
    chosen.iter().enumerate().for_each(|(place, &k)| places[k] = Some(place));
    places
}
