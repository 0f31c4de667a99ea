//! An array with its place in the world as a volume, as a reader would give it.

use glam::DVec3;
use interslice::Axis;
use interslice::input::volume::Volume;
use interslice::input::volume::grid::VolumeGrid;
use interslice::stack::options::LabelName;
use interslice::stack::{ReadOptions, WorldSpace};
use numpy::PyUntypedArray;
use pyo3::prelude::*;

use std::sync::Arc;

use crate::array::{Array, Voxels, of_axes};
use crate::errors::{raised, wrong};

/// Note on an array without spacing.
const UNSPACED: &str =
    "nothing says how large voxels are: they count as cubes of 1 px; `spacing` says their sides (mm)";

/// Place of an array in the world. `order` says which of its axes are x, y and z.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Place {
    order: [usize; 3],
    origin: [f64; 3],
    steps: [[f64; 3]; 3],
    unit: String,
    spaced: bool,
    name: String,
}

/// Choice of slices and labels.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Choice {
    /// The array's axis along which slices lie.
    axis: Option<usize>,
    slices: Option<Vec<usize>>,
    keep: Option<usize>,
    complete_slices: bool,
    level: Option<f64>,
    invert: bool,
    label: Option<i64>,
}

impl Place {
    /// The volume, and the array that it reads.
    pub fn volume(&self, array: &Bound<'_, PyUntypedArray>) -> PyResult<(Volume, Arc<Array>)> {
        let array = of_axes(&self.name, array, 3)?;
        let [x, y, z] = self.order;
        let grid = VolumeGrid {
            dims: [array.shape[x], array.shape[y], array.shape[z]],
            origin: DVec3::from(self.origin),
            steps: self.steps.map(DVec3::from),
            unit: self.unit.clone(),
            spaced: self.spaced,
            space: WorldSpace::default(),
        };
        let voxels = Voxels::new(array.clone());
        let stored = voxels.order.map(|axis| self.axis_of(axis));
        let element = array.element;
        let assumed = grid.is_assumed();
        let mut volume = Volume::given(&self.name, grid, element, stored, Arc::new(voxels)).map_err(raised)?;
        volume.notes.extend(assumed.then(|| UNSPACED.into()));
        Ok((volume, array))
    }

    /// Its own name in messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The volume's axis that an axis of the array is.
    fn axis_of(&self, axis: usize) -> usize {
        self.order.iter().position(|own| *own == axis).unwrap_or(axis)
    }

    /// The array's axis that is an axis of the volume.
    pub fn own_axis(&self, axis: usize) -> usize {
        self.order[axis]
    }
}

impl Choice {
    /// As options of a reader.
    pub fn options(&self, place: &Place) -> PyResult<ReadOptions> {
        let axis = match self.axis {
            None => Axis::Auto,
            Some(axis) if axis < 3 => [Axis::X, Axis::Y, Axis::Z][place.axis_of(axis)],
            Some(axis) => return Err(wrong("axis", format!("must be 0, 1 or 2, an axis of the array; got {axis}"))),
        };
        Ok(ReadOptions {
            axis,
            slices: self.slices.clone(),
            keep: self.keep,
            complete_slices: self.complete_slices,
            level: self.level,
            invert: self.invert,
            label: self.label.map(LabelName::Number),
            ..ReadOptions::default()
        })
    }
}
