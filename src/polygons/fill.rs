//! Filling: which pixels lie inside, even-odd along every row.

use std::ops::Range;

use super::edges::Edge;
use super::grid::DrawingGrid;

/// Calls `inside` with every run of pixel centres that lie inside an odd number of the closed lines that `edges` are. A centre on an edge
/// belongs to the right or upper side of it.
pub fn fill(edges: &[Edge], grid: &DrawingGrid, mut inside: impl FnMut(Range<usize>)) {
    let [nx, ny] = grid.dims;
    let mut rows: Vec<Vec<f64>> = vec![Vec::new(); ny];
    for edge in edges {
        let [p, q] = if edge[0].y <= edge[1].y { *edge } else { [edge[1], edge[0]] };
        let first = grid.row(p.y).ceil().max(0.0) as usize;
        for (j, row) in rows.iter_mut().enumerate().skip(first.saturating_sub(1)) {
            let y = grid.y(j);
            if y >= q.y {
                break;
            }
            if y >= p.y {
                row.push(p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x));
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
