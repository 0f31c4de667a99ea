//! `Body`: the result of a reconstruction.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use interslice::cli::devices::DeviceOptions;
use interslice::estimate::memory::MemoryNeeds;
use interslice::files::format::{Kind, kind};
use interslice::files::options::OutputOptions;
use interslice::files::places::Places;
use interslice::files::provenance::Source;
use interslice::files::write::write_with;
use interslice::files::{JobOptions, Loaded};
use interslice::report::{AreaProfile, Provenance, Report};
use interslice::stack::appearance::Appearance;
use interslice::surface::areas::Areas;
use interslice::surface::contour_lines::{AlongAxes, contour_lines};
use interslice::surface::marching::{Builder, Piece};
use interslice::surface::mesh::MeshMeasure;
use interslice::surface::simplify::Simplifier;
use interslice::{Body, Budget, Error, Geometry, Layer, Means, Mesh, Reconstruction, Result};
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
    /// What a report says of its making; nothing of arrays, or of a body that was changed.
    made_of: Option<MadeOf>,
    reason: String,
    notes: Vec<String>,
    measured: Option<Measured>,
}

/// File and options as they were given.
struct MadeOf {
    path: PathBuf,
    options: JobOptions,
    at: Option<Vec<f64>>,
}

impl MadeOf {
    /// The provenance of what is saved so; `bodies` became the body.
    fn provenance(&self, saving: &Saving, bodies: &[Appearance]) -> Result<Provenance> {
        let output = saving.over(&self.options.output);
        let source = Source::of(&self.path, &JobOptions { output, ..self.options.clone() })?;
        let source = self.at.iter().fold(source, |source, at| source.with("at", at.clone()));
        source.provenance(bodies)
    }
}

/// What is measured on the surface.
#[derive(Clone)]
struct Measured {
    volume: f64,
    area: f64,
    areas: AreaProfile,
}

/// What `save` is told of outputs; nothing is as `reconstruct` was told.
#[derive(Default)]
struct Saving {
    mask: Option<bool>,
    distance: Option<bool>,
    contours: Option<bool>,
    simplify: Option<f64>,
}

impl Saving {
    /// The options of `reconstruct` with these.
    fn over(&self, told: &OutputOptions) -> OutputOptions {
        // One of both wins over the other that `reconstruct` was told.
        let other = |own: Option<bool>, other: Option<bool>, told: bool| own.unwrap_or(told && other != Some(true));
        OutputOptions {
            mask: other(self.mask, self.distance, told.mask),
            distance: other(self.distance, self.mask, told.distance),
            contours: self.contours.unwrap_or(told.contours),
            simplify: self.simplify.or(told.simplify),
            ..told.clone()
        }
    }
}

impl Inner {
    /// Asks the body on its machine.
    fn with<T>(&mut self, watch: &Watch, ask: impl FnOnce(&mut Body, &Means<'_>) -> Result<T>) -> Result<T> {
        let notice = noticing(watch);
        let machine = machine(&self.device, &notice)?;
        ask(&mut self.body, &Means { backend: machine.backend(), progress: watch, budget: &Budget::unlimited() })
    }

    /// Volume and area of the surface, and areas over its height, as the program measures them.
    fn measured(&mut self, watch: &Watch) -> Result<Measured> {
        if let Some(known) = &self.measured {
            return Ok(known.clone());
        }
        let found = self.with(watch, |body, means| measure(body.whole(means)?, watch))?;
        self.measured = Some(found.clone());
        Ok(found)
    }

    /// The report without what is measured on the surface.
    fn report(&mut self, watch: &Watch, saving: &Saving) -> Result<Report> {
        let mut told = self.with(watch, |body, means| Ok(body.whole(means)?.report.clone()))?;
        told.warnings.splice(0..0, self.notes.iter().cloned());
        told.backend_reason = Some(self.reason.clone());
        match self.made_of.as_ref().map(|made_of| made_of.provenance(saving, &self.output.bodies)) {
            None => {}
            Some(Ok(provenance)) => told.provenance = Some(provenance),
            // The file may have gone; the body is here.
            Some(Err(gone)) => told.warnings.push(format!("the report does not say what the body was made of: {gone}")),
        }
        Ok(told)
    }
}

/// Shows the surface, piece by piece.
fn each_piece(body: &Reconstruction, watch: &Watch, each: &mut dyn FnMut(&Piece)) -> Result<()> {
    let mut builder = Builder::new(&body.header());
    for layer in &body.layers {
        watch.go_on()?;
        builder.layer(layer);
        builder.pieces(&mut *each);
    }
    builder.finish();
    builder.pieces(&mut *each);
    Ok(())
}

fn measure(body: &Reconstruction, watch: &Watch) -> Result<Measured> {
    let (mut measure, mut areas) = (MeshMeasure::default(), Areas::new(&body.header()));
    each_piece(body, watch, &mut |piece| measure.add(piece))?;
    for layer in &body.layers {
        watch.go_on()?;
        areas.layer(layer);
    }
    Ok(Measured { volume: measure.volume(), area: measure.area(), areas: areas.finish() })
}

/// Vertices, and the numbers of each triangle's.
type Surface<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// A reconstructed body.
#[pyclass(name = "Body", module = "interslice", frozen)]
pub struct PyBody {
    inner: Arc<Mutex<Inner>>,
    /// What no call changes, so that nobody waits for it.
    heights: Vec<f64>,
    contour_heights: Vec<f64>,
    dims: [usize; 2],
    spacing: [f64; 2],
    unit: String,
    geometry: Geometry,
}

impl PyBody {
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&mut Inner, &Watch) -> Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let inner = self.inner.clone();
        run(py, None, move |watch| ask(&mut *watch.lock(&inner)?, watch))
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
    if output.like.is_some() {
        return Err(wrong("like", "is an option of the command line alone; `at` names heights here".into()));
    }
    let options = JobOptions {
        read: loaded.options.read.clone(),
        settings: settings.clone(),
        output: output.clone(),
        ..JobOptions::default()
    };
    let made_of = path.clone().map(|path| MadeOf { path, options, at: at.clone() });
    let inner = run(py, progress, move |watch| {
        let own = &loaded.options.output;
        (output.map, output.bodies, output.source) = (own.map.clone(), own.bodies.clone(), own.source.clone());
        output.paint = own.paint;
        if output.dz.is_none() && !output.isotropic {
            output.dz = own.dz;
        }
        let stack = &loaded.stack;
        let heights = match at {
            Some(heights) => heights,
            None => output.heights(stack, &settings)?,
        };
        let notice = noticing(watch);
        let mut machine = machine(&device, &notice)?;
        let needs = MemoryNeeds::of(stack, &heights, &settings, interslice::cli::threads());
        // A layer of the result takes at most four bytes a pixel.
        let layers = (heights.len() * stack.dims[0] * stack.dims[1]) as u64 * 4;
        let budget = machine.budget(&needs, layers, device.memory())?;
        let reason = machine.reason();
        let body = {
            let means = Means { backend: machine.backend(), progress: watch, budget: &budget };
            let (stack, notes) = loaded.completed(&settings, &means)?;
            notes.iter().for_each(|note| watch.warn(note));
            Body::new(stack.into_owned(), heights, settings, &means)?
        };
        loaded.notes.iter().for_each(|note| watch.warn(note));
        drop(machine);
        let notes = loaded.notes.clone();
        let mut inner = Inner { body, device, output, from: (path, loaded), made_of, reason, notes, measured: None };
        let warnings = inner.with(watch, |body, means| Ok(body.whole(means)?.report.warnings.clone()))?;
        warnings.iter().for_each(|warning| watch.warn(warning));
        Ok(inner)
    })?;
    let stack = inner.body.stack();
    Ok(PyBody {
        heights: inner.body.heights().to_vec(),
        contour_heights: stack.slices.iter().map(|s| s.z).collect(),
        dims: stack.dims,
        spacing: stack.spacing,
        unit: stack.unit.clone(),
        geometry: stack.geometry,
        inner: Arc::new(Mutex::new(inner)),
    })
}

#[pymethods]
impl PyBody {
    /// Heights of the output layers.
    #[getter]
    fn heights(&self) -> Vec<f64> {
        self.heights.clone()
    }

    /// Heights of the slices.
    #[getter]
    fn contour_heights(&self) -> Vec<f64> {
        self.contour_heights.clone()
    }

    /// Distance of rows and of columns.
    #[getter]
    fn spacing(&self) -> [f64; 2] {
        let [dx, dy] = self.spacing;
        [dy, dx]
    }

    /// Where column 0 and row 0 are at height 0 in the world (LPS): column i and row j at height z are at `origin + i dx axes[0] + j dy axes[1] + z axes[2]`.
    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.geometry.origin.to_array()
    }

    /// Unit vectors along a row, along a column and upwards.
    #[getter]
    fn axes(&self) -> [[f64; 3]; 3] {
        self.geometry.axes.map(|axis| axis.to_array())
    }

    /// Rows and columns of a layer.
    #[getter]
    fn shape(&self) -> [usize; 2] {
        [self.dims[1], self.dims[0]]
    }

    /// Length unit.
    #[getter]
    fn unit(&self) -> &str {
        &self.unit
    }

    /// Signed distance within the plane at a height, in the unit of the spacing: negative inside, clamped 14 px from the contour (`half_width` and 8 more).
    fn distance<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let values = self.layer(py, z, |layer| layer.dense())?;
        PyArray1::from_vec(py, values).reshape([self.dims[1], self.dims[0]])
    }

    /// Which pixels are inside on the plane at a height.
    fn mask<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let inside = self.layer(py, z, |layer| layer.dense().into_iter().map(|v| v < 0.0).collect())?;
        PyArray1::from_vec(py, inside).reshape([self.dims[1], self.dims[0]])
    }

    /// Signed distances of all output layers, as `distance` has them.
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

    /// Closed lines on the plane at a height: arrays of points (x, y) along the directions of columns and rows from the world's origin, in the unit of the
    /// spacing.
    fn contours<'py>(&self, py: Python<'py>, z: f64) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let dims = self.dims;
        let lines = self.layer(py, z, move |layer| contour_lines(layer, dims))?.into_iter();
        let along = AlongAxes::new(&self.geometry, self.spacing);
        let array = |line: interslice::polygons::Polygon| {
            let count = line.len();
            let points = line.into_iter().flat_map(|p| along.point(p).to_array()).collect();
            PyArray1::from_vec(py, points).reshape([count, 2])
        };
        lines.map(array).collect()
    }

    /// The closed surface: vertices (x, y, z) in the world (LPS), in the unit of the spacing, and the vertices' numbers of each triangle.
    #[pyo3(signature = (simplify=None))]
    fn mesh<'py>(&self, py: Python<'py>, simplify: Option<f64>) -> PyResult<Surface<'py>> {
        if let Some(error) = simplify.filter(|e| !(e.is_finite() && *e > 0.0)) {
            return Err(wrong("simplify", format!("must be a positive number; got {error}")));
        }
        let mesh = self.ask(py, move |inner, watch| {
            let mut mesh = Mesh::default();
            inner.with(watch, |body, means| each_piece(body.whole(means)?, watch, &mut |piece| mesh.add(piece)))?;
            let Some(error) = simplify else { return Ok(mesh) };
            let failed = |source| Error::Write { path: "mesh".into(), source };
            match Simplifier::new(error, watch.stop()).simpler(&mut &mesh).map_err(failed)? {
                Ok(simpler) => {
                    simpler.warning().iter().for_each(|told| watch.warn(told));
                    Ok((*simpler.mesh).clone())
                }
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
        self.ask(py, |inner, watch| inner.measured(watch)).map(|measured| measured.volume)
    }

    /// Area of the surface, unit squared.
    #[getter]
    fn area(&self, py: Python<'_>) -> PyResult<f64> {
        self.ask(py, |inner, watch| inner.measured(watch)).map(|measured| measured.area)
    }

    /// What was done and how well each contour is met, as the report of the command line.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let told = self.ask(py, |inner, watch| {
            let Measured { volume, area, areas } = inner.measured(watch)?;
            let told = inner.report(watch, &Saving::default())?;
            Ok(Report { volume: Some(volume), area: Some(area), areas: Some(areas), ..told })
        })?;
        report(py, &told)
    }

    /// Writes the body; formats by extension, as on the command line. What is None is as `reconstruct` was told.
    #[pyo3(signature = (*paths, mask=None, distance=None, contours=None, simplify=None))]
    fn save(
        &self,
        py: Python<'_>,
        paths: Vec<PathBuf>,
        mask: Option<bool>,
        distance: Option<bool>,
        contours: Option<bool>,
        simplify: Option<f64>,
    ) -> PyResult<Vec<PathBuf>> {
        if paths.is_empty() {
            return Err(wrong("path", "is missing: nothing would be written".into()));
        }
        self.ask(py, move |inner, watch| {
            let saving = Saving { mask, distance, contours, simplify };
            let output = saving.over(&inner.output);
            output.check_ranges()?;
            // Nothing that was read is written over.
            let mut places = match &inner.from {
                (Some(path), loaded) => Places::of(path, &loaded.options)?,
                _ => Places::default(),
            };
            let has_report = paths.iter().any(|path| matches!(kind(path), Ok(Kind::Report | Kind::View)));
            let report = if has_report { inner.report(watch, &saving)? } else { Report::default() };
            inner.with(watch, |body, means| {
                let body = Reconstruction { report, ..body.whole(means)?.clone() };
                write_with(&body, &paths, &output, &mut places, watch.stop())
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
            inner.body.update(slice, content)?;
            (inner.measured, inner.made_of) = (None, None);
            Ok(())
        })
    }

    /// Intervals between slices, from 0, whose layers are out of date.
    #[getter]
    fn stale(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.ask(py, |inner, _| Ok(inner.body.stale().collect()))
    }

    fn __repr__(&self) -> String {
        let [nx, ny] = self.dims;
        let (slices, layers) = (self.contour_heights.len(), self.heights.len());
        format!("<Body of {slices} slices and {layers} layers, {ny} x {nx} px>")
    }
}

impl PyBody {
    /// What `of` makes of the layer at a height.
    fn layer<T: Send + 'static>(
        &self,
        py: Python<'_>,
        z: f64,
        of: impl FnOnce(&Layer) -> T + Send + 'static,
    ) -> PyResult<T> {
        self.ask(py, move |inner, watch| inner.with(watch, |body, means| Ok(of(&body.layer(z, means)?))))
    }
}
