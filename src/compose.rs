//! The compose stage: sweeps of both directions blended, holes and lone parts put back, layers of the volume filled.

use std::ops::Range;

use crate::caps::Cap;
use crate::field::Field;
use crate::fit::Fitted;
use crate::jobs::{Direction, SweepPair, disagreement};
use crate::lone_part::{HALF_WAY, LonePart};
use crate::matching::Interval;
use crate::packed::Packed;
use crate::stack::SliceContent;
use crate::tile::Tile;

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

/// Two sweeps of a group at the same time, `weights[0] up + weights[1] down`, neither deeper than the other by more than [`disagreement`].
pub fn blend(up: &Packed<f32>, down: &Packed<f32>, weights: [f64; 2]) -> Field {
    let allowed = weights.map(disagreement);
    let mixed = |(&a, &b): (&f32, &f32)| {
        let (a, b) = (f64::from(a), f64::from(b));
        let limits = allowed.map(|more| a.abs().min(b.abs()) + more);
        weights[0] * a.clamp(-limits[0], limits[0]) + weights[1] * b.clamp(-limits[1], limits[1])
    };
    let [nx, ny] = up.dims();
    let mut phi = Field { dims: [nx, ny], data: Vec::with_capacity(nx * ny) };
    let mut rows = [vec![0.0; nx], vec![0.0; nx]];
    for j in 0..ny {
        rows.iter_mut().zip([up, down]).for_each(|(row, sweep)| sweep.read(0, j, row));
        phi.data.extend(rows[0].iter().zip(&rows[1]).map(mixed));
    }
    phi
}

/// Puts back what the blend of slice `k` has lost: holes are cut out again, overlaps of the two contours are joined. Whether anything changed.
pub fn mend(pair: &SweepPair<'_>, k: usize, phi: &mut Field) -> bool {
    let t = pair.up.times[k];
    for (cap, direction) in pair.holes.iter() {
        let away = match direction {
            Direction::Up => t,
            Direction::Down => 1.0 - t,
        };
        let offset = cap.offset(away);
        for (v, hole) in phi.data.iter_mut().zip(&cap.field.data) {
            *v = v.max(-(hole + offset));
        }
    }
    let mut changed = !pair.holes.is_empty();
    for &anchor in &pair.anchors {
        if phi.data[anchor] >= 0.0 {
            hold(phi, pair, anchor);
            changed = true;
        }
    }
    changed
}

/// Puts the overlap of the two contours around `anchor` back where the blend has lost it, so that what overlaps is connected.
fn hold(phi: &mut Field, pair: &SweepPair<'_>, anchor: usize) {
    let overlap = |n: usize| pair.up.source.data[n].max(pair.up.target.data[n]);
    let [nx, ny] = phi.dims;
    let mut seen = vec![false; phi.data.len()];
    let mut open = vec![anchor];
    while let Some(node) = open.pop() {
        if std::mem::replace(&mut seen[node], true) || overlap(node) >= 0.0 {
            continue;
        }
        phi.data[node] = phi.data[node].min(overlap(node));
        let (i, j) = (node % nx, node / nx);
        open.extend((i > 0).then(|| node - 1));
        open.extend((i + 1 < nx).then_some(node + 1));
        open.extend((j > 0).then(|| node - nx));
        open.extend((j + 1 < ny).then_some(node + nx));
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
