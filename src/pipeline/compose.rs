//! The compose stage: sweeps of both directions blended, holes and lone parts put back, layers of the volume filled.

use std::ops::Range;

use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::contour::unmatched::{HALF_WAY, LonePart};
use crate::grid::field::Field;
use crate::grid::tile::Tile;
use crate::grid::tiled::Packed;
use crate::pipeline::fit::Fitted;
use crate::pipeline::matching::Interval;
use crate::stack::SliceContent;

/// Pixels of a slice that are read at once.
const PIXELS_READ: usize = 4096;

/// A layer being filled: the unpadded image, px, positive outside.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// Pixels of the image.
    pub dims: [usize; 2],
    /// Padding of the padded image that tiles live on, pixels along either axis.
    pub pad: [usize; 2],
    /// Distances are clamped to this, px.
    pub limit: f64,
    /// Signed distance, px.
    pub phi: Vec<f32>,
}

impl Canvas {
    /// A layer with nothing on it.
    pub fn empty(dims: [usize; 2], pad: [usize; 2], limit: f64) -> Self {
        Canvas { dims, pad, limit, phi: vec![limit as f32; dims[0] * dims[1]] }
    }

    /// Unites the layer with a body on a tile: the smaller distance counts.
    pub fn unite(&mut self, tile: &Tile, mut value: impl FnMut(usize) -> f64) {
        let limit = self.limit;
        let mut phi = std::mem::take(&mut self.phi);
        self.visit(tile, |pixel, node| {
            let v = value(node).clamp(-limit, limit) as f32;
            phi[pixel] = phi[pixel].min(v);
        });
        self.phi = phi;
    }

    /// The same with a body that is there.
    pub fn unite_packed(&mut self, tile: &Tile, body: &Packed<f32>) {
        let (limit, [nx, _]) = (self.limit, self.dims);
        let [columns, rows] = self.shared(tile);
        let mut values = vec![0.0; columns.len()];
        for j in rows {
            body.read(columns.start - tile.origin[0], j - tile.origin[1], &mut values);
            let row = &mut self.phi[(j - self.pad[1]) * nx + columns.start - self.pad[0]..];
            for (phi, v) in row.iter_mut().zip(&values) {
                *phi = phi.min(f64::from(*v).clamp(-limit, limit) as f32);
            }
        }
    }

    /// Columns and rows of the padded image that a tile and the image share.
    fn shared(&self, tile: &Tile) -> [Range<usize>; 2] {
        std::array::from_fn(|a| {
            let end = (self.pad[a] + self.dims[a]).min(tile.origin[a] + tile.dims[a]);
            let start = self.pad[a].max(tile.origin[a]);
            start..end.max(start)
        })
    }

    /// Goes over what a tile and the image share: the image's pixel and the tile's node.
    pub fn visit(&self, tile: &Tile, mut each: impl FnMut(usize, usize)) {
        let [nx, _] = self.dims;
        let [columns, rows] = self.shared(tile);
        for j in rows {
            let (from, to) = ((j - tile.origin[1]) * tile.dims[0], (j - self.pad[1]) * nx);
            for i in columns.clone() {
                each(to + i - self.pad[0], from + i - tile.origin[0]);
            }
        }
    }

    /// A layer that is an input contour.
    pub fn of_contour(dims: [usize; 2], pad: [usize; 2], limit: f64, contour: &Field) -> Self {
        let mut canvas = Canvas::empty(dims, pad, limit);
        let whole = Tile { origin: [0, 0], dims: contour.dims };
        canvas.unite(&whole, |n| contour.data[n]);
        canvas
    }
}

/// Caps of an interval's holes, group by group, and of its lone solid parts.
#[derive(Debug, Clone, Default)]
pub struct IntervalCaps {
    /// Per group.
    pub holes: Vec<Vec<(Cap, Direction)>>,
    /// Solid parts.
    pub solids: Vec<(Cap, Direction)>,
}

impl IntervalCaps {
    /// Profiles from the slopes of each part's own contour; `gap` is the interval's height; solid parts close by
    /// themselves, or at `latest`; distances count up to `farthest`.
    pub fn new(interval: &Interval, [low, high]: [&Fitted; 2], gap: f64, latest: f64, farthest: f64) -> Self {
        let cap = |part: &LonePart, outward: f64, height: f64| {
            let (fitted, sign) = match part.direction {
                Direction::Up => (low, 1.0),
                Direction::Down => (high, -1.0),
            };
            let mean = mean_slope(fitted, &part.seeds) * sign * outward * gap;
            (Cap::new(part, mean, height, farthest), part.direction)
        };
        IntervalCaps {
            holes: interval.groups.iter().map(|g| g.holes.iter().map(|h| cap(h, -1.0, HALF_WAY)).collect()).collect(),
            solids: interval.lone.iter().map(|p| cap(p, 1.0, p.closes.min(latest))).collect(),
        }
    }
}

/// Mean slope of some seeds, 0 where there are none.
pub fn mean_slope(fitted: &Fitted, seeds: &[u32]) -> f64 {
    let sum: f64 = seeds.iter().map(|&k| fitted.slopes[k as usize]).sum();
    sum / seeds.len().max(1) as f64
}

/// Unites a layer with a cap, `away` from the cap's contour.
pub fn unite_cap(canvas: &mut Canvas, cap: &Cap, away: f64) {
    let offset = cap.offset(away);
    canvas.unite(&cap.tile, |n| cap.field.data[n] + offset);
}

/// Pixels of a layer whose side differs from what the slice says.
pub fn differing_pixels(phi: &[f32], slice: &SliceContent) -> usize {
    let mut inside = [false; PIXELS_READ];
    let differing = |(first, some): (usize, &[f32])| {
        let inside = &mut inside[..some.len()];
        slice.read(first, inside);
        some.iter().zip(&*inside).filter(|(v, inside)| (**v < 0.0) != **inside).count()
    };
    (0..).step_by(PIXELS_READ).zip(phi.chunks(PIXELS_READ)).map(differing).sum()
}
