//! `interslice reconstruct --labels`.

use std::path::{Path, PathBuf};

use interslice::files::JobOptions;
use interslice::files::labels::{LabelOutputs, LoadedLabels};
use interslice::files::places::Places;
use interslice::input::labels::Wanted;
use interslice::{Budget, Means, Progress, Result};

use super::bar::Bars;
use super::devices::{DeviceOptions, choose};
use super::forecast::forecast_labels;
use super::inspect::counted;
use super::say::say;
use super::session::Telling;

/// Request of a run with many labels.
pub struct Asked<'a> {
    pub input: &'a Path,
    pub wanted: &'a Wanted,
    pub keep_overlaps: bool,
    pub outputs: &'a [PathBuf],
    pub report: Option<&'a Path>,
}

/// Many labels, from a label volume to their files.
pub fn reconstruct(asked: &Asked<'_>, options: JobOptions, device: &DeviceOptions, telling: Telling) -> Result<()> {
    let mut places = Places::of(asked.input, &options)?;
    let loaded = LoadedLabels::read(asked.input, asked.wanted, asked.keep_overlaps, options)?;
    if telling != Telling::Quiet {
        loaded.stack.left_out.iter().for_each(|label| tell!("{label}"));
        loaded.stack.reading.iter().for_each(|reading| tell!("{reading}"));
        loaded.stack.notes.iter().for_each(|note| tell!("warning: {note}"));
    }
    let mut outputs = LabelOutputs::open(asked.outputs, asked.report, &loaded, &mut places)?;
    let notice = |message: &str| tell!("warning: {message}");
    let chosen = choose(device, &notice)?;
    if telling != Telling::Quiet {
        tell!("running on: {} ({})", chosen.backend().name(), chosen.reason);
    }
    if telling == Telling::DryRun {
        let beside = loaded.beside(&outputs, chosen.backend().host_bytes());
        return say(&forecast_labels(&loaded, &outputs, beside));
    }
    let bars = Bars::default();
    let progress: &dyn Progress = if telling == Telling::Quiet { &interslice::progress::Silent } else { &bars };
    // Every label gets a budget of its own.
    let means = Means { backend: chosen.backend(), progress, budget: &Budget::unlimited() };
    let report = loaded.compute(&means, device.memory(), &mut outputs)?;
    if telling != Telling::Quiet {
        // What the input made one doubt has been said before the work.
        let new = report.warnings.iter().filter(|w| !loaded.stack.notes.contains(w));
        new.for_each(|w| tell!("warning: {w}"));
        for label in &report.labels {
            label.run.warnings.iter().for_each(|w| tell!("warning: label {}: {w}", label.label));
            label.run.broken.iter().for_each(|b| tell!("warning: label {}: does not hold: {b}", label.label));
        }
        if let Some(b) = &report.borders {
            let labels = counted(report.labels.len(), "label");
            match (b.overlap_voxels, b.gap_voxels) {
                (0, 0) => tell!("{labels}: no overlaps and no gaps between them to decide"),
                (overlaps, gaps) => {
                    let changed = b.changed_labels;
                    tell!(
                        "{labels}, {changed} changed by others: {overlaps} voxels of overlaps and {gaps} of gaps decided"
                    );
                }
            }
        }
    }
    chosen.tell_kernels();
    let written = outputs.finish(&report)?;
    if telling != Telling::Quiet {
        written.iter().for_each(|path| tell!("wrote {}", path.display()));
    }
    Ok(())
}
