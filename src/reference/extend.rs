//! Extension of values off the contour along its normals, `F_tau + S(phi) n . grad F = 0` (Eq. 3), by Jacobi passes of its steady
//! first-order upwind form (Adalsteinsson and Sethian 1999): every pixel takes the mean of its neighbours that lie closer to the
//! contour, weighted by how much closer; only pixels of the tube T are looked at, none of the tile's rim, which moves with no contour. Pixels at
//! the contour keep their values.

use super::band::{Band, RIM};
use crate::grid::field::Field;

/// Neighbours to either side that differ by less than this are as close, px: on the middle line of a part rounding must not decide from which
/// of its sides a value comes.
pub const ALIKE: f64 = 1e-3;

/// Upwind neighbours of the pixels of a band, found once per front and used for every channel and pass.
#[derive(Debug, Clone, Default)]
pub struct Upwind {
    /// `(node in x, node in y, weight of x)` in band order; a pixel that keeps its value points at itself.
    sources: Vec<(u32, u32, f64)>,
}

impl Upwind {
    /// Sources for all pixels of `band` around the contour of `phi`.
    pub fn find(&mut self, phi: &Field, band: &Band, h: [f64; 2]) {
        let [nx, ny] = phi.dims;
        self.sources.clear();
        for run in &band.runs {
            let [column, row] = [run.start % nx, run.start / nx];
            self.sources.extend(run.nodes().zip(column..).map(|(node, column)| {
                let keep = (node as u32, node as u32, 1.0);
                if phi.at_contour(node) {
                    return keep;
                }
                let at = phi.data[node].abs();
                // The closer of the neighbours before and behind in a row or column of pixels, none of its rim.
                let closer = |stride: usize, place: usize, len: usize| {
                    let (minus, plus) = (node - stride, node + stride);
                    let before = phi.data[minus].abs() < phi.data[plus].abs() - ALIKE;
                    let (source, place) = if before { (minus, place - 1) } else { (plus, place + 1) };
                    let v = phi.data[source].abs();
                    let speaks = v < band.gamma() && (RIM..len - RIM).contains(&place);
                    (source, if speaks { (at - v).max(0.0) } else { 0.0 })
                };
                let ((x, gain_x), (y, gain_y)) = (closer(1, column, nx), closer(nx, row, ny));
                let (wx, wy) = (gain_x / (h[0] * h[0]), gain_y / (h[1] * h[1]));
                if wx + wy > 1e-12 { (x as u32, y as u32, wx / (wx + wy)) } else { keep }
            }));
        }
    }

    /// `passes` Jacobi passes over `channels` interleaved values per pixel.
    pub fn extend<const C: usize>(
        &self,
        values: &mut [[f64; C]],
        band: &Band,
        passes: usize,
        scratch: &mut Vec<[f64; C]>,
    ) {
        for _ in 0..passes {
            scratch.clear();
            scratch.extend(self.sources.iter().map(|&(x, y, wx)| {
                let (a, b) = (values[x as usize], values[y as usize]);
                std::array::from_fn(|c| wx * a[c] + (1.0 - wx) * b[c])
            }));
            let mut k = 0;
            for run in &band.runs {
                values[run.nodes()].copy_from_slice(&scratch[k..k + run.len]);
                k += run.len;
            }
        }
    }
}
