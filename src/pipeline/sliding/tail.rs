//! A tail: what a slice has of a part beyond what it has in common with the next slice, longer than wide, and how it goes back along itself.
//!
//! `phi(x, t) = phi(x) + P(g) - P(g + t L)`: g is the distance of x along the tail from what both slices have in common, within the part (Eikonal
//! equation), P(g) the depth of the part at this distance, at most `L - g` with the length `L`. So the part's width at g is at time t what it was `t L`
//! farther out: at 0 it is the slice. Its end goes back from `L` to a pixel within what is common; with the distance d to the other slice's contour
//! `phi >= d + 1 - (1 - t) (L + 1)`, so that at 1 nothing is added to the other slice, whose distances are read between pixels.

use glam::DVec2;

use crate::grid::components::{Components, label4, label8};
use crate::grid::field::{FAR, Field, around, bilinear, cell};
use crate::grid::tile::{Tile, samples};
use crate::reference::distance::sweep;

/// Distance from what is common within which a part that shrinks or swells all around is no tail, px. A coil of pitch 12 every 3rd slice has a Dice of .970
/// with it, .962 with half of it; with twice as much the same every 5th slice has 7 false handles for 4.
pub(super) const RIM: f64 = 2.0;
/// Length of a tail's sides beside that of where it begins, at least: with 4 that coil has .954, with 2 a gyroid loses .002.
const LONG: f64 = 3.0;
/// Pixels around a tail at which its values are known, too, so that its contour can be read between pixels.
pub(super) const AROUND: usize = 3;

/// A part of a slice beside another slice, on a tile that holds [`AROUND`] more pixels.
pub(super) struct Beside {
    pub tile: Tile,
    pub h: [f64; 2],
    /// Signed distance to the slice's contour, px.
    pub own: Field,
    /// Signed distance to the other slice's contour where motion brings the pixel, px; of the part's own pixels at least.
    pub other: Vec<f64>,
    /// Whether a pixel is of the part.
    pub part: Vec<bool>,
}

/// A tail.
#[derive(Debug, Clone)]
pub(super) struct Tail {
    pub tile: Tile,
    /// Distance along the tail, px; [`FAR`] where nothing is known.
    along: Vec<f64>,
    /// `phi + P(g)`, px.
    level: Vec<f64>,
    /// Signed distance to the other slice's contour, px.
    other: Vec<f64>,
    /// Depth by distance along the tail, one per px from 0 on.
    depths: Vec<f64>,
    /// Its length, px.
    pub length: f64,
    /// Pixel of the image at which what is common lies beside it.
    pub root: [usize; 2],
    /// Pixel of the image where it ends.
    pub tip: [usize; 2],
    /// Pixels that it has, and those of what is common where it begins.
    pixels: usize,
}

/// Where a piece lies.
#[derive(Clone)]
struct Place {
    low: [usize; 2],
    high: [usize; 2],
    count: usize,
    /// How far its pixels are from the other slice's contour, at most, px.
    farthest: f64,
}

impl Place {
    /// The places of all pieces, by number.
    fn of(pieces: &Components, other: &[f64], nx: usize) -> Vec<Place> {
        let nowhere = Place { low: [usize::MAX; 2], high: [0; 2], count: 0, farthest: 0.0 };
        let mut places = vec![nowhere; pieces.count + 1];
        for (n, label) in pieces.labels.iter().enumerate().filter(|(_, label)| **label > 0) {
            let (at, place) = ([n % nx, n / nx], &mut places[*label as usize]);
            place.low = [0, 1].map(|a| place.low[a].min(at[a]));
            place.high = [0, 1].map(|a| place.high[a].max(at[a]));
            place.count += 1;
            place.farthest = place.farthest.max(other[n]);
        }
        places
    }
}

impl Beside {
    /// Pixels beside a pixel along x and along y.
    fn beside(&self, n: usize) -> [[Option<usize>; 2]; 2] {
        let [nx, ny] = self.tile.dims;
        let (i, j) = (n % nx, n / nx);
        [[(i > 0).then(|| n - 1), (i + 1 < nx).then(|| n + 1)], [(j > 0).then(|| n - nx), (j + 1 < ny).then(|| n + nx)]]
    }

    fn neighbours(&self, n: usize) -> impl Iterator<Item = usize> + use<> {
        self.beside(n).into_iter().flatten().flatten()
    }

    /// The tails of the part that have at least this share of its pixels, together with what is common where they begin. `around` says of a pixel
    /// of the tile that is not the part's how far it is from the other slice's contour: few parts have a piece that asks.
    pub fn tails(&self, share: f64, around: impl Fn(usize) -> f64) -> Vec<Tail> {
        let beyond: Vec<bool> = self.part.iter().zip(&self.other).map(|(part, other)| *part && *other >= 0.0).collect();
        let common: Vec<bool> = self.part.iter().zip(&beyond).map(|(part, beyond)| *part && !beyond).collect();
        let (pieces, held) = (label4(&beyond, self.tile.dims), label8(&common, self.tile.dims));
        let mut areas = vec![0usize; held.count + 1];
        held.labels.iter().for_each(|label| areas[*label as usize] += 1);
        areas[0] = 0;
        let largest = areas.iter().copied().max().unwrap_or(0);
        let pixels = self.part.iter().filter(|part| **part).count();
        let least = share * pixels as f64;
        let places = Place::of(&pieces, &self.other, self.tile.dims[0]);
        let counts = |place: &Place| place.farthest > RIM && (place.count + largest) as f64 >= least;
        let found = (0u32..).zip(&places).filter(|(_, place)| counts(place)).flat_map(|(piece, place)| {
            let margin = samples(AROUND, self.h).map(|n| n + 1);
            let tile = Tile::spanning(self.tile.dims, margin, place.low, place.high);
            let nodes: Vec<usize> = tile.nodes(self.tile.dims[0]).collect();
            let piece = nodes.iter().map(|n| pieces.labels[*n] == piece).collect();
            let held: Vec<u32> = nodes.iter().map(|n| held.labels[*n]).collect();
            self.cut(tile, &around).tails_of(piece, &held, &areas)
        });
        found.filter(|tail| tail.pixels as f64 >= least).collect()
    }

    /// The part on a tile of its own tile, with the other slice's distances at all its pixels.
    fn cut(&self, tile: Tile, around: impl Fn(usize) -> f64) -> Beside {
        let nx = self.tile.dims[0];
        let other = |n: usize| if self.part[n] { self.other[n] } else { around(n) };
        Beside {
            tile: tile.placed(self.tile),
            h: self.h,
            own: tile.cut(&self.own),
            other: tile.nodes(nx).map(other).collect(),
            part: tile.map(&self.part, nx, |part| *part),
        }
    }

    /// The tails of a piece beyond what is common, whose parts are `held` and have these areas: where it lies between two of those, from the larger one.
    fn tails_of(&self, piece: Vec<bool>, held: &[u32], areas: &[usize]) -> Vec<Tail> {
        let area = |n: usize| areas[held[n] as usize];
        let nodes = 0..self.part.len();
        let beside = nodes.clone().filter(|n| held[*n] > 0 && self.neighbours(*n).any(|m| piece[m]));
        let beside: Vec<usize> = beside.collect();
        let largest = beside.iter().map(|n| area(*n)).max();
        let mut along = Field::filled(self.tile.dims, FAR);
        for n in beside.into_iter().filter(|n| Some(area(*n)) == largest) {
            along.data[n] = self.other[n].max(-1.0);
        }
        let fixed: Vec<bool> = piece.iter().map(|piece| !piece).collect();
        sweep(&mut along, &fixed, self.h);
        let along = along.data;
        let far: Vec<bool> = nodes.map(|n| piece[n] && along[n] > RIM && along[n] < FAR).collect();
        let ends = label4(&far, self.tile.dims);
        let tail = |end: u32| {
            let own: Vec<usize> = (0..far.len()).filter(|n| ends.labels[*n] == end).collect();
            self.begins_once(&own, &far).then(|| self.tail(&along, &own, held, areas)).flatten()
        };
        (1..=ends.count as u32).filter_map(tail).collect()
    }

    /// Whether these pixels, of those that are `far` from what is common, are longer than wide and begin in one place.
    fn begins_once(&self, own: &[usize], far: &[bool]) -> bool {
        let (mut sides, mut begin) = (0.0, 0.0);
        let mut face = vec![false; far.len()];
        for &n in own {
            for (a, pair) in self.beside(n).into_iter().enumerate() {
                for m in pair.into_iter().flatten().filter(|m| !far[*m]) {
                    if self.part[m] && self.other[m] >= 0.0 {
                        begin += self.h[1 - a];
                        face[n] = true;
                    } else if self.other[m] >= 0.0 {
                        sides += self.h[1 - a];
                    }
                }
            }
        }
        sides >= LONG * begin && label8(&face, self.tile.dims).count == 1
    }

    /// The tail of these pixels.
    fn tail(&self, along: &[f64], own: &[usize], held: &[u32], areas: &[usize]) -> Option<Tail> {
        let tip = own.iter().copied().max_by(|a, b| along[*a].total_cmp(&along[*b]))?;
        let length = along[tip] - self.own.data[tip];
        let mut root = tip;
        while held[root] == 0 {
            let nearer = self.neighbours(root).min_by(|a, b| along[*a].total_cmp(&along[*b]))?;
            if along[nearer] >= along[root] {
                return None;
            }
            root = nearer;
        }
        let pixels = own.len() + areas[held[root] as usize];
        let along = self.known(along, own);
        let depths = self.depths(&along, length);
        let [nx, _] = self.tile.dims;
        let [root, tip] = [root, tip].map(|n| [n % nx + self.tile.origin[0], n / nx + self.tile.origin[1]]);
        let (level, other) = (Vec::new(), self.other.clone());
        let mut tail = Tail { tile: self.tile, along, level, other, depths, length, root, tip, pixels };
        tail.level = self.own.data.iter().zip(&tail.along).map(|(phi, g)| phi + tail.depth(*g)).collect();
        Some(tail)
    }

    /// Distances along a tail of these pixels, and at those around it, the mean of their neighbours' where none is known.
    fn known(&self, along: &[f64], own: &[usize]) -> Vec<f64> {
        let mut known = vec![FAR; along.len()];
        own.iter().for_each(|n| known[*n] = along[*n]);
        let mut edge = own.to_vec();
        for _ in 0..AROUND {
            let mut next: Vec<usize> =
                edge.iter().flat_map(|n| around(*n, self.tile.dims)).filter(|n| known[*n] >= FAR).collect();
            next.sort_unstable();
            next.dedup();
            let mean = |n: &usize| {
                if along[*n] < FAR {
                    return along[*n];
                }
                let there = around(*n, self.tile.dims).map(|m| known[m]).filter(|v| *v < FAR);
                let (sum, count) = there.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
                sum / count
            };
            let values: Vec<f64> = next.iter().map(mean).collect();
            next.iter().zip(values).for_each(|(n, v)| known[*n] = v);
            edge = next;
        }
        known
    }

    /// Depth of the part by distance along a tail.
    fn depths(&self, along: &[f64], length: f64) -> Vec<f64> {
        let mut deepest = vec![0.0f64; length.ceil() as usize + 2];
        for (g, phi) in along.iter().zip(&self.own.data).filter(|(g, phi)| **g < FAR && **phi < 0.0) {
            let k = (g.max(0.0).round() as usize).min(deepest.len() - 1);
            deepest[k] = deepest[k].max(-phi);
        }
        for k in (0..deepest.len() - 1).rev() {
            if deepest[k] == 0.0 {
                deepest[k] = deepest[k + 1];
            }
        }
        let last = deepest.len() - 1;
        let mean = |k: usize| 0.25 * (deepest[k.saturating_sub(1)] + 2.0 * deepest[k] + deepest[(k + 1).min(last)]);
        (0..=last).map(mean).collect()
    }
}

impl Tail {
    /// `P(g)`.
    fn depth(&self, g: f64) -> f64 {
        let k = (g.max(0.0) as usize).min(self.depths.len() - 2);
        let depth = self.depths[k] + (g.max(0.0) - k as f64).min(1.0) * (self.depths[k + 1] - self.depths[k]);
        depth.min(self.length - g)
    }

    /// Values at the tile's pixels at time `t` from its slice on; [`FAR`] where nothing is known.
    pub fn at(&self, t: f64) -> Field {
        let value = |((g, level), other): ((&f64, &f64), &f64)| match *g < FAR {
            true => (level - self.depth(g + t * self.length)).max(other + 1.0 - (1.0 - t) * (self.length + 1.0)),
            false => FAR,
        };
        Field { dims: self.tile.dims, data: self.along.iter().zip(&self.level).zip(&self.other).map(value).collect() }
    }
}

/// Value of [`Tail::at`] at a position of the tile; [`FAR`] beside what is known.
pub(super) fn read(values: &Field, x: DVec2) -> f64 {
    let [nx, ny] = values.dims;
    if x.min_element() < 0.0 || x.x > (nx - 1) as f64 || x.y > (ny - 1) as f64 {
        return FAR;
    }
    let ([i, j], place) = cell(values.dims, x, 0);
    let n = j * nx + i;
    let corners = [n, n + 1, n + nx, n + nx + 1].map(|n| values.data[n]);
    if corners.iter().any(|v| *v >= FAR) { FAR } else { bilinear(corners, place) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar from column 3 on that tapers to its end, of which another slice has what lies before `to`.
    fn tapering(to: f64) -> Beside {
        let dims = [48, 24];
        let own = Field::from_fn(dims, |i, j| {
            let [x, y] = [i as f64, j as f64 - 11.5];
            (y.abs() - 5.0 + 0.1 * x).max(3.0 - x).max(x - 40.3)
        });
        let other: Vec<f64> = (0..dims[0] * dims[1]).map(|n| own.data[n].max((n % dims[0]) as f64 - to)).collect();
        let part = own.data.iter().map(|v| *v < 0.0).collect();
        Beside { tile: Tile::all(dims), h: [1.0; 2], own, other, part }
    }

    #[test]
    fn a_tail_is_the_slice_at_first_and_nothing_but_what_is_common_at_last() {
        for to in [14.01, 14.5, 14.99] {
            let beside = tapering(to);
            let tails = beside.tails(0.8, |n| beside.other[n]);
            let [tail] = tails.as_slice() else { panic!("one tail, not {}", tails.len()) };
            assert!((tail.length - (40.3 - to)).abs() < 0.5, "{}", tail.length);
            let [first, last] = [0.0, 1.0].map(|t| tail.at(t));
            for (n, m) in tail.tile.nodes(beside.tile.dims[0]).enumerate().filter(|(n, _)| tail.along[*n] < FAR) {
                let (own, other) = (beside.own.data[m], beside.other[m]);
                if tail.along[n] > 0.0 {
                    assert!((first.data[n] - own).abs() < 1e-9, "{to} {m}: {} for {own}", first.data[n]);
                }
                assert!(last.data[n] >= other + 1.0, "{to} {m}: {} where the other slice has {other}", last.data[n]);
            }
        }
    }

    #[test]
    fn a_tail_goes_back_along_itself_at_a_constant_rate() {
        let beside = tapering(14.5);
        let tails = beside.tails(0.8, |n| beside.other[n]);
        let end = |t: f64| {
            let phi = tails[0].at(t);
            let row = (11 - tails[0].tile.origin[1]) * phi.dims[0];
            (0..phi.dims[0]).rev().find(|i| phi.data[row + i] < 0.0).map(|i| (i + tails[0].tile.origin[0]) as f64)
        };
        for t in [0.25, 0.5, 0.75] {
            let wanted = 14.5 + (1.0 - t) * tails[0].length;
            // The last pixel inside lies less than a pixel before the end, which is round.
            let is_near = |end: f64| (-0.5..2.0).contains(&(wanted - end));
            assert!(end(t).is_some_and(is_near), "{t}: {:?} for {wanted}", end(t));
        }
    }
}
