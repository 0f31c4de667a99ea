//! Output: the reconstructed body as layers of signed distance, and one writer per format.

pub mod areas;
mod cases;
pub mod content;
pub mod contour_lines;
pub mod crs;
pub(crate) mod deflate;
pub mod geojson;
pub mod geotiff;
pub mod glb;
pub mod groups;
pub mod header;
pub mod heightmap;
pub mod html;
pub(crate) mod length;
pub mod like;
pub mod local;
pub mod map;
pub mod marching;
pub mod mesh;
pub mod mesh_files;
pub mod mha;
pub mod nifti;
pub mod npy;
pub mod nrrd;
pub mod origin;
pub(crate) mod own_store;
pub mod render;
#[cfg(feature = "simplify")]
pub mod simplify;
mod slab;
mod space;
pub mod spool;
pub mod stream;
mod strip;
pub mod three_mf;
pub mod tiff_volume;
pub(crate) mod transposed;
pub mod volume;
mod voxels;
pub mod vtk;
#[cfg(feature = "zarr")]
pub mod zarr;

use crate::grid::sparse_image::SparseImage;
use crate::report::Report;
use crate::stack::Geometry;
use header::Header;

/// The body as in-plane signed distance on layers of increasing height.
///
/// Layers are the output heights, the heights of all input contours, the two end planes and, where output heights are few, some between them. Between
/// neighbouring layers the body is what linear interpolation along z says; where it is still inside at `extent`, it is cut flat there.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// Pixels per layer, `[nx, ny]`, those of the input.
    pub dims: [usize; 2],
    /// Pixel spacing `[dx, dy]`.
    pub spacing: [f64; 2],
    /// Length unit.
    pub unit: String,
    /// Placement in the world.
    pub geometry: Geometry,
    /// Lowest and highest height at which there is a body: where it is still inside there, it ends flat.
    pub extent: [f64; 2],
    /// Layers by strictly increasing height.
    pub layers: Vec<Layer>,
    /// Report of what was done and how well.
    pub report: Report,
}

/// One layer of the body.
#[derive(Debug, Clone)]
pub struct Layer {
    /// Height, unit of the stack.
    pub z: f64,
    /// Signed in-plane distance to the contour in the stack's unit, negative inside, never zero, clamped to the margin. Only the squares of pixels
    /// near the contour take memory.
    pub phi: SparseImage<f32>,
    /// Belongs to the output grid (volumes are written from these).
    pub output: bool,
    /// Index of the input contour at this height.
    pub contour: Option<usize>,
}

impl Layer {
    /// The distances of all pixels, row-major.
    pub fn dense(&self) -> Vec<f32> {
        self.phi.unpack()
    }
}

impl Reconstruction {
    /// The closed surface of the body, from its layers, in world coordinates (LPS); empty where there are none.
    pub fn mesh(&self) -> mesh::Mesh {
        mesh::closed_surface(self)
    }

    /// Layers of the output grid.
    pub fn output_layers(&self) -> impl Iterator<Item = &Layer> {
        self.layers.iter().filter(|l| l.output)
    }

    /// Header for writers: what they must know before the first layer.
    pub fn header(&self) -> Header {
        let heights: Vec<f64> = self.output_layers().map(|l| l.z).collect();
        Header {
            dims: self.dims,
            spacing: self.spacing,
            unit: self.unit.clone(),
            geometry: self.geometry,
            extent: self.extent,
            grid: Header::grid(&heights, self.spacing),
        }
    }
}
