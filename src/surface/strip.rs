//! Triangles of some rows of cells of a slab, made by one thread; afterwards the strips' vertices are numbered, strip after strip.
//!
//! An edge that the surface crosses has a vertex in every cell around it. So the vertices on a strip's first row of nodes are those that the strip
//! before it has on its last one, and those on the lower layer are the slab's below: a strip borrows them, and numbers its own in the order in
//! which cells ask for them.

use glam::DVec3;
use rustc_hash::FxHashMap;

use super::cases::{EDGES, LoopFill, patches};
use super::slab::{Row, Slab};
use crate::stack::Geometry;

/// A vertex of the surface.
#[derive(Debug, Clone, Copy)]
pub struct Corner {
    /// Its number, counted from the surface's first vertex.
    pub number: u64,
    /// Place in the stack.
    position: DVec3,
    /// Place in the world.
    pub world: DVec3,
}

/// An edge that two strips share: its axis, and the column of the node from which it goes.
type Shared = (u8, usize);

/// Numbers of the vertices on the edges that the next strip shares, in the order of the edges.
pub type Last = Vec<(Shared, u64)>;

/// Vertices on the edges of a layer, by the strips that made them.
#[derive(Debug, Default)]
pub struct Along(Vec<OfStrip>);

/// A strip's vertices on the edges of its upper layer.
#[derive(Debug)]
pub struct OfStrip {
    /// Its first row of cells.
    first: usize,
    /// Edges, by the places of their vertices.
    edges: FxHashMap<usize, u32>,
    vertices: Vec<Corner>,
}

impl Along {
    /// Adds the vertices of strips above all others.
    pub fn extend(&mut self, strips: Vec<OfStrip>) {
        self.0.extend(strips);
    }

    /// The vertex on an edge that a row of cells has.
    fn at(&self, row: usize, edge: usize) -> Option<&Corner> {
        let strip = self.0.partition_point(|strip| strip.first <= row).checked_sub(1)?;
        let OfStrip { edges, vertices, .. } = &self.0[strip];
        edges.get(&edge).map(|&place| &vertices[place as usize])
    }
}

/// Corners on the edges of a row of nodes, by column.
#[derive(Debug, Default)]
struct Line {
    corners: Vec<u32>,
    known: Vec<usize>,
}

/// No corner yet.
const NONE: u32 = u32::MAX;

impl Line {
    fn clear(&mut self, columns: usize) {
        self.known.drain(..).for_each(|i| self.corners[i] = NONE);
        self.corners.resize(columns, NONE);
    }

    fn set(&mut self, i: usize, corner: u32) {
        self.corners[i] = corner;
        self.known.push(i);
    }
}

/// Corners that are known while a strip is made.
#[derive(Debug, Default)]
pub struct Scratch {
    /// On edges along x: of either plane, below and above the row of cells.
    across: [[Line; 2]; 2],
    /// On edges along y of either plane.
    along: [Line; 2],
    /// On edges that go up, below and above the row of cells.
    upright: [Line; 2],
}

impl Scratch {
    /// Goes on to a row of cells: the next one, or any.
    fn advance(&mut self, columns: usize, is_next: bool) {
        let [low, high] = &mut self.across;
        for pair in [low, high, &mut self.upright] {
            pair.swap(0, 1);
            pair[1].clear(columns);
            if !is_next {
                pair[0].clear(columns);
            }
        }
        self.along.iter_mut().for_each(|line| line.clear(columns));
    }
}

/// Triangles of some rows of cells.
#[derive(Debug, Default)]
pub struct Strip {
    /// Corners of its triangles.
    pub corners: Vec<Corner>,
    /// Its triangles, by their corners.
    pub triangles: Vec<[u32; 3]>,
    /// Corners that are vertices of its own, in the order of their numbers.
    pub own: Vec<u32>,
    /// Number of the first of them.
    pub begin: u64,
    /// Its first row of cells.
    first: usize,
    /// Vertices of its own on the upper layer, and the edges on which they are.
    along: Vec<u32>,
    edges: FxHashMap<usize, u32>,
    /// Edges on its first row of nodes.
    borrowed: Vec<(Shared, u32)>,
    /// Edges on its last row of nodes.
    last: Vec<(Shared, u32)>,
}

/// What a strip is made of.
#[derive(Clone, Copy)]
pub struct Making<'m> {
    /// The slab.
    pub slab: &'m Slab,
    /// Way from the stack to the world, and whether it mirrors: it turns triangles inside out then.
    pub geometry: Geometry,
    /// See there.
    pub mirrors: bool,
    /// Vertices on the slab's lower layer.
    pub lower: &'m Along,
}

impl Strip {
    /// The strip of these rows, of which there is one at least, without the numbers of what it makes and of what it shares.
    pub fn new(making: Making<'_>, rows: &[Row], scratch: &mut Scratch) -> Self {
        let columns = making.slab.dims[0];
        let mut strip = Strip { first: rows.first().map_or(0, |row| row.number), ..Strip::default() };
        let mut before = None;
        for row in rows {
            scratch.advance(columns, before.is_some_and(|before: usize| before + 1 == row.number));
            before = Some(row.number);
            for cell in &row.cells {
                strip.fill([cell.column as usize, row.number], cell.pattern, making, scratch);
            }
        }
        for (axis, line) in [(0, &scratch.across[1][1]), (2, &scratch.upright[1])] {
            strip.last.extend(line.known.iter().map(|&i| ((axis, i), line.corners[i])));
        }
        strip.last.sort_unstable();
        if making.mirrors {
            strip.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        strip
    }

    /// Adds the triangles of a cell.
    fn fill(&mut self, at: [usize; 2], pattern: u8, making: Making<'_>, scratch: &mut Scratch) {
        for patch in patches(pattern, making.slab.joined(at[0], at[1], pattern)) {
            match patch {
                LoopFill::Flat(triangles) => {
                    for t in triangles {
                        let corners = t.map(|e| self.vertex(at, e, making, scratch));
                        self.triangles.push(corners);
                    }
                }
                LoopFill::Fan(path) => {
                    let ring: Vec<u32> = path.iter().map(|&e| self.vertex(at, e, making, scratch)).collect();
                    let share = |k: &u32| self.corners[*k as usize].position / ring.len() as f64;
                    let center = self.corner(ring.iter().map(share).sum(), making);
                    self.own.push(center);
                    for (k, &v) in ring.iter().enumerate() {
                        self.triangles.push([center, v, ring[(k + 1) % ring.len()]]);
                    }
                }
            }
        }
    }

    /// Adds a corner.
    fn corner(&mut self, position: DVec3, making: Making<'_>) -> u32 {
        self.corners.push(Corner { number: 0, position, world: making.geometry.to_world(position) });
        (self.corners.len() - 1) as u32
    }

    /// The vertex on edge `e` of the cell at (i, j).
    fn vertex(&mut self, [i, j]: [usize; 2], e: u8, making: Making<'_>, scratch: &mut Scratch) -> u32 {
        let corner = EDGES[e as usize][0];
        let (i, row, side) = (i + (corner & 1), corner >> 1 & 1, corner >> 2);
        let axis = e / 4;
        let line = match axis {
            0 => &mut scratch.across[side][row],
            1 => &mut scratch.along[side],
            _ => &mut scratch.upright[row],
        };
        let known = line.corners[i];
        if known != NONE {
            return known;
        }
        let new = self.found([i, j + row], side, axis, making);
        line.set(i, new);
        new
    }

    /// The vertex on an edge that is new to the strip.
    fn found(&mut self, at: [usize; 2], side: usize, axis: u8, making: Making<'_>) -> u32 {
        let edge = 2 * (at[1] * making.slab.dims[0] + at[0]) + usize::from(axis);
        // An edge along x was first asked for by the row of cells below it.
        let row = if axis == 0 { at[1].saturating_sub(1) } else { at[1] };
        if let Some(&corner) = making.lower.at(row, edge).filter(|_| axis != 2 && side == 0) {
            self.corners.push(corner);
            return (self.corners.len() - 1) as u32;
        }
        let new = self.corner(making.slab.crossing(at, side, axis), making);
        if axis != 1 && at[1] == self.first {
            self.borrowed.push(((axis, at[0]), new));
            return new;
        }
        self.own.push(new);
        if axis != 2 {
            self.edges.insert(edge, self.along.len() as u32);
            self.along.push(new);
        }
        new
    }

    /// Numbers its vertices from its first on; gives back the numbers that the next strip borrows.
    pub fn number(&mut self) -> Last {
        for (number, &own) in (self.begin..).zip(&self.own) {
            self.corners[own as usize].number = number;
        }
        self.last.iter().map(|&(shared, corner)| (shared, self.corners[corner as usize].number)).collect()
    }

    /// Numbers what it has borrowed by the vertices of the strip before it.
    pub fn borrow(&mut self, before: &Last) {
        for (shared, corner) in &self.borrowed {
            let found = before.binary_search_by_key(shared, |(shared, _)| *shared);
            debug_assert!(found.is_ok(), "the strip before has no vertex on an edge of its last nodes");
            self.corners[*corner as usize].number = found.map_or(0, |place| before[place].1);
        }
    }

    /// The strip, which has its numbers, and apart from it its vertices on the upper layer.
    pub fn with_along(mut self) -> (OfStrip, Self) {
        let vertices = self.along.iter().map(|&corner| self.corners[corner as usize]).collect();
        (OfStrip { first: self.first, edges: std::mem::take(&mut self.edges), vertices }, self)
    }
}
