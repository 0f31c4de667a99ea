//! The tubes of Peng et al. 1999 around a contour: T = {|phi| < gamma}, where phi moves, and N = T and its ring of eight neighbours,
//! where phi is kept a distance. Outside N phi is `+-(gamma + 1/2)`.
//!
//! N is kept as runs of consecutive pixels in row order, so that kernels stream through memory. A rebuild looks at the old tube and
//! its ring only: its cost follows the contour, not the tile.

use crate::field::Field;
use crate::stencil::REACH;

/// Pixels at a tile's edge that never belong to a tube: a WENO5 stencil and one more.
pub const RIM: usize = REACH + 1;

/// Consecutive pixels `start..start + len` of one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// First node.
    pub start: usize,
    /// Number of nodes.
    pub len: usize,
}

/// Runs of the tube N around the contour of a field.
#[derive(Debug, Clone)]
pub struct Band {
    /// Runs in row order; no two touch.
    pub runs: Vec<Run>,
    /// Pixels in all runs.
    pub count: usize,
    gamma: f64,
    mark: Vec<u8>,
    old: Vec<Run>,
}

const OUT: u8 = 0;
const RING: u8 = 1;
const TUBE: u8 = 2;

impl Band {
    /// The tube of `phi`, found by looking at the whole tile once; sets phi outside N.
    pub fn new(phi: &mut Field, gamma: f64) -> Self {
        let [nx, ny] = phi.dims;
        let whole = (RIM..ny.saturating_sub(RIM))
            .filter(|_| nx > 2 * RIM)
            .map(|j| Run { start: j * nx + RIM, len: nx - 2 * RIM })
            .collect();
        let mut band = Band { runs: whole, count: 0, gamma, mark: vec![OUT; nx * ny], old: Vec::new() };
        let out = gamma + 0.5;
        for v in &mut phi.data {
            *v = v.clamp(-out, out);
        }
        band.rebuild(phi);
        band
    }

    /// Follows the contour after phi has moved: the new T lies in the old N.
    pub fn rebuild(&mut self, phi: &mut Field) {
        let [nx, ny] = phi.dims;
        std::mem::swap(&mut self.runs, &mut self.old);
        self.runs.clear();
        for run in &self.old {
            for node in run.nodes() {
                self.mark[node] = if phi.data[node].abs() < self.gamma { TUBE } else { OUT };
            }
        }
        for run in &self.old {
            for node in run.nodes() {
                if self.mark[node] == TUBE {
                    for row in [node - nx, node, node + nx] {
                        for n in row - 1..=row + 1 {
                            self.mark[n] = self.mark[n].max(RING);
                        }
                    }
                }
            }
        }
        let out = self.gamma + 0.5;
        for run in &self.old {
            for node in run.nodes() {
                if self.mark[node] == OUT {
                    phi.data[node] = out.copysign(phi.data[node]);
                }
            }
        }
        self.collect([nx, ny]);
    }

    /// Gathers the marked pixels of the old runs and their ring in row order.
    fn collect(&mut self, [nx, ny]: [usize; 2]) {
        self.count = 0;
        // Three cursors walk the old runs of the rows above, at and below the row being collected.
        let rows = |r: &Run| r.start / nx;
        let (Some(first), Some(last)) = (self.old.first().map(rows), self.old.last().map(rows)) else { return };
        let mut cursor = 0;
        let mut spans: Vec<(usize, usize)> = Vec::new();
        for j in first.saturating_sub(1).max(RIM)..=(last + 1).min(ny - 1 - RIM) {
            spans.clear();
            while cursor < self.old.len() && rows(&self.old[cursor]) + 1 < j {
                cursor += 1;
            }
            for run in self.old[cursor..].iter().take_while(|r| rows(r) <= j + 1) {
                let column = run.start % nx;
                spans.push((column.saturating_sub(1).max(RIM), (column + run.len + 1).min(nx - RIM)));
            }
            spans.sort_unstable();
            let mut next = 0;
            for &(low, high) in &spans {
                let mut i = low.max(next);
                while i < high {
                    if self.mark[j * nx + i] == OUT {
                        i += 1;
                        continue;
                    }
                    let start = i;
                    while i < high && self.mark[j * nx + i] != OUT {
                        i += 1;
                    }
                    self.push(j * nx + start, i - start);
                }
                next = next.max(high);
            }
        }
    }

    fn push(&mut self, start: usize, len: usize) {
        self.count += len;
        match self.runs.last_mut() {
            // A run cut by the end of a span goes on here.
            Some(r) if r.start + r.len == start => r.len += len,
            _ => self.runs.push(Run { start, len }),
        }
    }

    /// Half width of the tube T, px.
    pub fn gamma(&self) -> f64 {
        self.gamma
    }

    /// All nodes of N in row order.
    pub fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|r| r.nodes())
    }
}

impl Run {
    /// Nodes of the run.
    #[inline(always)]
    pub fn nodes(&self) -> std::ops::Range<usize> {
        self.start..self.start + self.len
    }
}
