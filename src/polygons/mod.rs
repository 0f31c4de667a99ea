//! Polygons on parallel planes become slices: level sets whose zero set is the drawn line to a small part of a pixel.
//!
//! ```text
//! polygons -> edges (bridges cancelled) -> sides (even-odd) and distances near the edges -> SliceContent::Level
//! ```
//!
//! Points inside an odd number of a region's polygons are inside; winding does not count. Work is in proportion to the length of the
//! contours in pixels, but for the writing of the slices themselves.

pub(crate) mod clean;
pub mod crossing;
pub mod distance;
pub mod edges;
pub mod fill;
pub mod grid;
pub(crate) mod near;
mod needed;
pub mod pixel;
pub mod plane;
pub mod zones;

pub use clean::clean;
use distance::near_distance;
use edges::{Edge, contour_edges};
use fill::fill;
use glam::{DVec2, DVec3};
use grid::DrawingGrid;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::stack::{ContourStack, Geometry, HeightGrid, LevelSlice, Slice, SliceContent};

/// A closed line: the last point joins the first.
pub type Polygon = Vec<DVec2>;

/// Distances are clamped this many px from the contour. The distance stage reads the values next to the contour, at most a pixel's diagonal
/// away, and the signs of all others.
pub const CLAMP: f64 = 2.0;
/// Points that are as close as this, px, are one; edges between the same points cancel in pairs.
pub const SAME_POINT: f64 = 1e-4;

/// Drawing on one plane.
#[derive(Debug, Clone)]
pub struct PlaneDrawing {
    /// Name for messages.
    pub name: String,
    /// Height of the plane.
    pub z: f64,
    /// A user's added contour.
    pub extra: bool,
    /// Regions, of which each is the even-odd combination of its polygons; the body is their union.
    pub regions: Vec<Vec<Polygon>>,
}

impl PlaneDrawing {
    /// All polygons.
    pub fn polygons(&self) -> impl Iterator<Item = &Polygon> {
        self.regions.iter().flatten()
    }
}

/// What a person should know of drawings and of the stack that was made of them on pixels of these sides, if they were named.
pub fn doubts(drawings: &[PlaneDrawing], stack: &ContourStack, pixel: Option<[f64; 2]>) -> Vec<String> {
    let lost =
        drawings.iter().zip(&stack.slices).filter(|(drawn, s)| drawn.polygons().count() > 0 && s.content.is_empty());
    let [dx, dy] = stack.spacing;
    let lost = lost.map(|(_, s)| {
        format!(
            "`{}` at {}: no pixel of {dx} x {dy} {} lies inside its polygons; a smaller --pixel finds them",
            s.name, s.z, stack.unit
        )
    });
    let large = grid::too_large(drawings, pixel, stack.spacing);
    large.into_iter().chain(crossing::crossing(drawings)).chain(lost).collect()
}

/// Facts about all planes.
#[derive(Debug, Clone)]
pub struct Planes {
    /// Length unit.
    pub unit: String,
    /// World directions (LPS) of x, y and the heights.
    pub axes: [DVec3; 3],
    /// Output heights that the input asks for.
    pub z_out: Option<HeightGrid>,
}

/// The drawings as a stack of level sets on pixels of sides `pixel` (else [`pixel::pixel_side`]): signed distances in the unit, negative inside,
/// exact where they are below [`CLAMP`] px and clamped there. Pixel (0, 0) lies where it must for x and y to be world coordinates along
/// the axes; pixel centres are whole multiples of the pixel sides.
///
/// # Errors
/// [`Error::Slice`] for a coordinate that is not finite, [`Error::Stack`] where nothing is drawn or lines leave nothing, [`Error::Setting`] for a pixel size that
/// is none, too small, or so large that all slices are empty.
pub fn stack(drawings: &[PlaneDrawing], planes: &Planes, pixel: Option<[f64; 2]>) -> Result<ContourStack> {
    for (index, drawing) in drawings.iter().enumerate() {
        let wrong = |p: &&DVec2| !p.is_finite();
        let of = drawing.polygons().enumerate().find_map(|(k, polygon)| Some((k, *polygon.iter().find(wrong)?)));
        if let Some((k, DVec2 { x, y })) = of {
            let message = format!("polygon {} has the point ({x}, {y}); coordinates must be finite numbers", k + 1);
            return Err(Error::Slice { index, name: drawing.name.clone(), message });
        }
    }
    let grid = DrawingGrid::around(drawings, pixel)?;
    let slices = slices_on(&grid, drawings);
    let is_empty = slices.iter().all(|slice| slice.content.is_empty());
    // Finer pixels do not help where lines cancel.
    if is_empty && pixel.is_some() && grid.spacing.max_element() > pixel::pixel_side(drawings) {
        let (DVec2 { x, y }, unit) = (grid.spacing, &planes.unit);
        let message =
            format!("must be smaller: no pixel of {x} x {y} {unit} lies inside a polygon, all slices are empty");
        return Err(Error::Setting { name: "pixel".into(), message });
    }
    let cancelled = if is_empty { crossing::crossing(drawings) } else { Vec::new() };
    if !cancelled.is_empty() {
        return Err(Error::Stack(format!("all slices are empty: {}", cancelled.join("; "))));
    }
    let origin = grid.origin.x * planes.axes[0] + grid.origin.y * planes.axes[1];
    Ok(ContourStack {
        dims: grid.dims,
        spacing: grid.spacing.to_array(),
        unit: planes.unit.clone(),
        slices,
        z_out: planes.z_out,
        geometry: Geometry { origin, axes: planes.axes, ..Geometry::default() },
        known: None,
    })
}

/// Slices of some drawings on the pixels that the stack of `all` has.
///
/// # Errors
/// The errors of [`stack`].
pub fn slices(drawings: &[PlaneDrawing], all: &[PlaneDrawing], pixel: Option<[f64; 2]>) -> Result<Vec<Slice>> {
    Ok(slices_on(&DrawingGrid::around(all, pixel)?, drawings))
}

fn slices_on(grid: &DrawingGrid, drawings: &[PlaneDrawing]) -> Vec<Slice> {
    let slice = |d: &PlaneDrawing| Slice {
        name: d.name.clone(),
        z: d.z,
        extra: d.extra,
        content: SliceContent::Level(LevelSlice::new(&level_set(&d.regions, grid), grid.dims[0])),
    };
    drawings.par_iter().map(slice).collect()
}

/// `min` over the regions of the signed distance to each, clamped.
pub(crate) fn level_set(regions: &[Vec<Polygon>], grid: &DrawingGrid) -> Vec<f32> {
    let px = grid.spacing.max_element();
    let clamp = CLAMP * px;
    let mut level = vec![clamp as f32; grid.dims[0] * grid.dims[1]];
    for region in regions {
        let edges: Vec<Edge> = contour_edges(region, SAME_POINT * px);
        let mut signed = near_distance(&edges, grid, clamp);
        fill(&edges, grid, |run| signed[run].iter_mut().for_each(|d| *d = -*d));
        level.iter_mut().zip(signed).for_each(|(a, b)| *a = a.min(b));
    }
    level
}
