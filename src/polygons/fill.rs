//! Which pixels lie inside: even-odd along every row.

use std::ops::Range;

use super::edges::Edge;
use super::grid::Grid;

/// Calls `inside` with every run of pixel centres that lie inside an odd number of the closed lines that `edges` are. A centre on an edge
/// belongs to the right or upper side of it.
pub fn fill(edges: &[Edge], grid: &Grid, mut inside: impl FnMut(Range<usize>)) {
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

/// Area that lies inside an odd number of the polygons, by the mid-point rule on `lines` rows between the heights `low` and `high`.
pub fn area(edges: &[Edge], [low, high]: [f64; 2], lines: usize) -> f64 {
    let step = (high - low) / lines as f64;
    let mut sum = 0.0;
    for k in 0..lines {
        let y = low + (k as f64 + 0.5) * step;
        let crossed = edges.iter().filter(|[p, q]| (p[1] <= y) != (q[1] <= y));
        let mut x: Vec<f64> = crossed.map(|[p, q]| p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0])).collect();
        x.sort_by(f64::total_cmp);
        sum += x.chunks_exact(2).map(|pair| pair[1] - pair[0]).sum::<f64>() * step;
    }
    sum
}
