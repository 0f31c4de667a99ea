//! What is told of inputs and machines: `inspect`, `evaluate`, `links`, `devices`, `doctor`, and the command line itself.

use std::collections::BTreeSet;
use std::ffi::OsString;

use interslice::backend::answers::Remembering;
use interslice::contour::parts::{candidates, overlaps, parts};
use interslice::gpu::adapter::adapters;
use interslice::gpu::selftest::doctor as examiner;
use interslice::gpu::{Gpu, GpuOptions};
use interslice::grid::components::{Components, label4};
use interslice::settings::Link;
use interslice::{Backend, Budget, Error, Means, Settings, evaluate as hold_out};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;

use crate::device::{ask_drivers, machine, noticing};
use crate::errors::wrong;
use crate::running::{pooled, run};
use crate::settings::{PySettings, no_outputs, settings_of};
use crate::stack::PyStack;
use crate::values::report;

/// The words of `interslice inspect`.
#[pyfunction]
pub fn inspect(py: Python<'_>, stack: &Bound<'_, PyStack>) -> PyResult<String> {
    let (loaded, path) = (stack.get().loaded.clone(), stack.get().path.clone());
    let input = stack.get().input.clone();
    run(py, None, move |_| match (path, input) {
        (Some(path), _) => interslice::cli::inspect::words(path, loaded.options.read.clone()),
        (None, Some(input)) => interslice::cli::inspect::of_input(&input, &loaded.options.read),
        (None, None) => interslice::cli::inspect::of_stack(&loaded.stack),
    })
}

/// Leaves slices out, reconstructs them, and says how well they are found.
#[pyfunction]
#[pyo3(signature = (stack, leave=2, progress=None, base=None, preset=None, options=None))]
pub fn evaluate<'py>(
    py: Python<'py>,
    stack: &Bound<'py, PyStack>,
    leave: i64,
    progress: Option<Bound<'py, PyAny>>,
    base: Option<PySettings>,
    preset: Option<&str>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let leave = usize::try_from(leave)
        .map_err(|_| wrong("leave", format!("must be at least 2: 2 leaves out every second slice; got {leave}")))?;
    let (settings, device, output) = settings_of(base, preset, options)?;
    no_outputs(&output, "`evaluate`, which writes nothing")?;
    let loaded = stack.get().loaded.clone();
    let map = loaded.options.output.map.clone();
    let cap_gaps = settings.cap_gaps.or(loaded.options.settings.cap_gaps);
    let settings = Settings { cap_gaps, ..settings };
    let score = run(py, progress, move |watch| {
        let notice = noticing(watch);
        let machine = machine(&device, &notice)?;
        let backend = Remembering { backend: machine.backend(), answers: None, progress: watch };
        let means = Means { backend: &backend, progress: watch, budget: &Budget::unlimited() };
        let (stack, _) = loaded.completed(&settings, &means)?;
        hold_out(&stack, map.as_deref(), &settings, leave, &backend, watch)
    })?;
    report(py, &score)
}

/// A pair of parts that may be the same.
#[derive(Serialize)]
struct Proposal {
    slice: usize,
    from: u32,
    to: u32,
    /// Centroid from centroid, radii of the larger part.
    distance: f64,
    area_ratio: f64,
    /// Intersection over union once the centroids lie on each other.
    overlap: f64,
    /// Whether each is the other's nearest.
    mutual: bool,
    /// Whether `link="auto"` joins them.
    auto: bool,
}

/// Parts of neighbouring slices that miss each other and may be the same.
#[pyfunction]
pub fn links<'py>(py: Python<'py>, stack: &Bound<'py, PyStack>) -> PyResult<Bound<'py, PyAny>> {
    let loaded = stack.get().loaded.clone();
    let found = run(py, None, move |_| {
        let stack = &loaded.stack;
        let h = stack.spacing.map(|s| s / stack.spacing[0].max(stack.spacing[1]));
        let reach = Settings::default().link_reach;
        let mut found = Vec::new();
        let mut below: Option<Components> = None;
        for (k, slice) in stack.slices.iter().enumerate() {
            let solids = label4(&slice.content.sides(), stack.dims);
            if let Some(low) = below {
                let partners = overlaps(&low, &solids);
                let of = |solids: &Components| parts(solids, stack.dims, h);
                let some = candidates(&of(&low), &of(&solids), &BTreeSet::new(), &partners, stack.dims, h);
                found.extend(some.into_iter().map(|c| {
                    let Link { slice, from, to, .. } = Link { slice: k - 1, from: c.from, to: c.to, join: true };
                    let (distance, area_ratio, overlap) = (c.distance, c.area_ratio, c.iou);
                    let auto = c.convinces(reach);
                    Proposal { slice, from, to, distance, area_ratio, overlap, mutual: c.mutual, auto }
                }));
            }
            below = Some(solids);
        }
        Ok(found)
    })?;
    report(py, &found)
}

/// The GPUs of this machine, best first.
#[pyfunction]
pub fn devices(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let found = run(py, None, |_| ask_drivers().map(|()| adapters()))?;
    report(py, &found)
}

/// Tests whether a GPU and its driver compute rightly; returns what was found, in words.
#[pyfunction]
#[pyo3(signature = (adapter=None))]
pub fn doctor(py: Python<'_>, adapter: Option<String>) -> PyResult<Vec<String>> {
    run(py, None, move |_| {
        ask_drivers()?;
        let gpu = Gpu::open(&GpuOptions { adapter, ..GpuOptions::default() })?;
        let findings = examiner::examine(&gpu)?;
        let words = findings.in_words();
        if findings.trusted() {
            return Ok([vec![gpu.name()], words].concat());
        }
        Err(Error::Gpu(format!("the self-test failed\n{}", words.join("\n"))))
    })
}

/// Runs the command line; returns its exit code.
#[pyfunction]
pub fn command(py: Python<'_>, arguments: Vec<OsString>) -> std::io::Result<u8> {
    py.detach(|| pooled(|| interslice::cli::main(arguments)))
}
