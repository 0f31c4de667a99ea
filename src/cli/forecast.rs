//! What a run would read, make, write and need, in words: for `inspect` and for `reconstruct --dry-run`.

use std::path::Path;

use interslice::estimate::memory::{MemoryNeeds, triangles};
use interslice::estimate::runtime::Effort;
use interslice::files::Loaded;
use interslice::files::format::{Kind, kind};
use interslice::files::labels::{LabelOutputs, LoadedLabels};
use interslice::files::outputs::Outputs;
use interslice::labels::LabelStack;
use interslice::stack::SliceContent;
use interslice::{ContourStack, Result};

use super::say::{length, short};

/// What is drawn, and how high.
pub fn shape(stack: &ContourStack) -> Vec<String> {
    let unit = &stack.unit;
    let (first, last) = (&stack.slices[0], &stack.slices[stack.slices.len() - 1]);
    let extra = stack.slices.iter().filter(|s| s.extra).count();
    let kind = match first.content {
        SliceContent::Mask(_) => "masks",
        SliceContent::Level(_) => "sub-pixel contours",
    };
    let drawn = format!(
        "{} slices ({kind}{}), {} x {} px of {} x {} {unit}",
        stack.slices.len(),
        if extra > 0 { format!(", {extra} of them extra contours") } else { String::new() },
        stack.dims[0],
        stack.dims[1],
        length(stack.spacing[0]),
        length(stack.spacing[1])
    );
    let gaps = stack.slices.windows(2).map(|w| w[1].z - w[0].z);
    let (low, high) = gaps.fold((f64::INFINITY, 0.0f64), |(a, b), g| (a.min(g), b.max(g)));
    let spread = if high - low <= 1e-6 * high {
        format!("{} apart", length(low))
    } else {
        format!("{} to {} apart", length(low), length(high))
    };
    vec![drawn, format!("heights {} to {} {unit}, {spread}", short(first.z), short(last.z))]
}

/// Memory, disk and time of a run.
pub fn requirements(effort: &Effort, needs: &MemoryNeeds) -> String {
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let instead = match needs.least < needs.all {
        true => format!(" (or {} MiB, and {} MiB of disk for temporary files)", mib(needs.least), mib(needs.disk)),
        false => String::new(),
    };
    let threads = rayon::current_num_threads();
    let cores = if threads == 1 { "one core".into() } else { format!("{threads} cores") };
    let seconds = rough(effort.seconds(threads));
    format!("about {} MiB of memory{instead} and, on {cores} of this CPU, {seconds}", mib(needs.all))
}

/// A run with one body, before it is made, that needs so many bytes of memory beside the reconstruction.
///
/// # Errors
/// The errors of [`Loaded::voxels`].
pub fn forecast(loaded: &Loaded, outputs: &Outputs, beside: u64) -> Result<String> {
    let stack = &loaded.stack;
    let mut lines = read_and_made(stack, &loaded.heights);
    let [nx, ny, nz] = loaded.voxels()?;
    lines.extend(outputs.targets().map(|target| match kind(target) {
        Ok(Kind::Volume) => format!("{}, {nx} x {ny} x {nz} voxels", would_write(target)),
        Ok(Kind::Mesh) => {
            format!("{}, at most {} triangles", would_write(target), triangles(stack, &loaded.heights))
        }
        _ => would_write(target),
    }));
    let effort = Effort::of(stack, &loaded.heights);
    let simplifying = loaded.options.output.simplify.is_some() && outputs.has_mesh();
    let more = if simplifying { ", and what `simplify` takes, which may be several times as long" } else { "" };
    lines.push(format!("would need: {}{more}", requirements(&effort, &loaded.needs().beside(beside))));
    lines.push(String::new());
    Ok(lines.join("\n"))
}

/// A run with many labels, before it is made, that needs so many bytes of memory beside the reconstructions.
pub fn forecast_labels(loaded: &LoadedLabels, outputs: &LabelOutputs, beside: u64) -> String {
    let LabelStack { stack, labels, appearances, given, .. } = &loaded.stack;
    let mut lines = read_and_made(stack, loaded.heights());
    for ((label, appearance), given) in labels.iter().zip(appearances).zip(given) {
        let name = appearance.name.as_ref().map_or(String::new(), |name| format!(" ({name})"));
        lines.push(format!("would make: label {label}{name}, of {} slices", given.slices.len()));
    }
    lines.extend(outputs.targets().map(would_write));
    let (needs, effort) = loaded.requirements();
    lines.push(format!("would need: {}", requirements(&effort, &needs.beside(beside))));
    lines.push(String::new());
    lines.join("\n")
}

/// What is read, and the layers that are made.
fn read_and_made(stack: &ContourStack, heights: &[f64]) -> Vec<String> {
    let mut lines: Vec<String> = shape(stack).into_iter().map(|line| format!("would read: {line}")).collect();
    if let [first, .., last] = heights {
        let (count, unit) = (heights.len(), &stack.unit);
        lines.push(format!("would make: {count} layers, {} to {} {unit}", short(*first), short(*last)));
    }
    lines
}

/// An output, before it is written.
pub fn would_write(target: &Path) -> String {
    let instead = if target.exists() { " in place of the one that is there" } else { "" };
    format!("would write: {}{instead}", target.display())
}

/// A time that is known roughly, in words.
fn rough(seconds: f64) -> String {
    match seconds {
        ..1.0 => "less than a second".into(),
        ..100.0 => format!("about {seconds:.0} s"),
        ..6000.0 => format!("about {:.0} min", seconds / 60.0),
        _ => format!("about {:.1} h", seconds / 3600.0),
    }
}
