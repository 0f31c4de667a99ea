//! Distance from pixel centres to edges, where it is small.

use glam::DVec2;

use super::edges::Edge;
use super::grid::DrawingGrid;

/// Exact distance of every pixel centre to the nearest edge, at most `reach`. Each edge is asked only about the pixels within `reach`.
pub fn near_distance(edges: &[Edge], grid: &DrawingGrid, reach: f64) -> Vec<f32> {
    let [nx, ny] = grid.dims;
    let mut squared = vec![reach * reach; nx * ny];
    let within = |at: f64, last: usize| at.clamp(0.0, last as f64) as usize;
    for edge in edges {
        let [p, q] = if edge[0].y <= edge[1].y { *edge } else { [edge[1], edge[0]] };
        let rows = within(grid.row(p.y - reach).ceil(), ny)..within(grid.row(q.y + reach).floor() + 1.0, ny);
        for j in rows {
            let y = grid.y(j);
            // The part of the edge that is near this row.
            let at = |y: f64| if q.y > p.y { ((y - p.y) / (q.y - p.y)).clamp(0.0, 1.0) } else { 0.0 };
            let [s, t] = if q.y > p.y { [at(y - reach), at(y + reach)] } else { [0.0, 1.0] };
            let [a, b] = [s, t].map(|t| p.x + t * (q.x - p.x));
            let columns = within(grid.column(a.min(b) - reach).ceil(), nx)
                ..within(grid.column(a.max(b) + reach).floor() + 1.0, nx);
            for i in columns {
                let d = &mut squared[j * nx + i];
                *d = d.min(squared_distance(DVec2::new(grid.x(i), y), [p, q]));
            }
        }
    }
    squared.into_iter().map(|d| d.sqrt() as f32).collect()
}

fn squared_distance(x: DVec2, [p, q]: Edge) -> f64 {
    let (along, v) = (q - p, x - p);
    let t = (v.dot(along) / along.length_squared()).clamp(0.0, 1.0);
    (v - t * along).length_squared()
}
