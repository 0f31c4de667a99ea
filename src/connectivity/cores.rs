//! No tearing: what two neighbouring contours have in common keeps its core at every height between them.
//!
//! `phi <- min(phi, max(A, B) + D / 2)` with the distances A and B of the two contours, in the image's own frame: within a connected part O of
//! `{max(A, B) < 0}`, of depth D, its inner half stays inside, a column that joins both contours. It lies inside both, so that a layer beside
//! either keeps its contour, and depends on nothing but the two: neither on labels nor on the other layers. Beyond O the distance is that to
//! the nearest core, as far as it is smaller.

use std::ops::Range;

use rayon::prelude::*;

use crate::contour::Contour;
use crate::grid::components::label4;
use crate::grid::field::around;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::{Tile, to_rectangle};
use crate::grid::union::unite_packed;
use crate::surface::Layer;

/// Share of an overlap's depth by which its core lies within it. The core must neither vanish (1: a point between pixels) nor reach the contours
/// (0), where it would make a ledge.
const WITHIN: f64 = 0.5;
/// Share of the gap over which a core is drawn in: at a contour it is the overlap itself, or what moves fast would stop there all at once. Layers that
/// are looked at beside contours ([`BESIDE`](crate::stack::heights::BESIDE)) lie well within it, all nodes beyond.
const BEGINS: f64 = 1.0 / 64.0;

/// The image that layers show: its pixels, where it lies on the padded image on which contours are, and how far distances go.
#[derive(Debug, Clone)]
pub struct OutputImage {
    /// Pixels.
    pub dims: [usize; 2],
    /// Padding of the padded image.
    pub pad: [usize; 2],
    /// Size of a pixel in units of its larger side.
    pub h: [f64; 2],
    /// Distances are clamped to this, px.
    pub limit: f64,
    /// Columns and rows of it beyond whose edges all of a layer is outside; no such edges if nothing.
    pub seen: Option<[Range<isize>; 2]>,
}

/// The cores of all overlaps of an interval.
#[derive(Debug)]
pub struct Cores {
    /// Tile on which they are, on the image that layers show.
    tile: Tile,
    /// Distances, px.
    phi: SparseImage<f32>,
    /// What they are drawn in by, px.
    drawn_in: SparseImage<f32>,
    /// Heights of the two contours.
    z: [f64; 2],
    /// Distances are clamped to this, px.
    limit: f32,
}

impl Cores {
    /// Tile on which overlaps of two contours can be, by what is known of them without their fields; nothing where there is none.
    pub fn tile(low: &Contour, high: &Contour, shown: &OutputImage) -> Option<Tile> {
        let [low, high] = [low, high].map(bounds);
        let ((low_from, low_to), (high_from, high_to)) = (low?, high?);
        let from = [0, 1].map(|a| low_from[a].max(high_from[a]));
        let to = [0, 1].map(|a| low_to[a].min(high_to[a]));
        if (0..2).any(|a| from[a] > to[a]) {
            return None;
        }
        let reach = shown.h.map(|h| (shown.limit / h).ceil() as usize);
        let origin = [0, 1].map(|a| (from[a] - shown.pad[a]).saturating_sub(reach[a]));
        let dims = [0, 1].map(|a| (to[a] - shown.pad[a] + reach[a] + 1).min(shown.dims[a]) - origin[a]);
        Some(Tile { origin, dims })
    }

    /// The cores of two neighbouring contours, but of the pairs of parts that are kept apart; nothing where nothing overlaps.
    pub fn new(low: &Contour, high: &Contour, parted: &[(u32, u32)], shown: &OutputImage) -> Option<Self> {
        let tile = Cores::tile(low, high, shown)?;
        let width = low.phi.dims[0];
        let node = |n: usize| {
            let [i, j] = [n % tile.dims[0] + tile.origin[0], n / tile.dims[0] + tile.origin[1]];
            (j + shown.pad[1]) * width + i + shown.pad[0]
        };
        // A core beyond the border would join nothing that is seen.
        let edge = |n: usize| {
            let at = [n % tile.dims[0] + tile.origin[0], n / tile.dims[0] + tile.origin[1]];
            shown.seen.as_ref().map_or(f32::NEG_INFINITY, |seen| to_rectangle(seen, shown.h, at) as f32)
        };
        let apart = |n: usize| !parted.is_empty() && parted.contains(&(low.solids.labels[n], high.solids.labels[n]));
        let limit = shown.limit as f32;
        // What is kept apart counts as far outside.
        let both = |n: usize| if apart(n) { limit } else { low.phi.data[n].max(high.phi.data[n]) as f32 };
        let common: Vec<f32> = (0..tile.len()).into_par_iter().map(|n| both(node(n)).max(edge(n))).collect();
        let inside: Vec<bool> = common.par_iter().map(|v| *v < 0.0).collect();
        let overlaps = label4(&inside, tile.dims);
        if overlaps.count == 0 {
            return None;
        }
        let mut depths = vec![0.0f32; overlaps.count + 1];
        for (label, v) in overlaps.labels.iter().zip(&common) {
            depths[*label as usize] = depths[*label as usize].max(-v);
        }
        let raised = |n: usize, depth: f32| common[n] + WITHIN as f32 * depth;
        let own = |label: &u32| if *label > 0 { depths[*label as usize] } else { f32::INFINITY };
        let begin = overlaps.labels.par_iter().map(own).collect();
        let depth = nearest(begin, tile.dims, |n, depth| raised(n, depth) < limit);
        let core = |(n, depth): (usize, &f32)| raised(n, *depth).clamp(-limit, limit);
        let phi: Vec<f32> = depth.par_iter().enumerate().map(core).collect();
        let by: Vec<f32> = depth.par_iter().map(|d| if d.is_finite() { WITHIN as f32 * d } else { 0.0 }).collect();
        let [phi, drawn_in] = [phi, by].map(|values| SparseImage::of(tile.dims, &values));
        Some(Cores { tile, phi, drawn_in, z: [low.z, high.z], limit })
    }

    /// The cores drawn in by this share of what they are.
    fn begun(&self, share: f32) -> SparseImage<f32> {
        let [phi] = SparseImage::of_squares(self.tile.dims, |square, [out]| {
            if let Some(v) = self.phi.whole(square).filter(|v| *v >= self.limit) {
                return [Some(v)];
            }
            let pixels = self.phi.square(square).iter().zip(self.drawn_in.square(square));
            for (out, (v, by)) in out.iter_mut().zip(pixels) {
                *out = if *v < self.limit { (v - (1.0 - share) * by).max(-self.limit) } else { *v };
            }
            [None]
        });
        phi
    }

    /// Keeps the cores inside a layer between the two contours; `px` is the length of a pixel's larger side.
    pub fn keep(&self, layer: &mut Layer, px: f64) {
        let px = px as f32;
        let Tile { origin, dims } = self.tile;
        let covered = [0, 1].map(|a| origin[a]..origin[a] + dims[a]);
        let offset = origin.map(|n| -(n as isize));
        let [low, high] = self.z;
        let share = (layer.z - low).min(high - layer.z) / (BEGINS * (high - low));
        let begun = (share < 1.0).then(|| self.begun(share.max(0.0) as f32));
        unite_packed(&mut layer.phi, covered, offset, begun.as_ref().unwrap_or(&self.phi), |v| {
            if v * px == 0.0 { f32::MIN_POSITIVE } else { v * px }
        });
    }
}

/// Bounding box of all parts of a contour.
fn bounds(contour: &Contour) -> Option<([usize; 2], [usize; 2])> {
    let boxes = contour.solid_box.iter().skip(1).copied();
    boxes.reduce(|(a, b), (c, d)| ([0, 1].map(|k| a[k].min(c[k])), [0, 1].map(|k| b[k].max(d[k]))))
}

/// To pixels that have no finite value that of the nearest that has one, counted in steps over edges and corners, as far as `goes` says; the
/// least of several equally near, so that a turned image is treated alike.
fn nearest(mut values: Vec<f32>, dims: [usize; 2], goes: impl Fn(usize, f32) -> bool) -> Vec<f32> {
    let around = |n: usize| around(n, dims);
    let mut done: Vec<bool> = values.par_iter().map(|v| v.is_finite()).collect();
    let edge = |&n: &usize| done[n] && around(n).any(|m| !done[m]);
    let mut front: Vec<usize> = (0..values.len()).into_par_iter().filter(edge).collect();
    while !front.is_empty() {
        let mut next = Vec::new();
        for n in front {
            for m in around(n).filter(|&m| !done[m]) {
                if values[m].is_infinite() {
                    next.push(m);
                }
                values[m] = values[m].min(values[n]);
            }
        }
        next.iter().for_each(|&n| done[n] = true);
        next.retain(|&n| goes(n, values[n]));
        front = next;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    const SHOWN: OutputImage = OutputImage { dims: [60, 50], pad: [4, 6], h: [1.0, 1.0], limit: 3.0, seen: None };

    fn disc(middle: [f64; 2], radius: f64) -> Contour {
        let dims = [SHOWN.dims[0] + 8, SHOWN.dims[1] + 12];
        let phi = |i: usize, j: usize| (i as f64 - middle[0]).hypot(j as f64 - middle[1]) - radius;
        Contour::with_seeds(0.0, Field::from_fn(dims, phi), Vec::new())
    }

    #[test]
    fn a_core_is_the_overlap_at_a_contour_and_half_of_it_from_a_sixty_fourth_of_the_gap_on() {
        let (low, mut high) = (disc([24.0, 26.0], 8.0), disc([31.0, 26.0], 8.0));
        high.z = 2.0;
        let cores = Cores::new(&low, &high, &[], &SHOWN).expect("they overlap");
        // A pixel where the overlap is deepest, 4 px, and one of its rim.
        let at = |t: f64| {
            let phi = SparseImage::filled(SHOWN.dims, SHOWN.limit as f32);
            let mut layer = Layer { z: 2.0 * t, phi, output: true, contour: None };
            cores.keep(&mut layer, 1.0);
            [27, 24].map(|column| layer.phi.at(column - SHOWN.pad[0], 26 - SHOWN.pad[1]))
        };
        let close = |a: [f32; 2], b: [f32; 2]| assert!((0..2).all(|k| (a[k] - b[k]).abs() < 1e-5), "{a:?}, not {b:?}");
        let depth = 4.0;
        for (t, share) in [(1e-9, 0.0), (1.0 / 256.0, 0.25), (1.0 / 64.0, 1.0), (0.5, 1.0)] {
            for t in [t, 1.0 - t] {
                close(at(t), [-4.0, -1.0].map(|v: f32| (v + 0.5 * depth * share).clamp(-3.0, 3.0)));
            }
        }
    }

    #[test]
    fn the_tile_of_cores_is_that_of_both_boxes_and_the_limit_around_it() {
        let [low, high, far] = [([24.2, 26.1], 8.0), ([36.4, 28.3], 9.0), ([60.0, 20.0], 5.0)]
            .map(|(middle, radius)| disc(middle, radius));
        // Columns 28 to 32 and rows 20 to 34 of the padded image have both.
        let tile = Tile { origin: [28 - 4 - 3, 20 - 6 - 3], dims: [5 + 6, 15 + 6] };
        assert_eq!(Cores::tile(&low, &high, &SHOWN), Some(tile));
        assert_eq!(Cores::tile(&high, &low, &SHOWN), Some(tile));
        assert_eq!(Cores::tile(&low, &far, &SHOWN), None);
        // Where pixels are short there are more of them, but none beyond the image.
        let fine = OutputImage { h: [0.5, 1.0], ..SHOWN };
        assert_eq!(Cores::tile(&low, &high, &fine).map(|t| (t.origin[0], t.dims[0])), Some((28 - 4 - 6, 5 + 12)));
        let edge = disc([60.0, 52.0], 9.0);
        let tile = Cores::tile(&edge, &edge, &SHOWN).expect("a tile");
        assert_eq!([0, 1].map(|a| tile.origin[a] + tile.dims[a]), SHOWN.dims);
    }
}
