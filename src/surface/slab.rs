//! Two neighbouring layers, and the cells between them that the surface crosses.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Layer;
use super::areas::OF_A_THREAD;
use super::cases::{AMBIGUOUS, FACES};
use crate::grid::sparse_image::{SQUARE, SparseImage};

/// Vertices stay this far, in cell sides, from the corners of their cells: vertices of different edges stay apart in f32 too, near an
/// [origin](super::local), so that a reader that merges equal positions (STL) finds the same closed surface.
pub(super) const OFF_CORNER: f64 = 1e-3;

/// A layer, or the outside below the first and above the last.
#[derive(Debug, Default)]
struct Plane {
    z: Option<f64>,
    phi: SparseImage<f32>,
}

/// A cell that the surface crosses.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// Its column.
    pub column: u32,
    /// Bit c is set where corner c is inside.
    pub pattern: u8,
}

/// Cells of a row that has some.
#[derive(Debug)]
pub struct Row {
    /// Its number.
    pub number: usize,
    /// Its cells, from left to right.
    pub cells: Vec<Cell>,
}

/// Nodes whose sides are in one word.
const WORD: usize = u64::BITS as usize;

/// Two neighbouring layers.
#[derive(Debug)]
pub struct Slab {
    /// Pixels per layer.
    image: [usize; 2],
    spacing: [f64; 2],
    /// Nodes per padded row and number of rows: one ring of outside around the image.
    pub dims: [usize; 2],
    planes: [Plane; 2],
    /// Sides of their nodes, rows of whole words: a bit is set inside.
    inside: [Vec<u64>; 2],
}

impl Slab {
    /// The outside below the first layer of an image of these pixels.
    pub fn new(image: [usize; 2], spacing: [f64; 2]) -> Self {
        let dims = image.map(|n| n + 2);
        let outside = || vec![0; dims[0].div_ceil(WORD) * dims[1]];
        Slab { image, spacing, dims, planes: Default::default(), inside: [outside(), outside()] }
    }

    /// Words of a padded row.
    fn words(&self) -> usize {
        self.dims[0].div_ceil(WORD)
    }

    /// Goes up to the next layer, or to the outside above the last.
    pub fn rise(&mut self, layer: Option<&Layer>) {
        self.planes.swap(0, 1);
        self.inside.swap(0, 1);
        let (words, plane, inside) = (self.words(), &mut self.planes[1], &mut self.inside[1]);
        let Some(layer) = layer else {
            *plane = Plane::default();
            inside.fill(0);
            return;
        };
        (plane.z, plane.phi) = (Some(layer.z), layer.phi.clone());
        let phi = &plane.phi;
        let rows = &mut inside[words..words * (self.image[1] + 1)];
        let fill = |(row, nodes): (usize, &mut [u64])| fill(phi, row, nodes, words);
        match self.image[0] * self.image[1] < OF_A_THREAD {
            true => rows.chunks_mut(SQUARE * words).enumerate().for_each(fill),
            false => rows.par_chunks_mut(SQUARE * words).enumerate().for_each(fill),
        }
    }

    /// Whether its upper plane is a layer.
    pub fn has_top(&self) -> bool {
        self.planes[1].z.is_some()
    }

    /// Rows of cells.
    pub fn rows(&self) -> usize {
        self.dims[1] - 1
    }

    /// Some rows of cells, but those that the surface does not cross.
    pub fn cells(&self, rows: Range<usize>) -> impl Iterator<Item = Row> {
        rows.filter_map(|number| {
            let cells = self.crossed(number);
            (!cells.is_empty()).then_some(Row { number, cells })
        })
    }

    /// Cells of row `j` that the surface crosses: those whose corners are not all on one side.
    fn crossed(&self, j: usize) -> Vec<Cell> {
        let words = self.words();
        // In the order of a cell's corners.
        let edges = [(0, j), (0, j + 1), (1, j), (1, j + 1)];
        let edges = edges.map(|(side, row)| &self.inside[side][row * words..(row + 1) * words]);
        let all_of = |w: usize| edges.iter().fold(u64::MAX, |all, row| all & row[w]);
        let any_of = |w: usize| edges.iter().fold(0, |any, row| any | row[w]);
        let mut cells = Vec::new();
        for w in 0..words {
            let next = |of: &dyn Fn(usize) -> u64| if w + 1 < words { of(w + 1) << (WORD - 1) } else { 0 };
            let (all, any) = (all_of(w), any_of(w));
            let mut crossed = (any | any >> 1 | next(&any_of)) & !(all & (all >> 1 | next(&all_of)));
            while crossed != 0 {
                let i = w * WORD + crossed.trailing_zeros() as usize;
                let at = |row: &[u64], i: usize| (row[i / WORD] >> (i % WORD) & 1) as u8;
                let corners = |i: usize| edges.iter().rev().fold(0, |bits, row| bits << 2 | at(row, i));
                // Never the last node: with what is beyond it lies outside.
                cells.push(Cell { column: i as u32, pattern: corners(i) | corners(i + 1) << 1 });
                crossed &= crossed - 1;
            }
        }
        cells
    }

    /// Ambiguous faces of a cell whose inside corners are joined: the mean of the four values is inside. It is the same seen from either side. At
    /// the border of the image and beyond the ends there are no values, and nothing is joined.
    pub fn joined(&self, i: usize, j: usize, pattern: u8) -> u8 {
        let ambiguous = AMBIGUOUS[usize::from(pattern)];
        let value = |corner: usize| {
            let at = [i + (corner & 1), j + (corner >> 1 & 1)];
            self.value(corner >> 2, at).map(f64::from)
        };
        let is_joined = |face: &[usize; 4]| match face.map(value) {
            [Some(a), Some(b), Some(c), Some(d)] => (a + c) + (b + d) < 0.0,
            _ => false,
        };
        let faces = FACES.iter().enumerate().filter(|(f, _)| ambiguous >> f & 1 == 1);
        faces.map(|(f, face)| u8::from(is_joined(face)) << f).sum()
    }

    /// Place in the stack at which the surface crosses the edge that goes along `axis` from a node of one of the two planes.
    pub fn crossing(&self, at: [usize; 2], side: usize, axis: u8) -> DVec3 {
        let [dx, dy] = self.spacing;
        let [mut x, mut y] = [(at[0] as f64 - 1.0) * dx, (at[1] as f64 - 1.0) * dy];
        let share = |a: Option<f32>, b: Option<f32>| match (a, b) {
            (Some(a), Some(b)) => {
                let t = f64::from(a) / (f64::from(a) - f64::from(b));
                if t.is_finite() { t.clamp(OFF_CORNER, 1.0 - OFF_CORNER) } else { 0.5 }
            }
            _ => 0.5,
        };
        let [below, above] = [0, 1].map(|side| self.planes[side].z);
        let own = if side == 0 { below } else { above };
        let z = match axis {
            0 => {
                x += dx * share(self.value(side, at), self.value(side, [at[0] + 1, at[1]]));
                own
            }
            1 => {
                y += dy * share(self.value(side, at), self.value(side, [at[0], at[1] + 1]));
                own
            }
            _ => match (below, above) {
                (Some(low), Some(high)) => Some(low + (high - low) * share(self.value(0, at), self.value(1, at))),
                _ => below.or(above), // a lid
            },
        };
        // On one of both sides there is a layer.
        DVec3::new(x, y, z.unwrap_or_default())
    }

    /// phi at a padded node, `None` beyond the image.
    fn value(&self, side: usize, [i, j]: [usize; 2]) -> Option<f32> {
        let [nx, ny] = self.image;
        let (i, j) = (i.checked_sub(1)?, j.checked_sub(1)?);
        (i < nx && j < ny).then(|| self.planes[side].phi.at(i, j))
    }
}

/// Sets the bits of the nodes inside in a row of squares of a layer, whose nodes begin a bit behind its pixels.
fn fill(phi: &SparseImage<f32>, row: usize, nodes: &mut [u64], words: usize) {
    nodes.fill(0);
    for column in 0..phi.squares()[0] {
        let (first, [width, height]) = (1 + column * SQUARE, phi.size_of_square([column, row]));
        let mut set = |k: usize, sides: u64| {
            let word = k * words + first / WORD;
            let place = first % WORD;
            nodes[word] |= sides << place;
            if place + width > WORD {
                nodes[word + 1] |= sides >> (WORD - place);
            }
        };
        match phi.whole([column, row]).map(|v| v < 0.0) {
            Some(false) => {}
            Some(true) => (0..height).for_each(|k| set(k, (1 << width) - 1)),
            None => {
                for (k, values) in phi.of_square([column, row]).enumerate() {
                    set(k, values.iter().enumerate().fold(0, |sides, (i, v)| sides | u64::from(*v < 0.0) << i));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_those_whose_corners_are_on_both_sides() {
        for (seed, image) in
            [[1, 1], [61, 5], [62, 20], [63, 3], [64, 17], [126, 18], [130, 35]].into_iter().enumerate()
        {
            let [nx, ny] = image;
            // Noise in some squares; others are inside or outside as a whole.
            let hash = |n: usize| (n as u32 ^ (seed as u32) << 20).wrapping_mul(2654435761) >> 13;
            let layer = |k: usize| {
                let inside = |n: usize| match hash(n % nx / SQUARE + 7 * (n / nx / SQUARE) + 1000 * k) % 3 {
                    0 => hash(n + 77 * k).is_multiple_of(3),
                    other => other == 1,
                };
                let values: Vec<f32> = (0..nx * ny).map(|n| if inside(n) { -1.0 } else { 1.0 }).collect();
                Layer { z: k as f64, phi: SparseImage::of(image, &values), output: true, contour: None }
            };
            let layers = [layer(0), layer(1)];
            let mut slab = Slab::new(image, [1.0; 2]);
            // Below, between and above.
            for planes in [[None, Some(0)], [Some(0), Some(1)], [Some(1), None]] {
                slab.rise(planes[1].map(|k| &layers[k]));
                let is_in = |side: usize, i: usize, j: usize| {
                    let within = (1..=nx).contains(&i) && (1..=ny).contains(&j);
                    planes[side].filter(|_| within).is_some_and(|k| layers[k].phi.at(i - 1, j - 1) < 0.0)
                };
                let mut expected = Vec::new();
                for (j, i) in (0..ny + 1).flat_map(|j| (0..nx + 1).map(move |i| (j, i))) {
                    let corner = |c: usize| u8::from(is_in(c >> 2, i + (c & 1), j + (c >> 1 & 1))) << c;
                    let pattern = (0..8).map(corner).sum::<u8>();
                    expected.extend((pattern != 0 && pattern != u8::MAX).then_some((j, i as u32, pattern)));
                }
                let of = |row: Row| row.cells.into_iter().map(move |cell| (row.number, cell.column, cell.pattern));
                let found: Vec<(usize, u32, u8)> = slab.cells(0..slab.rows()).flat_map(of).collect();
                assert_eq!(found, expected, "{image:?}, {planes:?}");
            }
        }
    }
}
