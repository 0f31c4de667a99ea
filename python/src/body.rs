//! `Body`: the result of a reconstruction.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use interslice::cli::devices::DeviceOptions;
use interslice::estimate::memory::MemoryNeeds;
use interslice::files::Loaded;
use interslice::files::options::OutputOptions;
use interslice::files::places::Places;
use interslice::files::write::write_with;
use interslice::surface::contour_lines::{AlongAxes, contour_lines};
use interslice::surface::marching::{Builder, Piece};
use interslice::surface::mesh::MeshMeasure;
use interslice::surface::simplify::Simplifier;
use interslice::{Body, Budget, Error, Layer, Means, Mesh, Reconstruction, Result};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::device::{machine, noticing};
use crate::errors::wrong;
use crate::running::{Watch, run};
use crate::settings::{PySettings, settings_of};
use crate::stack::{PyStack, changed};
use crate::values::report;

/// All that a body is asked with.
struct Inner {
    body: Body,
    device: DeviceOptions,
    output: OutputOptions,
    /// What it was made of.
    from: (Option<PathBuf>, Arc<Loaded>),
    reason: String,
    notes: Vec<String>,
    volume: Option<[f64; 2]>,
}

impl Inner {
    /// Asks the body on its machine.
    fn with<T>(&mut self, watch: &Watch, ask: impl FnOnce(&mut Body, &Means<'_>) -> Result<T>) -> Result<T> {
        let notice = noticing(watch);
        let machine = machine(&self.device, &notice)?;
        ask(&mut self.body, &Means { backend: machine.backend(), progress: watch, budget: &Budget::unlimited() })
    }

    /// Volume and area of the surface, as the program measures them.
    fn measured(&mut self, watch: &Watch) -> Result<[f64; 2]> {
        if let Some(known) = self.volume {
            return Ok(known);
        }
        let found = self.with(watch, |body, means| Ok(measure(body.whole(means)?)))?;
        self.volume = Some(found);
        Ok(found)
    }
}

fn measure(body: &Reconstruction) -> [f64; 2] {
    let (mut builder, mut measure) = (Builder::new(&body.header()), MeshMeasure::default());
    let mut add = |piece: &Piece| measure.add(piece);
    for layer in &body.layers {
        builder.layer(layer);
        builder.pieces(&mut add);
    }
    builder.finish();
    builder.pieces(&mut add);
    [measure.volume(), measure.area()]
}

/// Vertices, and the numbers of each triangle's.
type Surface<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// A reconstructed body.
#[pyclass(name = "Body", module = "interslice", frozen)]
pub struct PyBody {
    inner: Arc<Mutex<Inner>>,
    dims: [usize; 2],
}

impl PyBody {
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&mut Inner, &Watch) -> Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let inner = self.inner.clone();
        run(py, None, move |watch| ask(&mut locked(&inner), watch))
    }
}

/// Reconstructs a stack.
#[pyfunction]
#[pyo3(signature = (stack, at=None, progress=None, base=None, preset=None, options=None))]
pub fn reconstruct<'py>(
    py: Python<'py>,
    stack: &Bound<'py, PyStack>,
    at: Option<Vec<f64>>,
    progress: Option<Bound<'py, PyAny>>,
    base: Option<PySettings>,
    preset: Option<&str>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<PyBody> {
    let (settings, device, mut output) = settings_of(base, preset, options)?;
    if at.is_some() && (output.dz.is_some() || output.isotropic) {
        return Err(wrong("at", "is not for a call with `dz` or `isotropic`, which say the heights".into()));
    }
    let (loaded, path) = (stack.get().loaded.clone(), stack.get().path.clone());
    let dims = loaded.stack.dims;
    let inner = run(py, progress, move |watch| {
        let own = &loaded.options.output;
        (output.map, output.bodies, output.source) = (own.map.clone(), own.bodies.clone(), own.source.clone());
        output.paint = own.paint;
        if output.dz.is_none() && !output.isotropic {
            output.dz = own.dz;
        }
        let stack = loaded.stack.clone();
        let heights = match at {
            Some(heights) => heights,
            None => output.heights(&stack, &settings)?,
        };
        let notice = noticing(watch);
        let mut machine = machine(&device, &notice)?;
        let needs = MemoryNeeds::of(&stack, &heights, &settings, interslice::cli::threads());
        // A layer of the result takes at most four bytes a pixel.
        let layers = (heights.len() * stack.dims[0] * stack.dims[1]) as u64 * 4;
        let budget = machine.budget(&needs, layers, device.memory())?;
        let reason = machine.reason();
        let body = {
            let means = Means { backend: machine.backend(), progress: watch, budget: &budget };
            Body::new(stack, heights, settings, &means)?
        };
        loaded.notes.iter().for_each(|note| watch.warn(note));
        drop(machine);
        let notes = loaded.notes.clone();
        let mut inner = Inner { body, device, output, from: (path, loaded), reason, notes, volume: None };
        let warnings = inner.with(watch, |body, means| Ok(body.whole(means)?.report.warnings.clone()))?;
        warnings.iter().for_each(|warning| watch.warn(warning));
        Ok(inner)
    })?;
    Ok(PyBody { inner: Arc::new(Mutex::new(inner)), dims })
}

#[pymethods]
impl PyBody {
    /// Heights of the output layers.
    #[getter]
    fn heights(&self) -> Vec<f64> {
        locked(&self.inner).body.heights().to_vec()
    }

    /// Heights of the slices.
    #[getter]
    fn contour_heights(&self) -> Vec<f64> {
        locked(&self.inner).body.stack().slices.iter().map(|s| s.z).collect()
    }

    /// Distance of rows and of columns.
    #[getter]
    fn spacing(&self) -> [f64; 2] {
        let [dx, dy] = locked(&self.inner).body.stack().spacing;
        [dy, dx]
    }

    /// Rows and columns of a layer.
    #[getter]
    fn shape(&self) -> [usize; 2] {
        [self.dims[1], self.dims[0]]
    }

    /// Length unit.
    #[getter]
    fn unit(&self) -> String {
        locked(&self.inner).body.stack().unit.clone()
    }

    /// Signed distance on the plane at a height.
    fn distance<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let layer = self.layer(py, z)?;
        PyArray1::from_vec(py, layer.dense()).reshape([self.dims[1], self.dims[0]])
    }

    /// Which pixels are inside on the plane at a height.
    fn mask<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let inside = self.layer(py, z)?.dense().into_iter().map(|v| v < 0.0).collect();
        PyArray1::from_vec(py, inside).reshape([self.dims[1], self.dims[0]])
    }

    /// Signed distances of all output layers.
    fn distances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let values = self.ask(py, |inner, watch| {
            inner.with(watch, |body, means| {
                let mut all = Vec::new();
                body.whole(means)?.output_layers().for_each(|layer| all.extend(layer.dense()));
                Ok(all)
            })
        })?;
        let [nx, ny] = self.dims;
        let count = values.len() / (nx * ny);
        PyArray1::from_vec(py, values).reshape([count, ny, nx])
    }

    /// Which pixels are inside on all output layers.
    fn masks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<bool>>> {
        let values = self.ask(py, |inner, watch| {
            inner.with(watch, |body, means| {
                let mut all = Vec::new();
                for layer in body.whole(means)?.output_layers() {
                    all.extend(layer.dense().into_iter().map(|v| v < 0.0));
                }
                Ok(all)
            })
        })?;
        let [nx, ny] = self.dims;
        let count = values.len() / (nx * ny);
        PyArray1::from_vec(py, values).reshape([count, ny, nx])
    }

    /// Closed lines on the plane at a height: arrays of points (x, y).
    fn contours<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let layer = self.layer(py, z)?;
        let along = {
            let inner = locked(&self.inner);
            let stack = inner.body.stack();
            AlongAxes::new(&stack.geometry, stack.spacing)
        };
        let lines = contour_lines(&layer, self.dims).into_iter();
        let array = |line: interslice::polygons::Polygon| {
            let count = line.len();
            let points = line.into_iter().flat_map(|p| along.point(p).to_array()).collect();
            PyArray1::from_vec(py, points).reshape([count, 2])
        };
        lines.map(array).collect()
    }

    /// The closed surface: vertices (x, y, z) in the world, and the vertices' numbers of each triangle.
    #[pyo3(signature = (simplify=None))]
    fn mesh<'py>(&self, py: Python<'py>, simplify: Option<f64>) -> PyResult<Surface<'py>> {
        if let Some(error) = simplify.filter(|e| !(e.is_finite() && *e > 0.0)) {
            return Err(wrong("simplify", format!("must be a positive number; got {error}")));
        }
        let mesh = self.ask(py, move |inner, watch| {
            let mesh = inner.with(watch, |body, means| Ok(body.whole(means)?.mesh()))?;
            let Some(error) = simplify else { return Ok(mesh) };
            let failed = |source| Error::Write { path: "mesh".into(), source };
            match Simplifier::new(error).simpler(&mut &mesh).map_err(failed)? {
                Ok(simpler) => Ok((*simpler).clone()),
                Err(why) => {
                    watch.warn(&why);
                    Ok(mesh)
                }
            }
        })?;
        let Mesh { positions, triangles } = mesh;
        let [vertices, faces] = [positions.len(), triangles.len()];
        let positions = positions.into_iter().flat_map(|p| p.to_array()).collect();
        let triangles = triangles.into_flattened();
        Ok((
            PyArray1::from_vec(py, positions).reshape([vertices, 3])?,
            PyArray1::from_vec(py, triangles).reshape([faces, 3])?,
        ))
    }

    /// Volume enclosed by the surface, unit cubed.
    #[getter]
    fn volume(&self, py: Python<'_>) -> PyResult<f64> {
        self.ask(py, |inner, watch| inner.measured(watch)).map(|[volume, _]| volume)
    }

    /// Area of the surface, unit squared.
    #[getter]
    fn area(&self, py: Python<'_>) -> PyResult<f64> {
        self.ask(py, |inner, watch| inner.measured(watch)).map(|[_, area]| area)
    }

    /// What was done and how well each contour is met, as the report of the command line.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let told = self.ask(py, |inner, watch| {
            let [volume, area] = inner.measured(watch)?;
            let mut told = inner.with(watch, |body, means| Ok(body.whole(means)?.report.clone()))?;
            told.warnings.splice(0..0, inner.notes.iter().cloned());
            (told.volume, told.area, told.backend_reason) = (Some(volume), Some(area), Some(inner.reason.clone()));
            Ok(told)
        })?;
        report(py, &told)
    }

    /// Writes the body; formats by extension, as on the command line.
    #[pyo3(signature = (*paths, mask=false, distance=false, contours=false, simplify=None))]
    fn save(
        &self,
        py: Python<'_>,
        paths: Vec<PathBuf>,
        mask: bool,
        distance: bool,
        contours: bool,
        simplify: Option<f64>,
    ) -> PyResult<Vec<PathBuf>> {
        if paths.is_empty() {
            return Err(wrong("path", "is missing: nothing would be written".into()));
        }
        self.ask(py, move |inner, watch| {
            let output = OutputOptions { mask, distance, contours, simplify, ..inner.output.clone() };
            output.check_ranges()?;
            // Nothing that was read is written over.
            let mut places = match &inner.from {
                (Some(path), loaded) => Places::of(path, &loaded.options)?,
                _ => Places::default(),
            };
            let (reason, notes) = (inner.reason.clone(), inner.notes.clone());
            inner.with(watch, |body, means| {
                let whole = body.whole(means)?;
                let mut told = whole.report.clone();
                told.warnings.splice(0..0, notes);
                told.backend_reason = Some(reason);
                write_with(&Reconstruction { report: told, ..whole.clone() }, &paths, &output, &mut places)
            })
        })
    }

    /// Puts another mask, or field that is negative inside, in the place of a slice. What depends on it is computed when it is asked for.
    #[pyo3(signature = (slice, mask, *, field=false))]
    fn update(&self, py: Python<'_>, slice: i64, mask: &Bound<'_, PyUntypedArray>, field: bool) -> PyResult<()> {
        let content = changed(mask, field, self.dims)?;
        let slice = usize::try_from(slice)
            .map_err(|_| wrong("slice", format!("must be a slice's place, counted from 0; got {slice}")))?;
        self.ask(py, move |inner, _| {
            inner.volume = None;
            inner.body.update(slice, content)
        })
    }

    /// Intervals between slices, from 0, whose layers are out of date.
    #[getter]
    fn stale(&self) -> Vec<usize> {
        locked(&self.inner).body.stale().collect()
    }

    fn __repr__(&self) -> String {
        let inner = locked(&self.inner);
        let [nx, ny] = self.dims;
        let (slices, layers) = (inner.body.stack().slices.len(), inner.body.heights().len());
        format!("<Body of {slices} slices and {layers} layers, {ny} x {nx} px>")
    }
}

impl PyBody {
    fn layer(&self, py: Python<'_>, z: f64) -> PyResult<Layer> {
        self.ask(py, move |inner, watch| inner.with(watch, |body, means| body.layer(z, means)))
    }
}

fn locked(inner: &Mutex<Inner>) -> MutexGuard<'_, Inner> {
    inner.lock().unwrap_or_else(PoisonError::into_inner)
}
