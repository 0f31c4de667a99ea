//! The GPU that a run gets: asked for by name, the best of this machine, or none, and why.

#[cfg(feature = "gpu")]
use interslice::gpu::adapter::{AdapterSummary, adapters};
#[cfg(feature = "gpu")]
use interslice::gpu::trust::{cache_folder, examined};
#[cfg(feature = "gpu")]
use interslice::gpu::{Gpu, GpuOptions};
use interslice::{Error, Result};

use super::options::{BackendChoice, DeviceOptions};

/// A GPU that was opened.
#[cfg(feature = "gpu")]
pub(super) struct Found {
    pub(super) gpu: Gpu,
    /// The reference path goes on where it fails.
    pub(super) fallback: bool,
}

/// No program without the `gpu` feature finds one.
#[cfg(not(feature = "gpu"))]
pub(super) enum Found {}

/// Opens what the options ask for; nothing is the reference path. Says why.
#[cfg(feature = "gpu")]
pub(super) fn find(options: &DeviceOptions) -> Result<(Option<Found>, String)> {
    match options.backend {
        BackendChoice::Cpu => return Ok((None, "asked for with --backend cpu".into())),
        BackendChoice::Gpu => {
            let gpu = Gpu::open(&options.wanted())?;
            return Ok((Some(Found { gpu, fallback: false }), "asked for with --backend gpu".into()));
        }
        BackendChoice::Auto => {}
    }
    if options.adapter.is_none()
        && let Err(why) = automatic(&adapters())
    {
        return Ok((None, why));
    }
    let reason = if options.adapter.is_some() { "asked for with --adapter" } else { "the best GPU of this machine" };
    match trusted(&options.wanted()) {
        Ok(Ok(gpu)) => Ok((Some(Found { gpu, fallback: true }), reason.into())),
        Ok(Err(why)) => Ok((None, why)),
        Err(Error::Gpu(message) | Error::GpuMemory(message)) => Ok((None, message)),
        Err(e) => Err(e),
    }
}

/// Without the GPU backend there is one choice.
#[cfg(not(feature = "gpu"))]
pub(super) fn find(options: &DeviceOptions) -> Result<(Option<Found>, String)> {
    let without = "this program was built without the `gpu` feature";
    match options.backend {
        BackendChoice::Gpu => Err(Error::Gpu(without.into())),
        BackendChoice::Auto => Ok((None, without.into())),
        BackendChoice::Cpu => Ok((None, "asked for with --backend cpu".into())),
    }
}

/// A GPU whose self-test has agreed, now or in an earlier run, or why it is not trusted.
#[cfg(feature = "gpu")]
fn trusted(options: &GpuOptions) -> Result<std::result::Result<Gpu, String>> {
    let gpu = Gpu::open(options)?;
    let (outcome, now) = examined(cache_folder().as_deref(), &gpu)?;
    if !outcome.wrong.is_empty() {
        return Ok(Err(distrust(&outcome.wrong, &gpu.device.summary)));
    }
    // What the self-test has cost is no part of the run.
    if now { Gpu::open(options).map(Ok) } else { Ok(Ok(gpu)) }
}

/// Why a GPU is not trusted.
#[cfg(feature = "gpu")]
pub(super) fn distrust(wrong: &[String], summary: &AdapterSummary) -> String {
    let AdapterSummary { name, driver, .. } = summary;
    let first = wrong.first().map_or("", String::as_str);
    format!("the self-test of {name} ({driver}) failed: {} stages are wrong, the first is {first}", wrong.len())
}

/// The adapter that `--backend auto` takes, or why it takes none.
#[cfg(feature = "gpu")]
pub(super) fn automatic(found: &[AdapterSummary]) -> std::result::Result<usize, String> {
    if let Some(k) = found.iter().position(|a| a.lacks.is_none() && !a.is_software()) {
        return Ok(k);
    }
    Err(match found.first() {
        None => "there is no GPU driver here".into(),
        Some(a) if a.is_software() => {
            format!("{} computes on the CPU, where the reference path is faster", a.name)
        }
        Some(a) => format!("{}: {}", a.name, a.lacks.as_deref().unwrap_or("cannot be used")),
    })
}
