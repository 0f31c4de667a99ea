//! Values of seeds at the pixels of a contour: each such pixel takes the kernel-weighted mean of the seeds near its closest contour point.
//!
//! Gathered through cell bins in seed order, never scattered: the result cannot depend on the order in which threads run.

use glam::DVec2;

use super::band::Band;
use crate::grid::field::{Field, distance};

/// Reach of the kernel `(1 - d / R)^2`, px.
pub const RADIUS: f64 = 1.5;
/// Rounds of filling from neighbours for contour pixels that no seed reaches.
pub const FILL_ROUNDS: usize = 30;

/// Values per pixel, dense over the tile: seed values at the contour's pixels, zero elsewhere.
pub fn scatter<const C: usize>(
    phi: &Field,
    band: &Band,
    h: [f64; 2],
    seeds: &[DVec2],
    values: &[[f64; C]],
) -> Vec<[f64; C]> {
    let bins = Bins::new(phi.dims, h, seeds);
    let mut out = vec![[0.0; C]; phi.data.len()];
    let mut known = vec![false; phi.data.len()];
    let mut unknown = Vec::new();
    for node in band.nodes().filter(|&n| phi.at_contour(n)) {
        let x = phi.closest_point(node, h);
        let (mut sum, mut total) = ([0.0; C], 0.0);
        bins.near(x, |k| {
            let w = (1.0 - distance(seeds[k], x, h) / RADIUS).max(0.0).powi(2);
            total += w;
            sum.iter_mut().zip(&values[k]).for_each(|(s, v)| *s += w * v);
        });
        if total > 1e-6 {
            out[node] = sum.map(|s| s / total);
            known[node] = true;
        } else {
            unknown.push(node);
        }
    }
    fill(&mut out, &mut known, unknown, phi.dims[0]);
    out
}

/// Pixels without seeds take the mean of their known neighbours at the contour, ring by ring.
fn fill<const C: usize>(out: &mut [[f64; C]], known: &mut [bool], mut unknown: Vec<usize>, nx: usize) {
    for _ in 0..FILL_ROUNDS {
        if unknown.is_empty() {
            return;
        }
        let mut found = Vec::new();
        for &node in &unknown {
            let (mut sum, mut total) = ([0.0; C], 0.0);
            for row in [node - nx, node, node + nx] {
                for n in (row - 1..=row + 1).filter(|&n| known[n]) {
                    total += 1.0;
                    sum.iter_mut().zip(&out[n]).for_each(|(s, v)| *s += v);
                }
            }
            if total > 0.0 {
                found.push((node, sum.map(|s| s / total)));
            }
        }
        for &(node, value) in &found {
            out[node] = value;
            known[node] = true;
        }
        unknown.retain(|&n| !known[n]);
    }
}

/// Seeds sorted into square cells a kernel radius wide.
struct Bins {
    size: [f64; 2],
    cells: [usize; 2],
    first: Vec<u32>,
    seeds: Vec<u32>,
}

impl Bins {
    fn new(dims: [usize; 2], h: [f64; 2], seeds: &[DVec2]) -> Self {
        let size = h.map(|h| RADIUS / h);
        let cells = std::array::from_fn(|a| (dims[a] as f64 / size[a]) as usize + 1);
        let mut bins = Bins { size, cells, first: vec![0; cells[0] * cells[1] + 1], seeds: vec![0; seeds.len()] };
        for x in seeds {
            let [i, j] = bins.cell(*x);
            bins.first[j * cells[0] + i + 1] += 1;
        }
        for k in 1..bins.first.len() {
            bins.first[k] += bins.first[k - 1];
        }
        let mut fill = bins.first.clone();
        for (k, x) in seeds.iter().enumerate() {
            let [i, j] = bins.cell(*x);
            let slot = &mut fill[j * cells[0] + i];
            bins.seeds[*slot as usize] = k as u32;
            *slot += 1;
        }
        bins
    }

    fn cell(&self, x: DVec2) -> [usize; 2] {
        std::array::from_fn(|a| ((x[a] / self.size[a]).max(0.0) as usize).min(self.cells[a] - 1))
    }

    fn near(&self, x: DVec2, mut visit: impl FnMut(usize)) {
        let [i, j] = self.cell(x);
        for row in j.saturating_sub(1)..=(j + 1).min(self.cells[1] - 1) {
            let (low, high) = (i.saturating_sub(1), (i + 1).min(self.cells[0] - 1));
            let (from, to) = (self.first[row * self.cells[0] + low], self.first[row * self.cells[0] + high + 1]);
            self.seeds[from as usize..to as usize].iter().for_each(|&k| visit(k as usize));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_takes_the_mean_of_its_seeds_by_their_distance_from_its_contour_point() {
        // A straight contour at column 7.5; seeds on it 0.3 px above and 0.9 px below row 8, and one out of reach.
        let mut phi = Field::from_fn([16; 2], |i, _| i as f64 - 7.5);
        let band = Band::new(&mut phi, 4.0);
        let seeds = [[7.5, 8.3], [7.5, 7.1], [7.5, 10.0]].map(DVec2::from);
        let found = scatter(&phi, &band, [1.0; 2], &seeds, &[[2.0], [5.0], [100.0]]);
        let [near, far] = [0.3, 0.9].map(|d: f64| (1.0 - d / 1.5).powi(2));
        let expected = (2.0 * near + 5.0 * far) / (near + far);
        for node in [8 * 16 + 7, 8 * 16 + 8] {
            assert!((found[node][0] - expected).abs() < 1e-6, "{} for {expected}", found[node][0]);
        }
    }
}
