//! Marching cubes on the layers' true heights, slab by slab: a slab needs its two layers and the vertices on the lower one, no more.

use std::ops::Range;

use glam::DVec3;
use rustc_hash::FxHashMap;

use super::Layer;
use super::cases::{AMBIGUOUS, EDGES, FACES, LoopFill, patches};
use super::header::Header;
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::stack::Geometry;

/// Vertices stay this far, in cell sides, from the corners of their cells: vertices of different edges stay apart in f32 too, near an
/// [origin](super::local), so that a reader that merges equal positions (STL) finds the same closed surface.
pub(super) const OFF_CORNER: f64 = 1e-3;

/// A piece ends after the row in which it has reached this many triangles: where the body ends flat, a slab is as large as a layer.
const PIECE_TRIANGLES: usize = 1 << 12;

/// Piece of the surface: some rows of what a slab adds. Its triangles have corners of its own, of the pieces before it in the slab and of the slab
/// below, of no other.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    positions: Vec<DVec3>,
    triangles: Vec<[Corner; 3]>,
    settled: u64,
}

/// A vertex of the surface.
#[derive(Debug, Clone, Copy)]
struct Corner {
    number: u64,
    /// Place in the stack.
    position: DVec3,
    /// Place in the world.
    world: DVec3,
}

impl Piece {
    /// Positions of the new vertices, world coordinates.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Vertex numbers of the new triangles, counted from the surface's first vertex; counter-clockwise seen from outside.
    pub fn triangles(&self) -> impl Iterator<Item = [u64; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|corner| corner.number))
    }

    /// Corner positions of each triangle, world coordinates.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|t| t.map(|corner| corner.world))
    }

    /// Number below which no later piece has a triangle's corner.
    pub fn settled(&self) -> u64 {
        self.settled
    }
}

/// A layer, or the outside below the first and above the last.
#[derive(Debug, Default)]
struct Plane {
    z: Option<f64>,
    phi: SparseImage<f32>,
}

/// Builds the surface slab by slab, from the lowest layer to the highest and the outside above it.
#[derive(Debug)]
pub struct Builder {
    /// Pixels per layer.
    image: [usize; 2],
    spacing: [f64; 2],
    geometry: Geometry,
    /// A geometry that mirrors turns the triangles inside out.
    mirrors: bool,
    /// Heights between which layers count.
    extent: [f64; 2],
    /// Nodes per padded row and number of rows: one ring of outside around the image.
    dims: [usize; 2],
    /// The slab's two layers.
    planes: [Plane; 2],
    /// Sides of their nodes: inside or not.
    inside: [Vec<u8>; 2],
    /// Vertices on the edges of each of the two layers, two edges per node.
    along: [FxHashMap<usize, Corner>; 2],
    /// Vertices on the edges that go up from two rows of nodes, and the nodes that have one.
    upright: [(Vec<Option<Corner>>, Vec<usize>); 2],
    /// The next row of cells; none where the slab is filled.
    row: Option<usize>,
    /// Rows of squares of the last row of cells, and the columns of cells there that the surface may cross.
    active: (Option<[Option<usize>; 2]>, Vec<Range<usize>>),
    /// Vertices until now, of those the ones until the slab below and until this one.
    vertices: u64,
    starts: [u64; 2],
    piece: Piece,
}

impl Builder {
    /// A builder without layers yet.
    pub fn new(header: &Header) -> Self {
        let dims = header.dims.map(|n| n + 2);
        let [low, high] = header.extent;
        let slack = 1e-9 * (high - low).abs();
        let g = header.geometry;
        Builder {
            image: header.dims,
            spacing: header.spacing,
            geometry: g,
            mirrors: g.turn().determinant() < 0.0,
            extent: [low - slack, high + slack],
            dims,
            planes: Default::default(),
            inside: Default::default(),
            along: Default::default(),
            upright: Default::default(),
            row: None,
            active: (None, Vec::new()),
            vertices: 0,
            starts: [0; 2],
            piece: Piece::default(),
        }
    }

    /// The next layer: [`Builder::piece`] gives the slab below it, which must be asked for before the next one; nothing where it lies beyond
    /// the body's extent.
    pub fn layer(&mut self, layer: &Layer) {
        if layer.z < self.extent[0] || layer.z > self.extent[1] {
            return;
        }
        self.planes.swap(0, 1);
        let plane = &mut self.planes[1];
        plane.z = Some(layer.z);
        plane.phi = layer.phi.clone();
        self.slab();
    }

    /// There is no other layer: [`Builder::piece`] gives what closes the surface above the last; nothing where there was none.
    pub fn finish(&mut self) {
        if self.planes[1].z.is_some() {
            self.planes.swap(0, 1);
            self.planes[1].z = None;
            self.slab();
        }
    }

    /// Begins the slab between the two layers.
    fn slab(&mut self) {
        let n = self.dims[0] * self.dims[1];
        self.starts = [self.starts[1], self.vertices];
        self.row = Some(0);
        self.active.0 = None;
        self.along.swap(0, 1);
        // Nothing is used again: one layer's contours may be far longer than those after it.
        self.along[1] = FxHashMap::default();
        for (row, known) in &mut self.upright {
            known.drain(..).for_each(|i| row[i] = None);
            row.resize(self.dims[0], None);
        }
        self.inside.swap(0, 1);
        self.inside[1].clear();
        self.inside.iter_mut().for_each(|one| one.resize(n, 0));
        if self.planes[1].z.is_none() {
            return;
        }
        let phi = &self.planes[1].phi;
        for square @ [column, row] in phi.each_square() {
            let whole = phi.whole(square).map(|v| u8::from(v < 0.0));
            if whole == Some(0) {
                continue;
            }
            for (j, values) in (row * SQUARE..).zip(phi.of_square(square)) {
                let sides = &mut self.inside[1][(j + 1) * self.dims[0] + 1 + column * SQUARE..][..values.len()];
                match whole {
                    Some(side) => sides.fill(side),
                    None => sides.iter_mut().zip(values).for_each(|(s, v)| *s = u8::from(*v < 0.0)),
                }
            }
        }
    }

    /// The next piece of the slab; none where it is complete. A slab has one piece at least.
    pub fn piece(&mut self) -> Option<&Piece> {
        let mut j = self.row?;
        self.piece.positions.clear();
        self.piece.triangles.clear();
        let mut cells = Vec::new();
        while j < self.dims[1] - 1 && self.piece.triangles.len() < PIECE_TRIANGLES {
            self.find_active(j);
            self.cells(j, &mut cells);
            for &(i, pattern) in &cells {
                self.cell(i, j, pattern);
            }
            self.upright.swap(0, 1);
            let (row, known) = &mut self.upright[1];
            known.drain(..).for_each(|i| row[i] = None);
            j += 1;
        }
        self.row = (j < self.dims[1] - 1).then_some(j);
        // Rows above still have corners anywhere on the lower layer, whose vertices the slab below brought.
        self.piece.settled = if self.row.is_some() { self.starts[0] } else { self.starts[1] };
        if self.mirrors {
            self.piece.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        Some(&self.piece)
    }

    /// Shows the slab's pieces, all that are left.
    pub fn pieces(&mut self, mut each: impl FnMut(&Piece)) {
        while let Some(piece) = self.piece() {
            each(piece);
        }
    }

    /// Cells of row `j` that the surface crosses, and which of their corners are inside.
    fn cells(&self, j: usize, cells: &mut Vec<(usize, u8)>) {
        let rows = [0, 1].map(|side| [j, j + 1].map(|row| row * self.dims[0]).map(|start| (side, start)));
        let column = |i: usize| {
            let at = |k: usize, r: usize| {
                let (side, start) = rows[k][r];
                self.inside[side][start + i]
            };
            at(0, 0) | at(0, 1) << 2 | at(1, 0) << 4 | at(1, 1) << 6
        };
        cells.clear();
        for range in &self.active.1 {
            let mut left = column(range.start);
            for i in range.clone() {
                let right = column(i + 1);
                let pattern = left | right << 1;
                if pattern != 0 && pattern != 0xff {
                    cells.push((i, pattern));
                }
                left = right;
            }
        }
    }

    /// Finds the columns of cells of row `j` that the surface may cross: all but those whose corners lie in squares of one side.
    fn find_active(&mut self, j: usize) {
        let [nx, ny] = self.image;
        let rows = [j, j + 1].map(|row| row.checked_sub(1).filter(|pixel| *pixel < ny).map(|pixel| pixel / SQUARE));
        if self.active.0 == Some(rows) {
            return;
        }
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
        self.active = (Some(rows), ranges);
    }

    /// Ambiguous faces of a cell whose inside corners are joined: the mean of the four values is inside. It is the same seen from either side. At
    /// the border of the image and beyond the ends there are no values, and nothing is joined.
    fn joined(&self, i: usize, j: usize, pattern: u8) -> u8 {
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

    fn cell(&mut self, i: usize, j: usize, pattern: u8) {
        for patch in patches(pattern, self.joined(i, j, pattern)) {
            match patch {
                LoopFill::Flat(triangles) => {
                    for t in triangles {
                        let corners = t.map(|e| self.vertex(i, j, e));
                        self.piece.triangles.push(corners);
                    }
                }
                LoopFill::Fan(path) => {
                    let ring: Vec<Corner> = path.iter().map(|&e| self.vertex(i, j, e)).collect();
                    let center = self.push(ring.iter().map(|v| v.position / ring.len() as f64).sum());
                    for (k, &v) in ring.iter().enumerate() {
                        self.piece.triangles.push([center, v, ring[(k + 1) % ring.len()]]);
                    }
                }
            }
        }
    }

    /// Adds a vertex.
    fn push(&mut self, position: DVec3) -> Corner {
        let corner = Corner { number: self.vertices, position, world: self.geometry.to_world(position) };
        self.vertices += 1;
        self.piece.positions.push(corner.world);
        corner
    }

    /// The vertex on edge `e` of the cell with lower corner (i, j).
    fn vertex(&mut self, i: usize, j: usize, e: u8) -> Corner {
        let corner = EDGES[e as usize][0];
        let (i, row, side) = (i + (corner & 1), corner >> 1 & 1, corner >> 2);
        let axis = e / 4;
        let edge = 2 * ((j + row) * self.dims[0] + i) + usize::from(axis);
        let known = if axis == 2 { self.upright[row].0[i] } else { self.along[side].get(&edge).copied() };
        known.unwrap_or_else(|| {
            let new = self.push(self.crossing([i, j + row], side, axis));
            match axis {
                2 => {
                    self.upright[row].0[i] = Some(new);
                    self.upright[row].1.push(i);
                }
                _ => _ = self.along[side].insert(edge, new),
            }
            new
        })
    }

    fn crossing(&self, at: [usize; 2], side: usize, axis: u8) -> DVec3 {
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
