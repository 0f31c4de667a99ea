//! A run of the program from a checked stack to its files, and what it tells on the way.

use interslice::files::Loaded;
use interslice::files::outputs::Outputs;
use interslice::surface::stream::LayerSink;
use interslice::{Budget, Error, Means, Progress, Reconstruction, Result};

use super::bar::Bars;
use super::devices::{ChosenDevice, DeviceOptions, choose};
use super::forecast::forecast;
use super::say::say;

/// Amount that a run tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telling {
    /// Errors only.
    Quiet,
    /// What would be done, on stdout; and nothing is done.
    DryRun,
    /// The backend, warnings, what was written.
    Normal,
    /// Everything that is told.
    Verbose,
}

pub fn set_threads(threads: Option<usize>) -> Result<()> {
    let Some(n) = threads else { return Ok(()) };
    let fail = |message: String| Err(Error::Setting { name: "threads".into(), message });
    if !(1..=1024).contains(&n) {
        return fail(format!("must lie in [1, 1024]; got {n}"));
    }
    rayon::ThreadPoolBuilder::new().num_threads(n).build_global().or_else(|e| fail(e.to_string()))
}

/// One reconstruction, from a checked stack to its files.
pub fn reconstruct(loaded: &Loaded, mut outputs: Outputs, device: &DeviceOptions, telling: Telling) -> Result<()> {
    let stack = &loaded.stack;
    let writing =
        outputs.bytes(stack.dims, &stack.geometry, stack.lid()) + loaded.needs_to_simplify(outputs.has_mesh());
    let mut chosen = chosen(device)?;
    let budget = chosen.budget(&loaded.needs(), writing, device.memory())?;
    tell_start(&chosen, &budget, telling);
    tell_notes(loaded, telling);
    #[cfg(feature = "dicom")]
    if outputs.has_structures() {
        tell_nothing_added(loaded, telling)?;
    }
    if telling == Telling::DryRun {
        return say(&forecast(loaded, &outputs, chosen.beside(writing))?);
    }
    let mut body = compute(loaded, &mut outputs.sink(&loaded.options.output), &chosen, &budget, telling)?;
    complete(&mut outputs, &mut body, loaded, telling)?;
    chosen.tell(&body.report.profile);
    let written = outputs.rename()?;
    if telling != Telling::Quiet {
        written.iter().for_each(|path| tell!("wrote {}", path.display()));
    }
    Ok(())
}

/// The machine that the options choose.
pub fn chosen(device: &DeviceOptions) -> Result<ChosenDevice<'_>> {
    choose(device, &|message: &str| tell!("warning: {message}"))
}

/// Tells where a run computes, and what does not stay in memory.
pub fn tell_start(chosen: &ChosenDevice<'_>, budget: &Budget, telling: Telling) {
    if telling != Telling::Quiet {
        tell!("running on: {} ({})", chosen.backend().name(), chosen.reason);
        tell_kept(budget);
    }
}

/// The body, its layers given to `sink`.
pub fn compute(
    loaded: &Loaded,
    sink: &mut dyn LayerSink,
    chosen: &ChosenDevice<'_>,
    budget: &Budget,
    telling: Telling,
) -> Result<Reconstruction> {
    let bars = Bars::default();
    let progress: &dyn Progress = if telling == Telling::Quiet { &interslice::progress::Silent } else { &bars };
    let means = Means { backend: chosen.backend(), progress, budget };
    let mut body = loaded.compute_into(&means, sink)?;
    body.report.backend_reason = Some(chosen.reason.clone());
    chosen.complete(&mut body.report.profile);
    Ok(body)
}

/// Tells what a person should know of the input, before the work.
pub fn tell_notes(loaded: &Loaded, telling: Telling) {
    if telling != Telling::Quiet {
        loaded.notes.iter().for_each(|note| tell!("warning: {note}"));
    }
}

/// Tells that the completed RTSTRUCT gets no contours, and why, where that is so.
#[cfg(feature = "dicom")]
pub fn tell_nothing_added(loaded: &Loaded, telling: Telling) -> Result<()> {
    let nothing = loaded.adds_nothing()?.filter(|_| telling != Telling::Quiet);
    nothing.iter().for_each(|why| tell!("warning: {why}"));
    Ok(())
}

/// Completes the files, which keep their temporary names, when the body is; what was said of the input is not said again.
pub fn complete(outputs: &mut Outputs, body: &mut Reconstruction, loaded: &Loaded, telling: Telling) -> Result<()> {
    if outputs.has_report() {
        body.report.provenance = loaded.provenance()?;
    }
    outputs.complete(&mut body.report)?;
    if telling != Telling::Quiet {
        let warnings = body.report.warnings.iter().filter(|w| !loaded.notes.contains(w));
        warnings.for_each(|w| tell!("warning: {w}"));
        body.report.broken.iter().for_each(|b| tell!("warning: does not hold: {b}"));
    }
    if telling == Telling::Verbose {
        tell(body);
    }
    Ok(())
}

/// Tells where the data is that does not fit into memory.
pub fn tell_kept(budget: &Budget) {
    if let Some(kept) = budget.kept() {
        let folder = std::env::temp_dir();
        tell!("beyond {} MiB the slices are kept in a temporary file in {}", kept >> 20, folder.display());
    }
}

/// Stages and contours, for people.
fn tell(body: &Reconstruction) {
    for stage in &body.report.stages {
        tell!("{:>10} {:8.3} s", stage.name, stage.seconds);
    }
    let step = |b: Option<interslice::report::StepBeside>| b.map_or("-".into(), |b| format!("{:.4} px", b.jump));
    for c in &body.report.contours {
        let residual =
            |r: Option<interslice::report::Residual>| r.map_or("      -".into(), |r| format!("{:.3} px", r.max));
        tell!(
            "{} at {}: {} parts, {} holes, {} of {} px differ, step below {}, above {}, arrival from below {}, from above {}",
            c.name,
            c.z,
            c.components,
            c.holes,
            c.differing_pixels,
            c.pixels,
            step(c.below),
            step(c.above),
            residual(c.arrival_from_below),
            residual(c.arrival_from_above)
        );
    }
    let whole = &body.report.body;
    tell!(
        "{} pieces and {} voids touch no contour; {} of {} pairs of overlapping parts are not connected",
        whole.floating,
        whole.voids,
        whole.torn.len(),
        whole.overlapping
    );
    if let (Some(volume), Some(area)) = (body.report.volume, body.report.area) {
        tell!("volume {volume:.6} {0}^3, area {area:.6} {0}^2", body.unit);
    }
}
