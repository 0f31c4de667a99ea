//! `fill`: labels between their slices, array in and array out.

use std::collections::{BTreeMap, BTreeSet};

use interslice::backend::answers::Remembering;
use interslice::input::labels::{Wanted, labels_of_volume};
use interslice::labels::given::Given;
use interslice::labels::{LabelStack, Plan, fill as fill_stack};
use interslice::stack::options::LabelName;
use interslice::stack::{HeightGrid, SliceContent};
use interslice::surface::stream::LayerSink;
use interslice::{Budget, Error, Means, Result, SparseImage, height_grid};
use numpy::PyUntypedArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::{Array, NewArray};
use crate::device::{machine, noticing};
use crate::errors::wrong;
use crate::running::run;
use crate::settings::{PySettings, no_outputs, settings_of};
use crate::values::report;
use crate::volume::{Choice, Place};

/// Slices of each label, where they are given one by one.
type OwnSlices = BTreeMap<i64, Vec<usize>>;

/// Fills `labels`; returns the array and the report.
#[pyfunction]
#[pyo3(signature = (labels, place, choice, only=None, own_slices=None, progress=None, base=None, preset=None, options=None))]
#[expect(clippy::too_many_arguments, reason = "the words of Python's own function, which calls this one")]
pub fn fill<'py>(
    py: Python<'py>,
    labels: &Bound<'py, PyUntypedArray>,
    place: Place,
    choice: Choice,
    only: Option<Vec<i64>>,
    own_slices: Option<OwnSlices>,
    progress: Option<Bound<'py, PyAny>>,
    base: Option<PySettings>,
    preset: Option<&str>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<(Py<PyUntypedArray>, Bound<'py, PyAny>)> {
    let (settings, device, output) = settings_of(base, preset, options)?;
    no_outputs(&output, "`fill`, whose output has the slices of its input")?;
    let read = choice.options(&place)?;
    let (volume, from) = place.volume(labels)?;
    let mut to = NewArray::like(labels, &from)?;
    let wanted = match (&only, &own_slices) {
        (Some(_), Some(_)) => {
            return Err(wrong("only", "is not for a call whose `slices` name labels: these are filled".into()));
        }
        (Some(only), None) => Wanted::These(only.iter().copied().map(LabelName::Number).collect()),
        (None, Some(own)) => Wanted::These(own.keys().copied().map(LabelName::Number).collect()),
        (None, None) => Wanted::All,
    };
    if let Wanted::These(list) = &wanted {
        if list.is_empty() {
            return Err(wrong("only", "must name at least one label".into()));
        }
        if list.contains(&LabelName::Number(0)) {
            return Err(wrong("only", "0 is the background and no label".into()));
        }
    }
    let axes = [0, 1, 2].map(|axis| place.own_axis(axis));
    let (to, told) = run(py, progress, move |watch| {
        let mut stack = labels_of_volume(volume, &read, &wanted)?;
        if let Some(own) = &own_slices {
            give(&mut stack, own)?;
            stack.validate()?;
        }
        let notice = noticing(watch);
        let machine = machine(&device, &notice)?;
        let heights = height_grid(&stack.stack, &settings, None).heights()?;
        let folder = std::env::temp_dir();
        let beside = machine.backend().host_bytes();
        let plan = Plan { heights: &heights, settings: &settings, folder: &folder, beside, memory: device.memory() };
        let backend = Remembering { backend: machine.backend(), answers: None, progress: watch };
        let means = Means { backend: &backend, progress: watch, budget: &Budget::unlimited() };
        let mut sink = Filled { next: 0, to: &mut to, from: &from, axes, stack: &stack, watch };
        let mut told = fill_stack(&stack, &plan, &means, &mut sink)?;
        told.backend = machine.backend().name();
        let warnings = told.labels.iter().flat_map(|l| l.run.warnings.iter().map(move |w| (l.label, w)));
        told.warnings
            .iter()
            .cloned()
            .chain(warnings.map(|(l, w)| format!("label {l}: {w}")))
            .chain(told.reading.clone())
            .for_each(|w| watch.warn(&w));
        Ok((to, told))
    })?;
    Ok((to.into_inner(), report(py, &told)?))
}

/// Gives each label the slices that are named for it; `stack` has been read with the slices of all of them.
fn give(stack: &mut LabelStack, own: &OwnSlices) -> Result<()> {
    let Some(HeightGrid { step, .. }) = stack.stack.z_out else { return Ok(()) };
    let numbers: Vec<usize> = stack.stack.slices.iter().map(|s| (s.z / step).round() as usize).collect();
    let known: Vec<BTreeSet<usize>> =
        stack.labels.iter().map(|label| own.get(label).into_iter().flatten().copied().collect()).collect();
    stack.given = known
        .iter()
        .map(|known| Given {
            slices: (0..numbers.len()).filter(|k| known.contains(&numbers[*k])).collect(),
            ..Given::default()
        })
        .collect();
    for (drawn, number) in stack.drawn.iter_mut().zip(&numbers) {
        for label in drawn.iter_mut().filter(|label| **label > 0) {
            if !known[*label as usize - 1].contains(number) {
                *label = 0;
            }
        }
    }
    for (slice, drawn) in stack.stack.slices.iter_mut().zip(&stack.drawn) {
        slice.content = SliceContent::Mask(drawn.iter().map(|label| *label > 0).collect());
    }
    Ok(())
}

/// Takes the label volume, slice by slice.
struct Filled<'f> {
    next: usize,
    to: &'f mut NewArray,
    from: &'f Array,
    /// The array's axes that are x, y and z.
    axes: [usize; 3],
    stack: &'f LabelStack,
    watch: &'f crate::running::Watch,
}

impl LayerSink for Filled<'_> {
    fn layer(&mut self, layer: interslice::Layer) -> Result<()> {
        if interslice::Progress::stops(self.watch) {
            return Err(Error::Interrupted);
        }
        let [u, v, w] = self.stack.stack.geometry.order.map(|axis| self.axes[axis]);
        let [nx, ny] = self.stack.stack.dims;
        let phi: &SparseImage<f32> = &layer.phi;
        let (mut row, mut values) = (vec![0.0; nx], vec![0; nx]);
        let kept = |label: i64| self.stack.labels.binary_search(&label).is_err();
        for j in 0..ny {
            phi.read(0, j, &mut row);
            values.iter_mut().zip(&row).for_each(|(value, number)| *value = *number as i64);
            let mut at = [0; 3];
            (at[v], at[w]) = (j, self.next);
            self.to.set_row(at, u, &values, self.from, &kept);
        }
        self.next += 1;
        Ok(())
    }
}
