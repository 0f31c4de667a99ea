//! Two neighbouring layers, and the cells between them that the surface crosses.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::Layer;
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

/// Two neighbouring layers.
#[derive(Debug)]
pub struct Slab {
    /// Pixels per layer.
    image: [usize; 2],
    spacing: [f64; 2],
    /// Nodes per padded row and number of rows: one ring of outside around the image.
    pub dims: [usize; 2],
    planes: [Plane; 2],
    /// Sides of their nodes: inside or not.
    inside: [Vec<u8>; 2],
}

impl Slab {
    /// The outside below the first layer of an image of these pixels.
    pub fn new(image: [usize; 2], spacing: [f64; 2]) -> Self {
        let dims = image.map(|n| n + 2);
        let outside = || vec![0; dims[0] * dims[1]];
        Slab { image, spacing, dims, planes: Default::default(), inside: [outside(), outside()] }
    }

    /// Goes up to the next layer, or to the outside above the last.
    pub fn rise(&mut self, layer: Option<&Layer>) {
        self.planes.swap(0, 1);
        self.inside.swap(0, 1);
        let (nx, plane, inside) = (self.dims[0], &mut self.planes[1], &mut self.inside[1]);
        let Some(layer) = layer else {
            *plane = Plane::default();
            inside.fill(0);
            return;
        };
        (plane.z, plane.phi) = (Some(layer.z), layer.phi.clone());
        let phi = &plane.phi;
        let image = &mut inside[nx..nx * (self.image[1] + 1)];
        image.par_chunks_mut(SQUARE * nx).enumerate().for_each(|(row, nodes)| {
            nodes.fill(0);
            for column in 0..self.image[0].div_ceil(SQUARE) {
                let whole = phi.whole([column, row]).map(|v| u8::from(v < 0.0));
                if whole == Some(0) {
                    continue;
                }
                for (nodes, values) in nodes.chunks_exact_mut(nx).zip(phi.of_square([column, row])) {
                    let sides = &mut nodes[1 + column * SQUARE..][..values.len()];
                    match whole {
                        Some(side) => sides.fill(side),
                        None => sides.iter_mut().zip(values).for_each(|(s, v)| *s = u8::from(*v < 0.0)),
                    }
                }
            }
        });
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
    pub fn cells(&self, rows: Range<usize>) -> Vec<Row> {
        let mut active = (None, Vec::new());
        let row = |number: usize| {
            let squares = [number, number + 1].map(|row| self.square(row));
            if active.0 != Some(squares) {
                active = (Some(squares), self.active(squares));
            }
            let mut cells = Vec::new();
            self.crossed(number, &active.1, &mut cells);
            (!cells.is_empty()).then_some(Row { number, cells })
        };
        rows.filter_map(row).collect()
    }

    /// Row of squares in which a row of nodes lies; none around the image.
    fn square(&self, row: usize) -> Option<usize> {
        row.checked_sub(1).filter(|pixel| *pixel < self.image[1]).map(|pixel| pixel / SQUARE)
    }

    /// Cells of row `j` in these columns that the surface crosses.
    fn crossed(&self, j: usize, columns: &[Range<usize>], cells: &mut Vec<Cell>) {
        let rows = [0, 1].map(|side| [j, j + 1].map(|row| row * self.dims[0]).map(|start| (side, start)));
        let column = |i: usize| {
            let at = |k: usize, r: usize| {
                let (side, start) = rows[k][r];
                self.inside[side][start + i]
            };
            at(0, 0) | at(0, 1) << 2 | at(1, 0) << 4 | at(1, 1) << 6
        };
        for range in columns {
            let mut left = column(range.start);
            for i in range.clone() {
                let right = column(i + 1);
                let pattern = left | right << 1;
                if pattern != 0 && pattern != 0xff {
                    cells.push(Cell { column: i as u32, pattern });
                }
                left = right;
            }
        }
    }

    /// Columns of the cells between two rows of squares that the surface may cross: all but those whose corners lie in squares of one side.
    fn active(&self, rows: [Option<usize>; 2]) -> Vec<Range<usize>> {
        let nx = self.image[0];
        let side = |column: usize| {
            let of = |plane: &Plane, row: Option<usize>| match (plane.z, row) {
                (Some(_), Some(row)) => plane.phi.whole([column, row]).map(|v| v < 0.0),
                _ => Some(false),
            };
            let first = of(&self.planes[0], rows[0])?;
            let others = [(0, 1), (1, 0), (1, 1)].map(|(plane, row)| of(&self.planes[plane], rows[row]));
            others.iter().all(|other| *other == Some(first)).then_some(first)
        };
        let squares = (0..nx).step_by(SQUARE).enumerate();
        let squares = squares.map(|(column, first)| (side(column), first + 1..(first + SQUARE).min(nx) + 1));
        let mut ranges: Vec<Range<usize>> = Vec::new();
        let mut push = |range: Range<usize>| match ranges.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => ranges.push(range),
        };
        // Around the image there is a ring of outside.
        let mut before = Some(false);
        for (side, nodes) in squares.chain([(Some(false), nx + 1..nx + 2)]) {
            if side.is_none() || side != before {
                push(nodes.start - 1..nodes.start);
            }
            if side.is_none() {
                push(nodes.start..nodes.end - 1);
            }
            before = side;
        }
        ranges
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
