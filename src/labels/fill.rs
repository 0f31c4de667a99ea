//! Labels between their slices, without files: the label volume goes to a sink.

use std::time::Instant;

use super::report::{LabelReport, LabelsReport};
use super::{LabelStack, Plan, decide, reconstruct};
use crate::backend::Means;
use crate::error::{Error, Result};
use crate::surface::content::Scalar;
use crate::surface::stream::LayerSink;

/// Fills `stack`: its layers at the output heights of `plan` go to `volume`, with the labels' numbers instead of distances.
///
/// # Errors
/// [`Error::Setting`] for numbers that layers cannot hold; the errors of [`reconstruct`], and of deciding between labels.
pub fn fill(
    stack: &LabelStack,
    plan: &Plan<'_>,
    means: &Means<'_>,
    volume: &mut dyn LayerSink,
) -> Result<LabelsReport> {
    let start = Instant::now();
    plan.settings.validate()?;
    let [least, most] = stack.range();
    let limit = Scalar::MOST_LABEL;
    if least < -limit || most > limit {
        let message = format!("must lie within {limit} either side of 0; got {least} to {most}");
        return Err(Error::Setting { name: "labels".into(), message });
    }
    let bodies = reconstruct(stack, true, plan, means)?;
    let decided = decide(stack, bodies, plan, volume)?;
    let mut labels = Vec::new();
    for (a, mut body) in decided.bodies.into_iter().enumerate() {
        if means.progress.stops() {
            return Err(Error::Interrupted);
        }
        let mut run = std::mem::take(&mut body.report);
        body.measure(&mut run)?;
        let differing: usize = run.contours.iter().map(|c| c.differing_pixels).sum();
        let mut report = LabelReport {
            label: stack.labels[a],
            changed: decided.changed[a],
            voxels: Some(decided.voxels[a]),
            differing_pixels: differing as u64 + decided.differing[a],
            volume: run.volume.take(),
            area: run.area.take(),
            areas: run.areas.take(),
            run,
        };
        report.run.warnings.extend(report.overruled());
        labels.push(report);
    }
    Ok(LabelsReport {
        version: env!("CARGO_PKG_VERSION").into(),
        provenance: None,
        backend: means.backend.name(),
        labels,
        left_out: stack.left_out.clone(),
        reading: stack.reading.clone(),
        warnings: stack.notes.clone(),
        borders: Some(decided.borders),
        seconds: start.elapsed().as_secs_f64(),
    })
}
