//! Cells of an image that are skipped where no contour can be, and the probes that tell so.

use crate::grid::sparse_image::SQUARE;

/// Side of the cells that are skipped where no contour can be, px.
pub const CELL: usize = 8;

/// Set of cells of an image.
#[derive(Debug, Clone)]
pub struct Cells {
    columns: usize,
    /// Row by row.
    chosen: Vec<bool>,
}

impl Cells {
    /// The cells that `choose` wants, by the first and the last pixel `[column, row]` of each.
    pub fn new([nx, ny]: [usize; 2], choose: impl Fn([usize; 2], [usize; 2]) -> bool) -> Self {
        let last = |first: usize, n: usize| (first + CELL).min(n) - 1;
        let row = |y| (0..nx).step_by(CELL).map(move |x| ([x, y], [last(x, nx), last(y, ny)]));
        let chosen = (0..ny).step_by(CELL).flat_map(row).map(|(first, last)| choose(first, last)).collect();
        Cells { columns: nx.div_ceil(CELL), chosen }
    }

    /// Whether each cell is one of them, row by row.
    pub fn chosen(&self) -> &[bool] {
        &self.chosen
    }

    /// Whether the cell of a pixel is one of them.
    pub fn at(&self, x: usize, y: usize) -> bool {
        self.chosen[y / CELL * self.columns + x / CELL]
    }
}

/// Cells of a sparse image's square in that column and row: their first pixels.
pub fn cells_of_square([column, row]: [usize; 2], [nx, ny]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    let firsts = |k: usize, n: usize| (k * SQUARE..((k + 1) * SQUARE).min(n)).step_by(CELL);
    firsts(row, ny).flat_map(move |top| firsts(column, nx).map(move |left| [left, top]))
}

/// What probes with these values say of a cell: that it is beyond `limit`, inside or outside, else nothing, which is 0.
pub fn probed(values: [f32; 5], limit: f32) -> f32 {
    let all = |beyond: fn(f32, f32) -> bool| values.iter().all(|v| beyond(*v, limit));
    if all(|v, limit| v >= limit) {
        limit
    } else if all(|v, limit| v <= -limit) {
        -limit
    } else {
        0.0
    }
}

/// Pixels that tell whether a cell is far from any contour: its corners and its middle.
pub fn probes([left, top]: [usize; 2], [right, bottom]: [usize; 2]) -> [[usize; 2]; 5] {
    [[left, top], [right, top], [left, bottom], [right, bottom], [left.midpoint(right), top.midpoint(bottom)]]
}
