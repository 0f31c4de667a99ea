//! The tubes of Peng et al. 1999 around a contour: T = {|phi| < gamma}, where phi moves, and N = T and its ring of eight neighbours,
//! where phi is kept a distance. Outside N phi is `+-(gamma + 1/2)`.
//!
//! N is kept as runs of consecutive pixels in row order, so that kernels stream through memory. A rebuild looks at the old tube and
//! its ring only: its cost follows the contour, not the tile.

use std::ops::Range;

use crate::grid::field::Field;
use crate::grid::stencil::REACH;

/// Pixels at a tile's edge that never belong to a tube: a WENO5 stencil and one more.
pub const RIM: usize = REACH + 1;

/// Pixels that kernels work on at once. Runs are hardly longer than two tubes are wide: what is left of one is worked on together with pixels
/// beyond its end, which the rim holds and whose results nobody takes; one by one it would cost as much as all the rest.
pub const LANES: usize = 8;

/// Consecutive pixels `start..start + len` of one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelRun {
    /// First node.
    pub start: usize,
    /// Number of nodes.
    pub len: usize,
}

/// Runs of the tube N around the contour of a field.
#[derive(Debug, Clone)]
pub struct Band {
    /// Runs in row order; no two touch.
    pub runs: Vec<PixelRun>,
    /// Pixels in all runs.
    pub count: usize,
    gamma: f64,
    /// Runs of T.
    tube: Vec<PixelRun>,
    /// Runs of N before the last rebuild.
    old: Vec<PixelRun>,
}

impl Band {
    /// The tube of `phi`, found by looking at the whole tile once; sets phi outside N.
    pub fn new(phi: &mut Field, gamma: f64) -> Self {
        let [nx, ny] = phi.dims;
        let whole = (RIM..ny.saturating_sub(RIM))
            .filter(|_| nx > 2 * RIM)
            .map(|j| PixelRun { start: j * nx + RIM, len: nx - 2 * RIM })
            .collect();
        let mut band = Band { runs: whole, count: 0, gamma, tube: Vec::new(), old: Vec::new() };
        let out = gamma + 0.5;
        for v in &mut phi.data {
            *v = v.clamp(-out, out);
        }
        band.rebuild(phi);
        band
    }

    /// Follows the contour after phi has moved: the new T lies in the old N.
    pub fn rebuild(&mut self, phi: &mut Field) {
        std::mem::swap(&mut self.runs, &mut self.old);
        self.find_tube(phi);
        self.collect(phi.dims);
        self.leave(phi);
    }

    /// Gathers the runs of T.
    fn find_tube(&mut self, phi: &Field) {
        self.tube.clear();
        for run in &self.old {
            let mut within = phi.data[run.nodes()].iter().map(|v| v.abs() < self.gamma);
            let mut start = run.start;
            while let Some(before) = within.position(|within| within) {
                start += before;
                let more = within.position(|within| !within);
                let len = more.map_or(run.start + run.len - start, |more| more + 1);
                self.tube.push(PixelRun { start, len });
                start += len + 1;
            }
        }
    }

    /// Gathers N, the pixels of T and those beside them, in row order.
    fn collect(&mut self, [nx, ny]: [usize; 2]) {
        self.runs.clear();
        self.count = 0;
        let rows = |r: &PixelRun| r.start / nx;
        let (Some(first), Some(last)) = (self.tube.first().map(rows), self.tube.last().map(rows)) else { return };
        let mut cursor = 0;
        let mut spans: Vec<(usize, usize)> = Vec::new();
        for j in first.saturating_sub(1).max(RIM)..=(last + 1).min(ny - 1 - RIM) {
            spans.clear();
            while cursor < self.tube.len() && rows(&self.tube[cursor]) + 1 < j {
                cursor += 1;
            }
            for run in self.tube[cursor..].iter().take_while(|r| rows(r) <= j + 1) {
                let column = run.start % nx;
                spans.push(((column - 1).max(RIM), (column + run.len + 1).min(nx - RIM)));
            }
            spans.sort_unstable();
            let mut next = 0;
            for &(low, high) in &spans {
                if high > next {
                    let low = low.max(next);
                    self.push(j * nx + low, high - low);
                    next = high;
                }
            }
        }
    }

    /// Sets phi where N was and is no more.
    fn leave(&self, phi: &mut Field) {
        let out = self.gamma + 0.5;
        let mut stays = self.runs.iter().peekable();
        for run in &self.old {
            let Range { start: mut node, end } = run.nodes();
            while node < end {
                let next = match stays.peek() {
                    Some(run) if run.nodes().end <= node => {
                        stays.next();
                        continue;
                    }
                    Some(run) if run.start <= node => {
                        node = run.nodes().end;
                        continue;
                    }
                    Some(run) => run.start.min(end),
                    None => end,
                };
                phi.data[node..next].iter_mut().for_each(|v| *v = out.copysign(*v));
                node = next;
            }
        }
    }

    fn push(&mut self, start: usize, len: usize) {
        self.count += len;
        match self.runs.last_mut() {
            // What lies beside two runs of T may touch.
            Some(r) if r.start + r.len == start => r.len += len,
            _ => self.runs.push(PixelRun { start, len }),
        }
    }

    /// Half width of the tube T, px.
    pub fn gamma(&self) -> f64 {
        self.gamma
    }

    /// Places of all runs, see [`PixelRun::room`].
    pub fn room(&self) -> usize {
        self.runs.iter().map(PixelRun::room).sum()
    }

    /// All nodes of N in row order.
    pub fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|r| r.nodes())
    }
}

impl PixelRun {
    /// Places that a run has in what is kept in band order.
    #[inline(always)]
    pub fn room(&self) -> usize {
        self.len.next_multiple_of(LANES)
    }

    /// Nodes of the run.
    #[inline(always)]
    pub fn nodes(&self) -> Range<usize> {
        self.start..self.start + self.len
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_that_is_all_rim_has_no_tube() {
        for dims in [[2 * RIM - 1, 30], [2 * RIM, 30], [30, 2 * RIM - 1], [30, 2 * RIM], [3, 3], [1, 1]] {
            let mut phi = Field::filled(dims, 0.5);
            assert_eq!(Band::new(&mut phi, 6.0).nodes().count(), 0, "{dims:?}");
        }
        let mut phi = Field::filled([2 * RIM + 1, 2 * RIM + 2], 0.5);
        assert!(Band::new(&mut phi, 6.0).nodes().count() >= 2);
    }
}
