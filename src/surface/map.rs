//! Maps: where a height map lies, in which coordinate system, and which part of the computed pixels it shows.

pub use super::crs::{Crs, MapCrs};

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::surface::Layer;
use crate::surface::header::Header;
use crate::surface::like::{among, between};

/// Facts that a contour map states besides its lines. Its stack goes on beyond the map's border, so that the border is no contour; outputs show the
/// pixels between whose centres the map lies, the outermost up to one beyond the border.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Map {
    /// Coordinate system of x and y.
    pub crs: Crs,
    /// First column and row that are shown.
    pub first: [usize; 2],
    /// Columns and rows.
    pub dims: [usize; 2],
    /// What a height map has below the lowest contour.
    #[serde(default, skip_serializing_if = "Floor::is_nodata")]
    pub floor: Floor,
}

/// What a height map has where its body is nowhere.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Floor {
    /// No data (NaN).
    #[default]
    Nodata,
    /// One height.
    Constant(f64),
    /// Heights of the map's pixels, row by row.
    Heights(Vec<f64>),
}

impl Floor {
    fn is_nodata(&self) -> bool {
        *self == Floor::Nodata
    }

    /// Height at a place `x` in a map of `dims` pixels, of which the first is 0: linear between their centres; none (NaN) half a pixel beyond these.
    pub fn height(&self, x: DVec2, dims: [usize; 2]) -> f64 {
        match (self, among(x, dims)) {
            (Floor::Nodata, _) | (_, None) => f64::NAN,
            (Floor::Constant(height), _) => *height,
            (Floor::Heights(heights), Some(x)) => {
                between(x, dims, |i, j| heights.get(j * dims[0] + i).copied().unwrap_or(f64::NAN))
            }
        }
    }
}

impl Map {
    /// Whether it is a part of layers of `dims` pixels.
    pub fn lies_within(&self, dims: [usize; 2]) -> bool {
        (0..2).all(|a| self.dims[a] > 0 && self.first[a].checked_add(self.dims[a]).is_some_and(|end| end <= dims[a]))
    }

    /// The header of the part that is shown.
    pub fn header(&self, whole: &Header) -> Header {
        let mut header = Header { dims: self.dims, ..whole.clone() };
        for (axis, way) in whole.geometry.axes.iter().take(2).enumerate() {
            let by = self.first[axis] as f64 * whole.spacing[axis];
            header.geometry.origin += by * *way;
        }
        header
    }

    /// The part of a layer that is shown.
    pub fn layer(&self, whole: &Layer) -> Layer {
        // A map lies within the layers: nothing is outside.
        let phi = whole.phi.window(self.first.map(|n| n as isize), self.dims, f32::INFINITY);
        Layer { z: whole.z, phi, output: whole.output, contour: whole.contour }
    }
}
