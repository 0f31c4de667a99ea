//! The pixels on which drawings are laid, and what is too small for them.

use glam::DVec2;

use super::PlaneDrawing;
use super::pixel::{COARSE, LONGEST, LOST, Sides, inner_widths, pixel_side, sides};
use crate::error::{Error, Result};
use crate::storage::room;

/// Empty pixels around all contours: room for what bulges between the planes.
pub const MARGIN: usize = 8;
/// Most pixels along the longer side that a note asks for.
const FINEST: f64 = 8192.0;
/// Most pixels of all slices together: 4 GiB of level sets.
const MOST_PIXELS: f64 = (1u64 << 30) as f64;

/// A grid of pixels. Pixel (i, j) has its centre at `origin + (i dx, j dy)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawingGrid {
    /// Centre of pixel (0, 0).
    pub origin: DVec2,
    /// Pixel sides.
    pub spacing: DVec2,
    /// Pixels along x and y.
    pub dims: [usize; 2],
}

impl DrawingGrid {
    /// The grid around all drawings, and [`MARGIN`] pixels.
    pub(super) fn around(drawings: &[PlaneDrawing], pixel: Option<[f64; 2]>) -> Result<Self> {
        let fail = |message: String| Err(Error::Setting { name: "pixel".into(), message });
        let [low, high] = bounds(drawings.iter().flat_map(PlaneDrawing::polygons).flatten());
        if !low.cmplt(high).all() {
            return Err(Error::Stack("nothing is drawn: no polygon encloses an area".into()));
        }
        let spacing = pixel.map_or_else(|| DVec2::splat(pixel_side(drawings)), DVec2::from);
        if let Some(side) = spacing.to_array().into_iter().find(|side| !(side.is_finite() && *side > 0.0)) {
            return fail(format!("must be a positive number; got {side}"));
        }
        DrawingGrid::over([low, high], spacing, drawings.len())
    }

    /// The grid over a box, and [`MARGIN`] pixels around it, for so many slices.
    ///
    /// # Errors
    /// [`Error::Setting`] for too many pixels.
    pub fn over([low, high]: [DVec2; 2], spacing: DVec2, slices: usize) -> Result<Self> {
        let first = (low / spacing).floor() - MARGIN as f64;
        let sides = (high / spacing).ceil() + MARGIN as f64 - first + 1.0;
        let pixels = sides.x * sides.y * slices as f64;
        // Beyond 2^52 steps from the origin pixels would have no places of their own.
        let placed = first.abs().cmplt(DVec2::splat(4e15)).all() && sides.cmplt(DVec2::splat(1e6)).all();
        if !(pixels <= MOST_PIXELS && placed) {
            let message = format!(
                "must be larger: {} slices of {} x {} pixels of {} are more than {MOST_PIXELS} pixels",
                slices, sides.x, sides.y, spacing.x
            );
            return Err(Error::Setting { name: "pixel".into(), message });
        }
        // All slices, and the distances, squared and not, of those at work.
        let at_work = slices.min(rayon::current_num_threads());
        let bytes = sides.x * sides.y * (4 * slices + 12 * at_work) as f64;
        room::check_room(bytes).map_err(|m| {
            let of = format!("{slices} slices of {} x {} pixels of {}", sides.x, sides.y, spacing.x);
            Error::Setting { name: "pixel".into(), message: format!("must be larger: {of} {m}") }
        })?;
        Ok(DrawingGrid { origin: first * spacing, spacing, dims: sides.as_usizevec2().to_array() })
    }

    /// Place of `x`, in columns.
    pub fn column(&self, x: f64) -> f64 {
        (x - self.origin.x) / self.spacing.x
    }

    /// Place of `y`, in rows.
    pub fn row(&self, y: f64) -> f64 {
        (y - self.origin.y) / self.spacing.y
    }

    /// Centres of column `i`.
    pub fn x(&self, i: usize) -> f64 {
        self.origin.x + i as f64 * self.spacing.x
    }

    /// Centres of row `j`.
    pub fn y(&self, j: usize) -> f64 {
        self.origin.y + j as f64 * self.spacing.y
    }
}

/// A note where pixels of these sides are too large for what is drawn, by the sides that were given or by the least that is chosen.
pub fn too_large(drawings: &[PlaneDrawing], given: Option<[f64; 2]>, [dx, dy]: [f64; 2]) -> Option<String> {
    coarse(drawings, given).or_else(|| lost_lines(drawings, dx.max(dy)))
}

/// A note where what lines bound is less than 1.5 pixels of this side wide, so that it may be lost.
fn lost_lines(drawings: &[PlaneDrawing], side: f64) -> Option<String> {
    let all: Vec<Vec<f64>> = drawings.iter().map(|drawing| inner_widths(drawing).collect()).collect();
    let of = |widths: &Vec<f64>| widths.iter().filter(|width| **width < LOST * side).count();
    let count: usize = all.iter().map(of).sum();
    let (first, _) = drawings.iter().zip(&all).find(|(_, widths)| of(widths) > 0)?;
    let least = all.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let [low, high] = bounds(drawings.iter().flat_map(PlaneDrawing::polygons).flatten());
    let shown = least / COARSE;
    // Finer ones than a program can hold help nobody.
    let pixel = match (high - low).max_element() <= FINEST * shown {
        true => format!("a --pixel below {} shows it", figures(shown)),
        false => "a smaller --pixel shows more of it".into(),
    };
    Some(format!(
        "what {count} of {} polygons bound is less than {LOST} pixels wide in the mean (the first: `{}` at {}), and may be lost in part or as a whole: \
         {pixel}",
        drawings.iter().flat_map(PlaneDrawing::polygons).count(),
        first.name,
        first.z,
    ))
}

/// A note where what is drawn is less than 4 pixels wide in the mean, by the pixel sides that were given or by the least one that is chosen: small
/// things far apart.
fn coarse(drawings: &[PlaneDrawing], pixel: Option<[f64; 2]>) -> Option<String> {
    let Sides { width, least, .. } = sides(drawings);
    let side = pixel.map_or(least, |[x, y]| x.max(y));
    (width < COARSE * side).then(|| {
        let why = match pixel {
            Some(_) => format!(
                "so that areas and volumes may be off by many per cent: a --pixel below {} shows it",
                figures(width / COARSE)
            ),
            None => format!("1/{LONGEST} of the longer side of all contours: --pixel sets it"),
        };
        format!("what is drawn is {} wide in the mean, and a pixel {}, {why}", figures(width), figures(side))
    })
}

/// A length with three figures, whatever its unit.
pub(super) fn figures(length: f64) -> f64 {
    format!("{length:.2e}").parse().unwrap_or(length)
}

/// Lowest and highest coordinates; the lowest is above the highest where there are no points.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a DVec2>) -> [DVec2; 2] {
    points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_beyond_the_numbers_is_refused() {
        let over = |low: [f64; 2], side: f64| {
            DrawingGrid::over([DVec2::from(low), DVec2::from(low) + side], DVec2::splat(0.5), 2)
        };
        assert!(over([1e15, -1e15], 4.0).is_ok());
        for (low, side) in [([4e15, 0.0], 4.0), ([0.0, -4e15], 4.0), ([0.0, 0.0], 1e6), ([f64::NAN, 0.0], 4.0)] {
            assert!(matches!(over(low, side), Err(Error::Setting { .. })), "{low:?}, {side}");
        }
    }
}
