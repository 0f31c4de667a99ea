//! Words of `inspect` about a label volume.

use std::collections::BTreeMap;

use glam::DVec3;
use interslice::input::Surveyed;
use interslice::input::volume::Volume;
use interslice::input::volume::survey::Survey;
use interslice::stack::axis::NAMES;

use super::say::{length, short};

/// Labels and stretches of slices that are listed one by one.
const LISTED: usize = 24;

/// File and type, spacing and orientation, labels, the axis and why, painted slices and gaps.
pub fn describe(surveyed: &Surveyed) -> Vec<String> {
    let Surveyed { volume, survey, axis, .. } = surveyed;
    let grid = &volume.grid;
    let by = |v: [String; 3]| v.join(" x ");
    let name = volume.path.file_name().unwrap_or_default().to_string_lossy();
    let assumed = if grid.is_assumed() { " (not in the file; `--spacing` says it)" } else { "" };
    let mut lines = vec![
        format!(
            "{name}: {}, {} voxels of type {}",
            volume.format,
            by(grid.dims.map(|n| n.to_string())),
            volume.element.name()
        ),
        format!("voxels of {} {}{assumed}", by(grid.spacing().map(length)), grid.unit),
        orientation(volume),
    ];
    lines.push(
        survey.greys.map_or_else(|| labels(volume, survey), |[low, high]| format!("grey values from {low} to {high}")),
    );
    lines.push(format!("slices lie along {} ({})", NAMES[axis.axis], axis.why));
    lines.push(painted(&survey.painted[axis.axis]));
    lines
}

/// Labels and how many voxels have them, the most first.
fn labels(volume: &Volume, survey: &Survey) -> String {
    let mut labels: Vec<(i64, u64)> = survey.labels.iter().map(|(label, n)| (*label, *n)).collect();
    labels.sort_by_key(|(label, n)| (std::cmp::Reverse(*n), *label));
    let rest = labels.len().saturating_sub(LISTED);
    labels.truncate(LISTED);
    let named = |label| volume.appearance(label).name.map_or(String::new(), |name| format!(" `{name}`"));
    let listed: Vec<String> =
        labels.iter().map(|(label, n)| format!("{label}{} ({n} voxels)", named(*label))).collect();
    let more = match (survey.more, rest) {
        (true, _) => " and many more".into(),
        (_, 0) => String::new(),
        (_, n) => format!(" and {n} more"),
    };
    format!("labels: {}{more}", listed.join(", "))
}

/// Directions of the axes: the nearest directions of the body, and how far off they are.
fn orientation(volume: &Volume) -> String {
    if volume.grid.origin == DVec3::ZERO && !volume.grid.spaced {
        return "axes x, y, z as in the file, no place in the world".into();
    }
    let ends = [["right", "left"], ["front", "back"], ["bottom", "top"]];
    let mut off = 0.0f64;
    let words: Vec<String> = volume
        .grid
        .axes()
        .iter()
        .zip(NAMES)
        .map(|(v, name)| {
            let k = (0..3).max_by(|&a, &b| v[a].abs().total_cmp(&v[b].abs())).unwrap_or(0);
            off = off.max(v[k].abs().min(1.0).acos().to_degrees());
            format!("{name} to the {}", ends[k][usize::from(v[k] > 0.0)])
        })
        .collect();
    let oblique = if off > 0.05 { format!(", oblique by up to {off:.1} degrees") } else { String::new() };
    let [x, y, z] = volume.grid.origin.to_array().map(short);
    format!("axes: {}{oblique}; first voxel at ({x}, {y}, {z}) LPS", words.join(", "))
}

/// Painted slices as ranges, and how many lie empty between them.
fn painted(painted: &[bool]) -> String {
    let (mut ranges, mut gaps, mut at) = (Vec::new(), BTreeMap::new(), 0);
    let count = painted.iter().filter(|p| **p).count();
    for stretch in painted.chunk_by(|a, b| a == b) {
        let (first, last) = (at, at + stretch.len() - 1);
        at += stretch.len();
        match (stretch[0], first == last) {
            (true, true) => ranges.push(first.to_string()),
            (true, false) => ranges.push(format!("{first}-{last}")),
            (false, _) if first > 0 && at < painted.len() => *gaps.entry(stretch.len()).or_insert(0usize) += 1,
            _ => {}
        }
    }
    let more =
        if ranges.len() > LISTED { format!(" and {} more stretches", ranges.len() - LISTED) } else { String::new() };
    ranges.truncate(LISTED);
    let gaps: Vec<String> = gaps
        .iter()
        .map(|(length, times)| {
            format!("{length}{}", if *times > 1 { format!(" ({times} times)") } else { String::new() })
        })
        .collect();
    let between =
        if gaps.is_empty() { "no gaps".into() } else { format!("empty slices between them: {}", gaps.join(", ")) };
    format!("painted: {count} of {} slices: {}{more}; {between}", painted.len(), ranges.join(", "))
}
