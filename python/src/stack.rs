//! Stacks: read from files, or made of arrays and polygons.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use interslice::files::options::OutputOptions;
use interslice::files::{JobOptions, Loaded};
use interslice::input::{Input, Surveyed};
use interslice::polygons::{PlaneDrawing, Planes, clean, doubts, stack as drawn};
use interslice::{ContourStack, Geometry, LevelSlice, Result, Slice, SliceContent};
use numpy::{PyReadonlyArray2, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::{Array, of_axes};
use crate::errors::{raised, wrong};
use crate::running::run;
use crate::settings::read_options;
use crate::volume::{Choice, Place};

/// A stack of contours, as `read` gives it.
#[pyclass(name = "Stack", module = "interslice", frozen)]
pub struct PyStack {
    /// The stack with what its file says of outputs.
    pub loaded: Arc<Loaded>,
    /// The file, where there is one.
    pub path: Option<PathBuf>,
    /// A volume's slices with what was found.
    pub input: Option<Input>,
}

impl PyStack {
    fn of(loaded: Loaded) -> Self {
        PyStack { loaded: Arc::new(loaded), path: None, input: None }
    }
}

#[pymethods]
impl PyStack {
    /// Heights of the slices, increasing.
    #[getter]
    fn heights(&self) -> Vec<f64> {
        self.loaded.stack.slices.iter().map(|s| s.z).collect()
    }

    /// Names of the slices.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.loaded.stack.slices.iter().map(|s| s.name.clone()).collect()
    }

    /// Rows and columns of a slice.
    #[getter]
    fn shape(&self) -> [usize; 2] {
        let [nx, ny] = self.loaded.stack.dims;
        [ny, nx]
    }

    /// Distance of rows and of columns.
    #[getter]
    fn spacing(&self) -> [f64; 2] {
        let [dx, dy] = self.loaded.stack.spacing;
        [dy, dx]
    }

    /// Length unit.
    #[getter]
    fn unit(&self) -> &str {
        &self.loaded.stack.unit
    }

    /// Notes for a person.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.loaded.notes.clone()
    }

    fn __len__(&self) -> usize {
        self.loaded.stack.slices.len()
    }

    fn __repr__(&self) -> String {
        let [nx, ny] = self.loaded.stack.dims;
        let unit = &self.loaded.stack.unit;
        let [dx, dy] = self.loaded.stack.spacing;
        format!("<Stack of {} slices, {ny} x {nx} px of {dy} x {dx} {unit}>", self.__len__())
    }
}

/// Reads a file or folder.
#[pyfunction]
#[pyo3(signature = (path, options=None))]
pub fn read(py: Python<'_>, path: PathBuf, options: Option<&Bound<'_, PyDict>>) -> PyResult<PyStack> {
    let read = read_options(options)?;
    let (loaded, path) = run(py, None, move |_| {
        let options = JobOptions { read, ..JobOptions::default() };
        Ok((Loaded::read(&path, options)?, path))
    })?;
    Ok(PyStack { path: Some(path), ..PyStack::of(loaded) })
}

/// The painted slices of a volume in an array.
#[pyfunction]
pub fn read_array(
    py: Python<'_>,
    array: &Bound<'_, PyUntypedArray>,
    place: Place,
    choice: Choice,
) -> PyResult<PyStack> {
    let read = choice.options(&place)?;
    let (volume, _) = place.volume(array)?;
    let (loaded, input) = run(py, None, move |_| {
        let input = Input::of_volume(volume, &read)?;
        let notes = input.doubts(&read);
        let bodies = input.surveyed.iter().filter_map(|s| s.appearance()).collect();
        let paint = input.surveyed.as_ref().and_then(Surveyed::paint);
        let output = OutputOptions { bodies, paint, ..OutputOptions::default() };
        let options = JobOptions { read, output, ..JobOptions::default() };
        let interpolated = input.interpolated(&options.read)?;
        let loaded = Loaded { notes, ..Loaded::new(input.stack.clone(), options)? }.with(interpolated)?;
        Ok((loaded, input))
    })?;
    Ok(PyStack { input: Some(input), ..PyStack::of(loaded) })
}

/// Where slices lie: spacing of rows and columns, origin, directions of columns, rows and heights, unit.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Lie {
    heights: Vec<f64>,
    spacing: [f64; 2],
    origin: [f64; 3],
    axes: [[f64; 3]; 3],
    unit: String,
}

impl Lie {
    /// The place in the world, checked.
    fn geometry(&self) -> PyResult<Geometry> {
        let geometry =
            Geometry { origin: DVec3::from(self.origin), axes: self.axes.map(DVec3::from), ..Geometry::default() };
        geometry.validate().map_err(raised)?;
        Ok(geometry)
    }

    fn named(&self, k: usize, content: SliceContent) -> Slice {
        Slice { name: format!("[{k}]"), z: self.heights[k], extra: false, content }
    }
}

/// What the values of slices are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Values {
    /// Inside where not 0.
    Masks,
    /// Negative inside.
    Fields,
    /// Inside above a level.
    Greys(f64),
}

/// A stack of masks, of fields that are negative inside, or of grey values with a level: an array of three axes or a sequence of arrays.
#[pyfunction]
pub fn stack_of_arrays(slices: &Bound<'_, PyAny>, lie: Lie, kind: &str, level: Option<f64>) -> PyResult<PyStack> {
    let (py, geometry) = (slices.py(), lie.geometry()?);
    let values = match (kind, level) {
        ("masks", None) => Values::Masks,
        (_, Some(level)) => Values::Greys(level),
        _ => Values::Fields,
    };
    let mut planes: Vec<(Arc<Array>, Option<usize>)> = Vec::new();
    if let Ok(array) = slices.cast::<PyUntypedArray>() {
        let array = of_axes(kind, array, 3)?;
        planes.extend((0..array.shape[0]).map(|k| (array.clone(), Some(k))));
    } else {
        for (k, slice) in slices.try_iter()?.enumerate() {
            let slice = slice?;
            let slice = slice
                .cast::<PyUntypedArray>()
                .map_err(|_| wrong(kind, format!("must be arrays; slice {k} is none")))?;
            planes.push((of_axes(kind, slice, 2)?, None));
        }
    }
    let Some((first, _)) = planes.first() else { return Err(wrong(kind, "must not be empty".into())) };
    check_count(kind, planes.len(), &lie)?;
    let size = |array: &Array| [array.shape[array.shape.len() - 2], array.shape[array.shape.len() - 1]];
    let [ny, nx] = size(first);
    if let Some(k) = planes.iter().position(|(plane, _)| size(plane) != [ny, nx]) {
        let [rows, columns] = size(&planes[k].0);
        return Err(wrong(kind, format!("must be of one size; slice {k} is {rows} x {columns}, slice 0 {ny} x {nx}")));
    }
    let named = |(k, (array, fixed)): (usize, &(Arc<Array>, Option<usize>))| {
        Ok(lie.named(
            k,
            content(array, *fixed, values, nx).map_err(|message| wrong(kind, format!("slice {k} {message}")))?,
        ))
    };
    let slices = planes.iter().enumerate().map(named).collect::<PyResult<Vec<Slice>>>()?;
    let stack = ContourStack {
        dims: [nx, ny],
        spacing: [lie.spacing[1], lie.spacing[0]],
        unit: lie.unit.clone(),
        slices,
        z_out: None,
        geometry,
        known: None,
    };
    let notes = stack.inside_out(false).into_iter().collect();
    loaded(py, move || Ok((stack, notes)))
}

/// One slice of an array, or what is wrong with it.
fn content(
    array: &Array,
    fixed: Option<usize>,
    values: Values,
    nx: usize,
) -> std::result::Result<SliceContent, String> {
    let mut all = Vec::new();
    Ok(match values {
        Values::Masks => {
            let (mut inside, mut unknown) = (Vec::with_capacity(nx), 0);
            array.plane(fixed, &mut |v| {
                inside.push(v != 0.0);
                unknown += usize::from(v.is_nan());
            });
            if unknown > 0 {
                return Err(format!("has {unknown} values that are NaN; a mask is 0 outside and anything else inside"));
            }
            SliceContent::Mask(inside.into_iter().collect())
        }
        Values::Fields => {
            array.plane(fixed, &mut |v| all.push(v as f32));
            SliceContent::Level(LevelSlice::new(&all, nx))
        }
        Values::Greys(level) => {
            array.plane(fixed, &mut |v| all.push((level - v) as f32));
            SliceContent::Level(LevelSlice::new(&all, nx))
        }
    })
}

/// A changed slice: a mask, or a field that is negative inside.
pub fn changed(slice: &Bound<'_, PyUntypedArray>, is_field: bool, dims: [usize; 2]) -> PyResult<SliceContent> {
    let array = of_axes("mask", slice, 2)?;
    let [nx, ny] = dims;
    if array.shape != [ny, nx] {
        let message = format!("must be {ny} x {nx} as the body's slices; got {} x {}", array.shape[0], array.shape[1]);
        return Err(wrong("mask", message));
    }
    let values = if is_field { Values::Fields } else { Values::Masks };
    content(&array, None, values, nx).map_err(|message| wrong("mask", message))
}

/// A stack of polygons: for each slice the closed lines, points of which are (x, y).
#[pyfunction]
pub fn stack_of_polygons(
    py: Python<'_>,
    polygons: Vec<Vec<PyReadonlyArray2<'_, f64>>>,
    lie: Lie,
    pixel: Option<[f64; 2]>,
) -> PyResult<PyStack> {
    let geometry = lie.geometry()?;
    check_count("polygons", polygons.len(), &lie)?;
    let mut drawings = Vec::new();
    for (k, lines) in polygons.iter().enumerate() {
        let mut region = Vec::new();
        for line in lines {
            let points = line.as_array();
            if points.ncols() != 2 {
                let found = points.ncols();
                return Err(wrong("polygons", format!("have points (x, y); slice {k} has some of {found} numbers")));
            }
            region.push(points.rows().into_iter().map(|p| DVec2::new(p[0], p[1])).collect());
        }
        drawings.push(PlaneDrawing { name: format!("[{k}]"), z: lie.heights[k], extra: false, regions: vec![region] });
    }
    let planes = Planes { unit: lie.unit.clone(), axes: geometry.axes, z_out: None };
    let pixel = pixel.map(|[dy, dx]| [dx, dy]);
    loaded(py, move || {
        let mut notes = clean(&mut drawings, pixel);
        let mut stack = drawn(&drawings, &planes, pixel)?;
        notes.extend(doubts(&drawings, &stack, pixel));
        stack.geometry.origin += geometry.origin;
        Ok((stack, notes))
    })
}

fn check_count(kind: &str, slices: usize, lie: &Lie) -> PyResult<()> {
    if slices == lie.heights.len() {
        return Ok(());
    }
    Err(wrong("heights", format!("must be as many as slices: {slices} {kind}; got {} heights", lie.heights.len())))
}

/// The stack that `make` makes, with its notes, checked.
fn loaded(
    py: Python<'_>,
    make: impl FnOnce() -> Result<(ContourStack, Vec<String>)> + Send + 'static,
) -> PyResult<PyStack> {
    let loaded = run(py, None, move |_| {
        let (stack, mut notes) = make()?;
        stack.validate()?;
        notes.extend(stack.doubts());
        Ok(Loaded { notes, ..Loaded::new(stack, JobOptions::default())? })
    })?;
    Ok(PyStack::of(loaded))
}
