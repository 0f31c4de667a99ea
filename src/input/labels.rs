//! Reads the drawn slices of many labels from a label volume.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::input::volume::slices::listed;
use crate::input::volume::{Overlaps, Volume, VoxelRun};
pub use crate::input::wanted::Wanted;
use crate::input::{Input, Surveyed};
use crate::labels::Covered;
use crate::labels::given::{Completeness, Given, completed, notes, reading};
use crate::labels::report::LeftOut;
use crate::labels::{LabelStack, SingleSlice};
use crate::stack::ReadOptions;
use crate::stack::doubts;
use crate::stack::doubts::SliceArea;
use crate::stack::unresolved::Unresolved;
use crate::stack::{ContourStack, Slice};
use crate::storage::room;

/// Most labels of a run.
const MOST: usize = 4096;
/// Most labels of which a doubt is said one by one.
const MOST_TOLD: usize = 8;

/// Reads the slices on which any of the wanted labels is drawn, or those that the options choose, from bottom to top. Of all labels those
/// that cannot be reconstructed are left out.
///
/// # Errors
/// The errors of [`Input::read`]; [`Error::Setting`] for slices of a `stack.json`; [`Error::Format`] for labels that are not in the volume, for one that is
/// named and drawn on a single slice, and where no label is left.
pub fn read_labels(path: &Path, options: &ReadOptions, wanted: &Wanted) -> Result<LabelStack> {
    labels_of(path, options, wanted, false, |options| Input::of_labels(path, options))
}

/// The same with every label whole, also where it lies under another.
///
/// # Errors
/// The errors of [`read_labels`].
pub fn read_whole_labels(path: &Path, options: &ReadOptions, wanted: &Wanted) -> Result<LabelStack> {
    labels_of(path, options, wanted, true, |options| Input::of_labels(path, options))
}

/// The same for a volume whose header was read.
///
/// # Errors
/// The errors of [`read_labels`].
pub fn labels_of_volume(volume: Volume, options: &ReadOptions, wanted: &Wanted) -> Result<LabelStack> {
    labels_of(&volume.path.clone(), options, wanted, false, |options| Input::of_volume(volume, options))
}

fn labels_of(
    path: &Path,
    options: &ReadOptions,
    wanted: &Wanted,
    whole: bool,
    read: impl FnOnce(&ReadOptions) -> Result<Input>,
) -> Result<LabelStack> {
    let fail = |message: String| Err(Error::Setting { name: "labels".into(), message });
    if options.label.is_some() {
        return fail("is not for a run with `label`".into());
    }
    if options.level.is_some() {
        return fail("is not for grey values, which `level` cuts".into());
    }
    let Input { stack, surveyed, notes: mut said, .. } =
        read(&ReadOptions { complete_slices: false, ..options.clone() })?;
    let Some(mut surveyed) = surveyed else {
        return fail("chooses from a label volume".into());
    };
    let of_all = surveyed.volume.overlaps()?;
    let there: BTreeSet<i64> = surveyed.survey.labels.keys().chain(of_all.segments.keys()).copied().collect();
    let mut labels: Vec<i64> = match wanted {
        Wanted::All => there.iter().copied().collect(),
        some => some.labels(&surveyed.volume)?,
    };
    if let Some(missing) = labels.iter().find(|l| !there.contains(l)) {
        let message = format!("has no label {missing}; labels are {}", listed(there.iter()));
        return Err(Error::Format { path: path.into(), message });
    }
    if surveyed.survey.more || labels.len() > MOST {
        return fail(format!("are at most {MOST} in a run; name those you want"));
    }
    surveyed.volume.take_only(&labels);
    let overlaps = if *wanted == Wanted::All { of_all } else { surveyed.volume.overlaps()? };
    let mut left_out = if whole { Vec::new() } else { without_hidden(&mut labels, &surveyed, &overlaps) };
    if let Some(hidden) = left_out.first().filter(|_| *wanted != Wanted::All) {
        return fail(format!("cannot have {}: {}", hidden.of(), hidden.why));
    }
    if *wanted == Wanted::All {
        let empty = surveyed.volume.segments.iter().filter(|(label, _)| **label != 0 && !there.contains(label));
        let why = || "nothing is painted".to_string();
        left_out.extend(empty.map(|(label, a)| LeftOut { label: *label, name: a.name.clone(), why: why() }));
    }
    let mut drawn = drawn(&surveyed, &stack, &labels, |each| surveyed.volume.labels(each))?;
    let mut covered = vec![Vec::new(); drawn.len()];
    if whole {
        add_covered(&surveyed, &stack, (&labels, &overlaps), &drawn, &mut covered)?;
    }
    let mut slices = stack.slices;
    let chosen = options.keep.is_some() || options.slices.is_some();
    let completeness = if chosen || options.complete_slices { Completeness::Complete } else { Completeness::Own };
    if !chosen {
        let has: Vec<bool> = drawn.iter().map(|slice| slice.iter().any(|l| *l > 0)).collect();
        let mut of_slices = has.iter();
        slices.retain(|_| of_slices.next() == Some(&true));
        let mut of_covered = has.iter();
        covered.retain(|_| of_covered.next() == Some(&true));
        let mut of_drawn = has.iter();
        drawn.retain(|_| of_drawn.next() == Some(&true));
    }
    let given = given((&drawn, &covered), &slices, surveyed.thickness(), labels.len(), completeness);
    for (slice, drawn) in slices.iter_mut().zip(&drawn) {
        slice.content = crate::stack::SliceContent::Mask(drawn.iter().map(|l| *l > 0).collect());
    }
    let singles = match *wanted == Wanted::All && !whole {
        true => on_one_slice(&labels, &given, &drawn, &surveyed),
        false => Vec::new(),
    };
    if !whole {
        said.extend(overlapping(&overlaps));
    }
    said.extend(options.keep.and_then(|keep| surveyed.missed(keep)));
    let mut labels = LabelStack {
        stack: ContourStack { slices, ..stack },
        appearances: labels.iter().map(|label| surveyed.volume.appearance(*label)).collect(),
        labels,
        scalar: surveyed.volume.element.scalar(),
        drawn,
        covered,
        given,
        singles,
        left_out,
        reading: None,
        notes: said,
    };
    if *wanted == Wanted::All {
        labels.leave_out(|labels, a| labels.given[a].too_few());
        labels.some_are_left().map_err(|message| Error::Format { path: path.into(), message })?;
    }
    labels.notes.extend(strays(&labels.labels, &labels.stack.slices, &labels.drawn));
    labels.notes.extend(slips(&labels, completeness));
    labels.notes.extend(unresolved(&labels.labels, &labels.stack, &labels.drawn));
    labels.notes.extend(notes(&labels.labels, &labels.given));
    labels.reading = reading(&labels.labels, &labels.given);
    labels.validate().map_err(|e| e.in_file(path))?;
    Ok(labels)
}

/// Takes those away that lie wholly in segments that come after them.
fn without_hidden(labels: &mut Vec<i64>, surveyed: &Surveyed, overlaps: &Overlaps) -> Vec<LeftOut> {
    let hidden = |label: &i64| {
        let voxels = overlaps.hidden(*label)?;
        let why = format!(
            "all of its {voxels} voxels are in segments that come after it, which have them here; `--label {label}` takes it whole"
        );
        Some(LeftOut { label: *label, name: surveyed.volume.appearance(*label).name, why })
    };
    let left_out = labels.iter().filter_map(hidden).collect();
    labels.retain(|label| overlaps.hidden(*label).is_none());
    left_out
}

/// Note on segments that overlap.
fn overlapping(overlaps: &Overlaps) -> Option<String> {
    let voxels = overlaps.voxels;
    (voxels > 0).then(|| {
        format!("{voxels} voxels are in several segments; the last of these has them here, `--label NAME` takes a segment whole")
    })
}

/// The slices of each label.
fn given(
    (drawn, covered): (&[Vec<u32>], &[Covered]),
    slices: &[Slice],
    thickness: f64,
    count: usize,
    of: Completeness,
) -> Vec<Given> {
    let mut painted = vec![vec![false; slices.len()]; count];
    for (k, slice) in drawn.iter().enumerate() {
        let stretches = slice.chunk_by(|a, b| a == b).map(|stretch| stretch[0] as usize);
        stretches.filter(|l| *l > 0).for_each(|l| painted[l - 1][k] = true);
        covered[k].iter().for_each(|(a, _)| painted[*a][k] = true);
    }
    let numbers: Vec<usize> = slices.iter().map(|slice| (slice.z / thickness).round() as usize).collect();
    let given = painted.iter().map(|painted| Given::new(painted, &numbers, of)).collect();
    let z = || slices.iter().map(|slice| slice.z).collect::<Vec<_>>();
    if of == Completeness::Own { completed(given, &z()) } else { given }
}

/// Notes for a person on slices of labels that look painted by mistake.
fn strays(labels: &[i64], slices: &[Slice], drawn: &[Vec<u32>]) -> Vec<String> {
    let mut sections: Vec<Vec<SliceArea>> =
        labels.iter().map(|_| slices.iter().map(|s| SliceArea { z: s.z, area: 0 }).collect()).collect();
    for (k, slice) in drawn.iter().enumerate() {
        slice.iter().filter(|l| **l > 0).for_each(|l| sections[*l as usize - 1][k].area += 1);
    }
    let of = |(a, (label, sections)): (usize, (&i64, &Vec<SliceArea>))| {
        let own = a as u32 + 1;
        let overlap = |k: usize, beside: usize| drawn[k].iter().zip(&drawn[beside]).any(|(l, m)| *l == own && l == m);
        let name = |k: usize| format!("slice `{}`", slices[k].name);
        Some(format!("label {label}: {}", doubts::stray(&doubts::strays(sections, overlap), sections, name)?))
    };
    few(labels.iter().zip(&sections).enumerate().filter_map(of).collect(), "have slices with hardly any pixels")
}

/// Notes for a person on what slices of labels lack or have by mistake.
fn slips(labels: &LabelStack, completeness: Completeness) -> Vec<String> {
    let of = |(a, label): (usize, &i64)| -> Vec<String> {
        let own = labels.alone(a);
        let holes = !labels.given[a].holes.is_empty();
        let undrawn = holes.then(|| own.undrawn()).flatten();
        // Unpainted slices between others that are painted one by one are told by themselves.
        let empty = (completeness == Completeness::Own).then(|| own.empty()).flatten();
        let slips = empty.into_iter().chain(own.slips()).filter(|slip| Some(slip) != undrawn.as_ref());
        slips.map(|slip| format!("label {label}: {slip}")).collect()
    };
    let mut all: Vec<Vec<String>> = labels.labels.par_iter().enumerate().map(of).collect();
    all.retain(|slips| !slips.is_empty());
    let more = all.len().saturating_sub(MOST_TOLD);
    all.truncate(MOST_TOLD);
    let more = (more > 0).then(|| format!("{more} more labels have slices that look painted by mistake"));
    all.into_iter().flatten().chain(more).collect()
}

/// Notes for a person on labels much of which pixels do not resolve.
fn unresolved(labels: &[i64], stack: &ContourStack, drawn: &[Vec<u32>]) -> Vec<String> {
    let nx = stack.dims[0].max(1);
    let mut seen = vec![Unresolved::default(); labels.len()];
    for (k, slice) in drawn.iter().enumerate() {
        let mut runs: BTreeMap<usize, Vec<Range<usize>>> = BTreeMap::new();
        for (row, pixels) in slice.chunks(nx).enumerate() {
            let mut first = row * nx;
            for stretch in pixels.chunk_by(|a, b| a == b) {
                let run = first..first + stretch.len();
                first = run.end;
                if let Some(a) = (stretch[0] as usize).checked_sub(1) {
                    runs.entry(a).or_default().push(run);
                }
            }
        }
        runs.iter().for_each(|(a, runs)| seen[*a].see(k, runs, nx));
    }
    let name = |k: usize| format!("slice `{}`", stack.slices[k].name);
    let said = labels.iter().zip(seen).filter_map(|(l, seen)| Some(format!("label {l}: {}", seen.told(name)?)));
    few(said.collect(), "have many parts of so few pixels")
}

/// The first of notes that are each of a label, and how many more labels `have` the same.
fn few(mut said: Vec<String>, have: &str) -> Vec<String> {
    let more = said.len().saturating_sub(MOST_TOLD);
    said.truncate(MOST_TOLD);
    said.extend((more > 0).then(|| format!("{more} more labels {have}")));
    said
}

/// Labels that are painted on one slice, which all their slices are.
fn on_one_slice(labels: &[i64], given: &[Given], drawn: &[Vec<u32>], surveyed: &Surveyed) -> Vec<SingleSlice> {
    let of = |(a, (label, given)): (usize, (&i64, &Given))| {
        let [slice] = given.slices[..] else { return None };
        let pixels = (0..drawn[slice].len()).filter(|n| drawn[slice][*n] == a as u32 + 1).collect();
        Some(SingleSlice { label: *label, appearance: surveyed.volume.appearance(*label), slice, pixels })
    };
    labels.iter().zip(given).enumerate().filter_map(of).collect()
}

/// Adds, slice by slice, the pixels that labels have where others are drawn.
fn add_covered(
    surveyed: &Surveyed,
    stack: &ContourStack,
    (labels, overlaps): (&[i64], &Overlaps),
    all: &[Vec<u32>],
    covered: &mut [Covered],
) -> Result<()> {
    let under = labels.iter().filter(|label| overlaps.is_covered(**label));
    let layers: BTreeSet<usize> = under.filter_map(|label| surveyed.volume.layer_of(*label)).collect();
    for layer in layers {
        let own = drawn(surveyed, stack, labels, |each| surveyed.volume.labels_of_layer(layer, each))?;
        for ((own, all), covered) in own.iter().zip(all).zip(&mut *covered) {
            let under = |n: usize| if own[n] == all[n] { 0 } else { own[n] as usize };
            let mut first = 0;
            while first < own.len() {
                let label = under(first);
                let end = (first..own.len()).find(|n| under(*n) != label).unwrap_or(own.len());
                covered.extend((label > 0).then(|| (label - 1, first..end)));
                first = end;
            }
        }
    }
    Ok(())
}

/// For each slice and pixel 0, or the place of its label and 1, of the labels that are read.
fn drawn(
    surveyed: &Surveyed,
    stack: &ContourStack,
    labels: &[i64],
    read: impl FnOnce(&mut dyn FnMut(VoxelRun<'_>)) -> Result<()>,
) -> Result<Vec<Vec<u32>>> {
    let [u, v, w] = stack.geometry.order;
    let (dims, thickness) = (surveyed.volume.grid.dims, surveyed.thickness());
    let mut places = vec![None; dims[w]];
    for (place, slice) in stack.slices.iter().enumerate() {
        if let Some(at) = places.get_mut((slice.z / thickness).round() as usize) {
            *at = Some(place);
        }
    }
    let ([nx, ny], count) = (stack.dims, stack.slices.len());
    room::check_room(size_of::<u32>() as f64 * nx as f64 * ny as f64 * count as f64).map_err(|m| {
        let message = format!("the labels of {count} slices of {nx}x{ny} px {m}");
        Error::Format { path: surveyed.volume.path.clone(), message }
    })?;
    let number = |value: i64| labels.binary_search(&value).map_or(0, |k| k as u32 + 1);
    let mut drawn = vec![vec![0; dims[u] * dims[v]]; stack.slices.len()];
    read(&mut |run| {
        let mut at = run.first;
        for stretch in run.values.chunk_by(|a, b| a == b) {
            let number = number(stretch[0]);
            for _ in stretch {
                if let (1.., Some(place)) = (number, places[at[w]]) {
                    drawn[place][at[u] + at[v] * dims[u]] = number;
                }
                at[run.along] += 1;
            }
        }
    })?;
    Ok(drawn)
}
