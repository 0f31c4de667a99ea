//! Which pixels lie inside: even-odd along every row.

use std::ops::Range;

use super::edges::Edge;
use super::grid::DrawingGrid;

/// Calls `inside` with every run of pixel centres that lie inside an odd number of the closed lines that `edges` are. A centre on an edge
/// belongs to the right or upper side of it.
pub fn fill(edges: &[Edge], grid: &DrawingGrid, mut inside: impl FnMut(Range<usize>)) {
    let [nx, ny] = grid.dims;
    let mut rows: Vec<Vec<f64>> = vec![Vec::new(); ny];
    for edge in edges {
        let [p, q] = if edge[0][1] <= edge[1][1] { *edge } else { [edge[1], edge[0]] };
        let first = grid.row(p[1]).ceil().max(0.0) as usize;
        for (j, row) in rows.iter_mut().enumerate().skip(first.saturating_sub(1)) {
            let y = grid.y(j);
            if y >= q[1] {
                break;
            }
            if y >= p[1] {
                row.push(p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0]));
            }
        }
    }
    for (j, row) in rows.iter_mut().enumerate() {
        row.sort_by(f64::total_cmp);
        for pair in row.chunks_exact(2) {
            let [from, to] = [pair[0], pair[1]].map(|x| (grid.column(x).ceil().max(0.0) as usize).min(nx));
            inside(j * nx + from..j * nx + to);
        }
    }
}
