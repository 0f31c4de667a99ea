//! Marching cubes on the layers' true heights, slab by slab: a slab needs its two layers and the vertices on the lower one, no more. Strips of a
//! slab are made side by side; vertices have the numbers that they had if cells came one after the other.
//!
//! ```text
//! layers -> Slab -> rows of cells -> strips -> numbers -> pieces
//! ```

use std::collections::VecDeque;

use glam::DVec3;
use rayon::prelude::*;

use super::Layer;
use super::header::Header;
use super::slab::{Row, Slab};
use super::strip::{Along, Corner, Last, Making, OfStrip, Scratch, Strip};
use crate::stack::Geometry;

/// A strip ends after the row in which it has reached this many cells: enough for a thread to take.
const STRIP_CELLS: usize = 1 << 9;
/// Cells of the strips that are made side by side, and cells that are looked at to find them.
const CELLS_AT_ONCE: usize = 1 << 13;
const LOOKED_AT: usize = 1 << 17;
/// Bytes that all of these take at most: where the body ends flat, a slab is as large as a layer.
pub const BYTES: usize = 4 << 20;

/// Piece of the surface: a strip of what a slab adds. Its triangles have corners of its own, of the pieces before it in the slab and of the slab
/// below, of no other.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    positions: Vec<DVec3>,
    corners: Vec<Corner>,
    /// By their corners.
    triangles: Vec<[u32; 3]>,
    settled: u64,
}

impl Piece {
    /// Positions of the new vertices, world coordinates.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Vertex numbers of the new triangles, counted from the surface's first vertex; counter-clockwise seen from outside.
    pub fn triangles(&self) -> impl Iterator<Item = [u64; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|corner| self.corners[corner as usize].number))
    }

    /// Corner positions of each triangle, world coordinates.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|corner| self.corners[corner as usize].world))
    }

    /// Number below which no later piece has a triangle's corner.
    pub fn settled(&self) -> u64 {
        self.settled
    }
}

/// Builds the surface slab by slab, from the lowest layer to the highest and the outside above it.
#[derive(Debug)]
pub struct Builder {
    geometry: Geometry,
    mirrors: bool,
    /// Heights between which layers count.
    extent: [f64; 2],
    slab: Slab,
    /// Vertices on the edges of each of the slab's two layers.
    along: [Along; 2],
    /// The next row of cells to look at; none where the slab's last piece is there.
    row: Option<usize>,
    /// Rows of the next strips, and the cells in them.
    found: (VecDeque<Vec<Row>>, usize),
    /// What the next strip shares with the last one.
    last: Last,
    /// Vertices until now, of those the ones until the slab below and until this one.
    vertices: u64,
    starts: [u64; 2],
}

impl Builder {
    /// A builder without layers yet.
    pub fn new(header: &Header) -> Self {
        let [low, high] = header.extent;
        let slack = 1e-9 * (high - low).abs();
        Builder {
            geometry: header.geometry,
            mirrors: header.geometry.turn().determinant() < 0.0,
            extent: [low - slack, high + slack],
            slab: Slab::new(header.dims, header.spacing),
            along: Default::default(),
            row: None,
            found: Default::default(),
            last: Last::default(),
            vertices: 0,
            starts: [0; 2],
        }
    }

    /// The next layer: [`Builder::made`] gives the slab below it, which must be asked for before the next one; nothing where it lies beyond
    /// the body's extent.
    pub fn layer(&mut self, layer: &Layer) {
        if layer.z >= self.extent[0] && layer.z <= self.extent[1] {
            self.rise(Some(layer));
        }
    }

    /// There is no other layer: [`Builder::made`] gives what closes the surface above the last; nothing where there was none.
    pub fn finish(&mut self) {
        if self.slab.has_top() {
            self.rise(None);
        }
    }

    /// Begins the next slab.
    fn rise(&mut self, layer: Option<&Layer>) {
        self.slab.rise(layer);
        self.starts = [self.starts[1], self.vertices];
        self.row = Some(0);
        self.found = Default::default();
        self.along.swap(0, 1);
        // Nothing is used again: one layer's contours may be far longer than those after it.
        self.along[1] = Along::default();
        self.last = Last::default();
    }

    /// Shows the slab's pieces, all that are left.
    pub fn pieces(&mut self, mut each: impl FnMut(&Piece)) {
        while let Some(pieces) = self.made() {
            pieces.iter().for_each(&mut each);
        }
    }

    /// The next pieces of the slab; none where it is complete. A slab has one piece at least.
    pub fn made(&mut self) -> Option<Vec<Piece>> {
        let mut row = self.row?;
        // One strip more than are made now: without another one the last of these is the slab's.
        while self.found.1 <= CELLS_AT_ONCE && row < self.slab.rows() {
            row = self.find(row);
        }
        self.row = Some(row);
        let mut strips = Vec::new();
        let mut cells = 0;
        while let Some(rows) = self.found.0.front() {
            let more: usize = rows.iter().map(|row| row.cells.len()).sum();
            if !strips.is_empty() && cells + more > CELLS_AT_ONCE {
                break;
            }
            cells += more;
            strips.extend(self.found.0.pop_front());
        }
        self.found.1 -= cells;
        let mut pieces = self.pieces_of(strips);
        // Rows above still have corners anywhere on the lower layer, whose vertices the slab below brought.
        pieces.iter_mut().for_each(|piece| piece.settled = self.starts[0]);
        if row == self.slab.rows() && self.found.0.is_empty() {
            self.row = None;
            if pieces.is_empty() {
                pieces.push(Piece::default());
            }
            pieces.iter_mut().next_back().into_iter().for_each(|last| last.settled = self.starts[1]);
        }
        Some(pieces)
    }

    /// The pieces that strips of these rows make, numbered.
    fn pieces_of(&mut self, strips: Vec<Vec<Row>>) -> Vec<Piece> {
        let making = Making { slab: &self.slab, geometry: self.geometry, mirrors: self.mirrors, lower: &self.along[0] };
        let strip = |scratch: &mut Scratch, rows: Vec<Row>| Strip::new(making, &rows, scratch);
        let mut made: Vec<Strip> = strips.into_par_iter().map_init(Scratch::default, strip).collect();
        for strip in &mut made {
            strip.begin = self.vertices;
            self.vertices += strip.own.len() as u64;
        }
        let lasts: Vec<Last> = made.par_iter_mut().map(Strip::number).collect();
        let befores = std::iter::once(&self.last).chain(&lasts);
        let piece = |(mut strip, before): (Strip, &Last)| {
            strip.borrow(before);
            let (along, Strip { corners, triangles, own, .. }) = strip.with_along();
            let positions = own.iter().map(|&own| corners[own as usize].world).collect();
            (along, Piece { positions, corners, triangles, settled: 0 })
        };
        let befores: Vec<&Last> = befores.take(made.len()).collect();
        let made: Vec<_> = made.into_par_iter().zip(befores).map(piece).collect();
        if let Some(last) = lasts.into_iter().next_back() {
            self.last = last;
        }
        let (along, pieces): (Vec<OfStrip>, Vec<Piece>) = made.into_iter().unzip();
        self.along[1].extend(along);
        pieces
    }

    /// Finds the cells of some rows from `row` on that the surface crosses, and cuts them into strips; the first row that is left.
    fn find(&mut self, row: usize) -> usize {
        let end = (row + (LOOKED_AT / self.slab.dims[0]).max(1)).min(self.slab.rows());
        let mut strip: Vec<Row> = Vec::new();
        let mut cells = 0;
        for row in self.slab.cells(row..end) {
            cells += row.cells.len();
            self.found.1 += row.cells.len();
            strip.push(row);
            if cells >= STRIP_CELLS {
                self.found.0.push_back(std::mem::take(&mut strip));
                cells = 0;
            }
        }
        if !strip.is_empty() {
            self.found.0.push_back(strip);
        }
        end
    }
}
