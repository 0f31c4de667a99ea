//! The pixels on which drawings are laid: how large, and where.

use super::edges::{area, contour_edges};
use super::{PlaneDrawing, Polygon};
use crate::error::{Error, Result};
use crate::storage::room;

/// Empty pixels around all contours: room for what bulges between the planes.
pub const MARGIN: usize = 8;
/// Least pixels across the mean width of what is drawn, where the pixel size is chosen here.
const ACROSS: f64 = 8.0;
/// Most pixels along the longer side of the box around all contours, where the pixel size is chosen here.
const LONGEST: f64 = 1024.0;
/// Most pixels of all slices together: 4 GiB of level sets.
const MOST_PIXELS: f64 = (1u64 << 30) as f64;
/// Rows by which the area of a plane is measured.
const LINES: usize = 64;

/// A grid of pixels. Pixel (i, j) has its centre at `origin + (i dx, j dy)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawingGrid {
    /// Centre of pixel (0, 0).
    pub origin: [f64; 2],
    /// Pixel sides.
    pub spacing: [f64; 2],
    /// Pixels along x and y.
    pub dims: [usize; 2],
}

impl DrawingGrid {
    /// The grid around all drawings, and [`MARGIN`] pixels.
    pub(super) fn around(drawings: &[PlaneDrawing], pixel: Option<[f64; 2]>) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "pixel".into(), message });
        let (low, high) = bounds(drawings.iter().flat_map(PlaneDrawing::polygons));
        if !(low[0] < high[0] && low[1] < high[1]) {
            return Err(Error::Stack("nothing is drawn: no polygon encloses an area".into()));
        }
        let spacing = pixel.unwrap_or_else(|| [pixel_side(drawings); 2]);
        if spacing.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return fail(format!("must be a positive number; got {}", spacing[0]));
        }
        DrawingGrid::over([low, high], spacing, drawings.len())
    }

    /// The grid over a box, and [`MARGIN`] pixels around it, for so many slices.
    ///
    /// # Errors
    /// [`Error::Setting`] for too many pixels.
    pub fn over([low, high]: [[f64; 2]; 2], spacing: [f64; 2], slices: usize) -> Result<Self> {
        let first = [0, 1].map(|a| (low[a] / spacing[a]).floor() - MARGIN as f64);
        let sides = [0, 1].map(|a| (high[a] / spacing[a]).ceil() + MARGIN as f64 - first[a] + 1.0);
        let pixels = sides[0] * sides[1] * slices as f64;
        // Beyond 2^52 steps from the origin pixels would have no places of their own.
        let placed = (0..2).all(|a| first[a].abs() < 4e15 && sides[a] < 1e6);
        if !(pixels <= MOST_PIXELS && placed) {
            let message = format!(
                "must be larger: {} slices of {} x {} pixels of {} are more than {MOST_PIXELS} pixels",
                slices, sides[0], sides[1], spacing[0]
            );
            return Err(Error::Setting { name: "pixel".into(), message });
        }
        // All slices, and the distances, squared and not, of those at work.
        let at_work = slices.min(rayon::current_num_threads());
        let bytes = sides[0] * sides[1] * (4 * slices + 12 * at_work) as f64;
        room::check_room(bytes).map_err(|m| {
            let of = format!("{slices} slices of {} x {} pixels of {}", sides[0], sides[1], spacing[0]);
            Error::Setting { name: "pixel".into(), message: format!("must be larger: {of} {m}") }
        })?;
        let origin = [0, 1].map(|a| first[a] * spacing[a]);
        Ok(DrawingGrid { origin, spacing, dims: sides.map(|n| n as usize) })
    }

    /// Where `x` lies, in columns.
    pub fn column(&self, x: f64) -> f64 {
        (x - self.origin[0]) / self.spacing[0]
    }

    /// Where `y` lies, in rows.
    pub fn row(&self, y: f64) -> f64 {
        (y - self.origin[1]) / self.spacing[1]
    }

    /// Centres of column `i`.
    pub fn x(&self, i: usize) -> f64 {
        self.origin[0] + i as f64 * self.spacing[0]
    }

    /// Centres of row `j`.
    pub fn y(&self, j: usize) -> f64 {
        self.origin[1] + j as f64 * self.spacing[1]
    }
}

/// Pixel side for drawings: half the median distance of neighbouring points, so that no drawn point is lost between pixels, but at most an
/// eighth of the mean width `2 A / P` (area and length of all contours), so that what has few points is still several pixels wide, and at
/// least 1/1024 of the longer side of the box around all.
pub fn pixel_side(drawings: &[PlaneDrawing]) -> f64 {
    let (low, high) = bounds(drawings.iter().flat_map(PlaneDrawing::polygons));
    let longer = (high[0] - low[0]).max(high[1] - low[1]);
    let (mut lengths, mut area_sum) = (Vec::new(), 0.0);
    for region in drawings.iter().flat_map(|d| &d.regions) {
        let edges = contour_edges(region, 1e-9 * longer);
        lengths.extend(edges.iter().map(|[p, q]| (q[0] - p[0]).hypot(q[1] - p[1])));
        let (low, high) = bounds(region.iter());
        if low[1] < high[1] {
            area_sum += area(&edges, [low[1], high[1]], LINES);
        }
    }
    lengths.sort_by(f64::total_cmp);
    let Some(median) = lengths.get(lengths.len() / 2) else { return longer / LONGEST };
    let width = 2.0 * area_sum / lengths.iter().sum::<f64>();
    (0.5 * median).min(width / ACROSS).max(longer / LONGEST)
}

/// Lowest and highest coordinates; the lowest is above the highest where there are no points.
fn bounds<'a>(polygons: impl Iterator<Item = &'a Polygon>) -> ([f64; 2], [f64; 2]) {
    polygons.flatten().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), p| {
        ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
    })
}
