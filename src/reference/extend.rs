//! Extension of values off the contour along its normals, `F_tau + S(phi) n . grad F = 0` (Eq. 3), by Jacobi passes of its steady
//! first-order upwind form (Adalsteinsson and Sethian 1999): every pixel takes the mean of its neighbours that lie closer to the
//! contour, weighted by how much closer; only pixels of the tube T are looked at, none of the tile's rim, which moves with no contour. Pixels at
//! the contour keep their values. Of two that lie before and behind, both as close, the mean counts: turned, the part is the same.

use super::band::{Band, RIM};
use crate::grid::field::Field;

/// Neighbours to either side that differ by less than this are as close, px: on the middle line of a part neither rounding nor the direction in which
/// pixels are numbered must decide from which of its sides a value comes.
pub const ALIKE: f64 = 1e-3;

/// Upwind neighbours of the pixels of a band, found once per front and used for every channel and pass.
#[derive(Debug, Clone, Default)]
pub struct Upwind {
    /// `(node in x, node in y, weight of x)` in band order; a pixel that keeps its value points at itself.
    sources: Vec<(u32, u32, f64)>,
    /// Pixels with two neighbours in x or in y that are as close, by their place in the band, and both of either.
    between: Vec<(usize, [u32; 2], [u32; 2])>,
}

impl Upwind {
    /// Sources for all pixels of `band` around the contour of `phi`.
    pub fn find(&mut self, phi: &Field, band: &Band, h: [f64; 2]) {
        let [nx, ny] = phi.dims;
        self.sources.clear();
        self.between.clear();
        for run in &band.runs {
            let [column, row] = [run.start % nx, run.start / nx];
            let first = self.sources.len();
            let between = &mut self.between;
            self.sources.extend(run.nodes().zip(column..).enumerate().map(|(k, (node, column))| {
                let keep = (node as u32, node as u32, 1.0);
                if phi.at_contour(node) {
                    return keep;
                }
                let at = phi.data[node].abs();
                let gain = |v: f64, speaks: bool| if speaks { (at - v).max(0.0) } else { 0.0 };
                // The closer of the neighbours before and behind in a row or column of pixels, none of its rim, twice, or both.
                let closer = |stride: usize, place: usize, len: usize| {
                    let (minus, plus) = (node - stride, node + stride);
                    let [before, behind] = [minus, plus].map(|n| phi.data[n].abs());
                    let speaks = |v: f64, place: usize| v < band.gamma() && (RIM..len - RIM).contains(&place);
                    if before < behind - ALIKE {
                        return ([minus; 2], gain(before, speaks(before, place - 1)));
                    }
                    if behind < before - ALIKE {
                        return ([plus; 2], gain(behind, speaks(behind, place + 1)));
                    }
                    match [speaks(before, place - 1), speaks(behind, place + 1)] {
                        [true, false] => ([minus; 2], gain(before, true)),
                        [false, speaks] => ([plus; 2], gain(behind, speaks)),
                        [true, true] => ([minus, plus], gain(0.5 * (before + behind), true)),
                    }
                };
                let ((x, gain_x), (y, gain_y)) = (closer(1, column, nx), closer(nx, row, ny));
                let (wx, wy) = (gain_x / (h[0] * h[0]), gain_y / (h[1] * h[1]));
                if wx + wy <= 1e-12 {
                    return keep;
                }
                if (gain_x > 0.0 && x[0] != x[1]) || (gain_y > 0.0 && y[0] != y[1]) {
                    between.push((first + k, x.map(|n| n as u32), y.map(|n| n as u32)));
                }
                (x[0] as u32, y[0] as u32, wx / (wx + wy))
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
            for &(k, x, y) in &self.between {
                let wx = self.sources[k].2;
                let mean = |[a, b]: [u32; 2], c: usize| 0.5 * (values[a as usize][c] + values[b as usize][c]);
                scratch[k] = std::array::from_fn(|c| wx * mean(x, c) + (1.0 - wx) * mean(y, c));
            }
            let mut k = 0;
            for run in &band.runs {
                values[run.nodes()].copy_from_slice(&scratch[k..k + run.len]);
                k += run.len;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_the_middle_line_of_a_wall_both_sides_count() {
        let (dims, middle) = ([30, 30], 15.0);
        for along in [0, 1] {
            let away = |i: usize, j: usize| ([i, j][along] as f64 - middle).abs() - 3.4;
            let mut phi = Field::from_fn(dims, away);
            let band = Band::new(&mut phi, 6.0);
            let mut upwind = Upwind::default();
            upwind.find(&phi, &band, [1.0; 2]);
            // Seen from the middle each side has a value of its own.
            let mut values: Vec<[f64; 1]> =
                (0..30 * 30).map(|n| [if ([n % 30, n / 30][along] as f64) < middle { 1.0 } else { 4.0 }]).collect();
            upwind.extend(&mut values, &band, 8, &mut Vec::new());
            let at = |across: usize| values[[15 * 30 + across, across * 30 + 15][along]][0];
            assert_eq!([13, 14, 15, 16, 17].map(at), [1.0, 1.0, 2.5, 4.0, 4.0]);
        }
    }
}
