//! Volumes and ROIs as they are in files, for programs that show and change them, and label volumes into files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use interslice::files::format::{Kind, kind};
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::input::open_volume;
use interslice::input::volume::element::Element;
use interslice::input::volume::survey::Survey;
use interslice::input::volume::{Lacking, Volume, VoxelRun};
use interslice::report::Report;
use interslice::rtstruct::StructureSet;
use interslice::stack::appearance::Appearance;
use interslice::storage::room::check_room;
use interslice::surface::content::Scalar;
use interslice::{Error, Geometry, Header, HeightGrid, Layer, LayerSink, Progress, Result, SparseImage};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArray};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::array::Array;
use crate::errors::wrong;
use crate::running::{Watch, run};
use crate::volume::Place;

/// Name and colour of a label, by its number.
type Segment = (i64, Option<String>, Option<[u8; 3]>);

/// Voxels as numpy has them: z slowest, x fastest.
enum Voxels {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// A volume with its voxels.
struct Whole {
    volume: Volume,
    /// Whether they are grey values.
    is_grey: bool,
    /// One array for each layer of segments that may overlap.
    arrays: Vec<Voxels>,
}

/// Reads all voxels of a volume: labels, or grey values where they are no whole numbers or look like an image's. The result has `arrays` with axes
/// (z, y, x), `grey`, `origin` and `steps` of x, y and z in the world (LPS), `unit`, `spaced`, `format`, and `segments` by label.
#[pyfunction]
pub fn read_volume(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let Whole { volume, is_grey, arrays } = run(py, None, move |watch| whole(&path, watch))?;
    let grid = &volume.grid;
    let [x, y, z] = grid.dims;
    let all = PyList::empty(py);
    for array in arrays {
        all.append(array.into_numpy(py)?.call_method1("reshape", ([z, y, x],))?)?;
    }
    let segments = PyDict::new(py);
    for (label, Appearance { name, colour, .. }) in &volume.segments {
        segments.set_item(label, (name, colour.map(|c| c.map(u16::from))))?;
    }
    let told = PyDict::new(py);
    told.set_item("arrays", all)?;
    told.set_item("grey", is_grey)?;
    told.set_item("origin", grid.origin.to_array())?;
    told.set_item("steps", grid.steps.map(|step| step.to_array()))?;
    told.set_item("unit", &grid.unit)?;
    told.set_item("spaced", grid.spaced && !matches!(volume.lacks, Some(Lacking::Needed(_))))?;
    told.set_item("format", volume.format)?;
    told.set_item("segments", segments)?;
    Ok(told)
}

fn whole(path: &Path, watch: &Watch) -> Result<Whole> {
    let volume = open_volume(path)?;
    volume.notes.iter().for_each(|note| watch.warn(note));
    let layers = volume.layers();
    let own = match (volume.element, volume.scale) {
        (Element::Int { .. }, None) if layers == 1 => Some(volume.element.scalar()),
        _ => None,
    };
    let survey = Survey::of(&volume, None);
    let is_grey = match &survey {
        Ok(survey) => volume.segments.is_empty() && survey.grey().is_some(),
        // What is wrong with the file itself is wrong with its grey values too.
        Err(_) => layers == 1 && own.is_none(),
    };
    let mut arrays = Vec::new();
    if is_grey && own.is_none() {
        let scalar = if volume.element == Element::Double { Scalar::F64 } else { Scalar::F32 };
        let mut array = Voxels::new(&volume, scalar, 1)?;
        volume.greys(|run| array.set_greys(&volume, &run))?;
        arrays.push(array);
    } else {
        let Survey { labels, more, .. } = survey?;
        let ends = [labels.keys().next(), labels.keys().next_back()].map(|label| label.copied().unwrap_or(0));
        // Numbers of segments in layers are places, of which the survey sees those that are not covered.
        let most = if layers == 1 { ends[1] } else { volume.segments.keys().next_back().copied().unwrap_or(0) };
        let holding = if more { Scalar::I64 } else { Scalar::U8.or_wider(ends[0].min(0), most.max(0)) };
        let scalar = own.unwrap_or(holding);
        for layer in 0..layers {
            if watch.stops() {
                return Err(Error::Interrupted);
            }
            let mut array = Voxels::new(&volume, scalar, layers)?;
            volume.labels_of_layer(layer, |run| array.set_labels(&volume, &run))?;
            arrays.push(array);
        }
    }
    Ok(Whole { volume, is_grey, arrays })
}

/// The same for the voxels of every type.
macro_rules! each_type {
    ($voxels:expr, $values:ident => $do:expr) => {
        match $voxels {
            Voxels::U8($values) => $do,
            Voxels::I8($values) => $do,
            Voxels::U16($values) => $do,
            Voxels::I16($values) => $do,
            Voxels::U32($values) => $do,
            Voxels::I32($values) => $do,
            Voxels::U64($values) => $do,
            Voxels::I64($values) => $do,
            Voxels::F32($values) => $do,
            Voxels::F64($values) => $do,
        }
    };
}

impl Voxels {
    /// As many 0 as the volume has voxels; `times` says how many such arrays there will be.
    fn new(volume: &Volume, scalar: Scalar, times: usize) -> Result<Self> {
        let count = volume.voxels();
        let bytes = match scalar {
            Scalar::U8 | Scalar::I8 => 1.0,
            Scalar::U16 | Scalar::I16 => 2.0,
            Scalar::U32 | Scalar::I32 | Scalar::F32 => 4.0,
            Scalar::U64 | Scalar::I64 | Scalar::F64 => 8.0,
        };
        let [x, y, z] = volume.grid.dims;
        check_room(bytes * count as f64 * times as f64).map_err(|more| Error::Format {
            path: volume.path.clone(),
            message: format!("{x} x {y} x {z} voxels {more}"),
        })?;
        Ok(match scalar {
            Scalar::U8 => Voxels::U8(vec![0; count]),
            Scalar::I8 => Voxels::I8(vec![0; count]),
            Scalar::U16 => Voxels::U16(vec![0; count]),
            Scalar::I16 => Voxels::I16(vec![0; count]),
            Scalar::U32 => Voxels::U32(vec![0; count]),
            Scalar::I32 => Voxels::I32(vec![0; count]),
            Scalar::U64 => Voxels::U64(vec![0; count]),
            Scalar::I64 => Voxels::I64(vec![0; count]),
            Scalar::F32 => Voxels::F32(vec![0.0; count]),
            Scalar::F64 => Voxels::F64(vec![0.0; count]),
        })
    }

    /// The first place of a run, and the step to the next.
    fn places<T>(volume: &Volume, run: &VoxelRun<'_, T>) -> [usize; 2] {
        let [nx, ny, _] = volume.grid.dims;
        let [x, y, z] = run.first;
        [x + nx * (y + ny * z), [1, nx, nx * ny][run.along]]
    }

    fn set_labels(&mut self, volume: &Volume, run: &VoxelRun<'_>) {
        let [first, step] = Self::places(volume, run);
        each_type!(self, values => {
            let places = values[first..].iter_mut().step_by(step);
            places.zip(run.values).for_each(|(to, label)| *to = *label as _);
        });
    }

    fn set_greys(&mut self, volume: &Volume, run: &VoxelRun<'_, f64>) {
        let [first, step] = Self::places(volume, run);
        each_type!(self, values => {
            let places = values[first..].iter_mut().step_by(step);
            places.zip(run.values).for_each(|(to, grey)| *to = *grey as _);
        });
    }

    fn into_numpy(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        each_type!(self, values => PyArray1::from_vec(py, values).into_bound_py_any(py))
    }
}

/// Writes an array of labels into a volume's file, the format by its extension, with names and colours where the format has them.
#[pyfunction]
pub fn write_volume(
    py: Python<'_>,
    path: PathBuf,
    labels: &Bound<'_, PyUntypedArray>,
    place: Place,
    segments: Vec<Segment>,
) -> PyResult<PathBuf> {
    let (volume, array) = place.volume(labels)?;
    if !matches!(array.element.0, Element::Int { .. }) {
        let kind = array.element.0.name();
        return Err(wrong(place.name(), format!("must be whole numbers, of a type of integers; got {kind}")));
    }
    let order = [0, 1, 2].map(|axis| place.own_axis(axis));
    run(py, None, move |watch| {
        let labels = Labels { volume, array, order };
        labels.write(&path, &segments, watch)?;
        Ok(path)
    })
}

/// An array of labels that becomes a file.
struct Labels {
    volume: Volume,
    array: std::sync::Arc<Array>,
    /// The array's axes that are x, y and z.
    order: [usize; 3],
}

impl Labels {
    /// Row `j` of slice `k`.
    fn row(&self, [j, k]: [usize; 2], row: &mut [i64]) {
        let [x, y, z] = self.order;
        let mut at = [0; 3];
        (at[y], at[z]) = (j, k);
        self.array.row(&at, x, row);
    }

    fn header(&self) -> Header {
        let grid = &self.volume.grid;
        let ([nx, ny, nz], [dx, dy, dz]) = (grid.dims, grid.spacing());
        Header {
            dims: [nx, ny],
            spacing: [dx, dy],
            unit: grid.unit.clone(),
            geometry: Geometry { origin: grid.origin, axes: grid.axes(), ..Geometry::default() },
            extent: [0.0, (nz - 1) as f64 * dz],
            grid: HeightGrid { start: 0.0, step: dz, count: nz },
        }
    }

    fn write(&self, path: &Path, segments: &[Segment], watch: &Watch) -> Result<()> {
        if kind(path)? != Kind::Volume {
            let message = "is the name of no volume, which labels are written to".into();
            return Err(Error::Output { path: path.into(), message });
        }
        let mut known: BTreeMap<i64, Appearance> = BTreeMap::new();
        for (label, name, colour) in segments {
            known.insert(*label, Appearance { name: name.clone(), colour: *colour, ..Appearance::label(*label) });
        }
        let limit = Scalar::MOST_LABEL;
        let [nx, ny, nz] = self.volume.grid.dims;
        let mut row = vec![0; nx];
        for place in (0..nz).flat_map(|k| (0..ny).map(move |j| [j, k])) {
            self.row(place, &mut row);
            for stretch in row.chunk_by(|a, b| a == b).filter(|stretch| stretch[0] != 0) {
                let label = stretch[0];
                // Beyond 63 bits a number without sign has one here.
                let is_beyond = label < 0 && matches!(self.array.element.0, Element::Int { signed: false, .. });
                if is_beyond || !(-limit..=limit).contains(&label) {
                    let got = if is_beyond { (label as u64).to_string() } else { label.to_string() };
                    let message = format!("must lie within {limit} either side of 0; got {got}");
                    return Err(Error::Setting { name: "labels".into(), message });
                }
                known.entry(label).or_insert_with(|| Appearance::label(label));
            }
        }
        let ends = [known.keys().next(), known.keys().next_back()].map(|label| label.copied().unwrap_or(0));
        let scalar = self.array.element.0.scalar().or_wider(ends[0].min(0), ends[1].max(0));
        let bodies: Vec<Appearance> = known.into_values().collect();
        let options = OutputOptions::default();
        let outputs = Outputs::open(&[path.into()], None, Temporary::Random, &mut Places::default())?;
        let mut outputs = outputs.until(watch.stop());
        outputs.check(&options)?;
        let header = self.header();
        {
            let mut sink = outputs.label_sink(scalar, &bodies, &options);
            sink.begin(&header)?;
            for k in 0..nz {
                let fill = |first: usize, [rows]: [&mut [f32]; 1]| {
                    let mut row = vec![0; nx];
                    for (j, to) in rows.chunks_exact_mut(nx).enumerate() {
                        self.row([first + j, k], &mut row);
                        to.iter_mut().zip(&row).for_each(|(to, label)| *to = *label as f32);
                    }
                };
                let [phi] = SparseImage::of_rows([nx, ny], fill);
                sink.layer(Layer { z: k as f64 * header.grid.step, phi, output: true, contour: None })?;
            }
        }
        let mut report = Report::default();
        outputs.complete(&mut report)?;
        report.warnings.iter().for_each(|warning| watch.warn(warning));
        outputs.rename().map(drop)
    }
}

/// The ROIs of an RTSTRUCT, or of the one in a folder: `number`, `name`, `colour`, `contours`, each its kind and points (x, y, z) in mm, LPS, and
/// `fault`, why these cannot be read.
#[pyfunction]
#[pyo3(signature = (path, series=None))]
pub fn read_rois<'py>(py: Python<'py>, path: PathBuf, series: Option<String>) -> PyResult<Bound<'py, PyList>> {
    let set = run(py, None, move |_| StructureSet::choose_file(&path, series.as_deref()))?;
    let all = PyList::empty(py);
    for roi in set.rois {
        let contours = PyList::empty(py);
        for contour in roi.contours {
            let count = contour.points.len();
            let points: Vec<f64> = contour.points.iter().flat_map(DVec3::to_array).collect();
            contours.append((contour.kind, PyArray1::from_vec(py, points).reshape([count, 3])?))?;
        }
        let told = PyDict::new(py);
        told.set_item("number", roi.number)?;
        told.set_item("name", roi.name)?;
        told.set_item("colour", roi.colour.map(|c| c.map(u16::from)))?;
        told.set_item("contours", contours)?;
        told.set_item("fault", roi.fault)?;
        all.append(told)?;
    }
    Ok(all)
}
