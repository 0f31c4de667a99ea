//! Extension of values off the contour along its normals, `F_tau + S(phi) n . grad F = 0` (Eq. 3), by Jacobi passes of its steady
//! first-order upwind form (Adalsteinsson and Sethian 1999): every pixel takes the mean of its neighbours that lie closer to the
//! contour, weighted by how much closer; only pixels of the tube T are looked at. Pixels at the contour keep their values.

use super::band::Band;
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
        let nx = phi.dims[0];
        self.sources.clear();
        self.sources.extend(band.nodes().map(|node| {
            let keep = (node as u32, node as u32, 1.0);
            if phi.at_contour(node) {
                return keep;
            }
            let at = phi.data[node].abs();
            let closer = |minus: usize, plus: usize| {
                let source = if phi.data[minus].abs() < phi.data[plus].abs() - ALIKE { minus } else { plus };
                let v = phi.data[source].abs();
                (source, if v < band.gamma() { (at - v).max(0.0) } else { 0.0 })
            };
            let ((x, gain_x), (y, gain_y)) = (closer(node - 1, node + 1), closer(node - nx, node + nx));
            let (wx, wy) = (gain_x / (h[0] * h[0]), gain_y / (h[1] * h[1]));
            if wx + wy > 1e-12 { (x as u32, y as u32, wx / (wx + wy)) } else { keep }
        }));
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
