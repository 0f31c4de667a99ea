//! One TVD-RK3 step of `phi_t + F |grad phi| = 0` in the tube (algorithm: Godunov, WENO5, Peng's cut-off).

use multiversion::multiversion;

use super::band::Band;
use crate::grid::field::Field;
use crate::grid::stencil::{REACH, TVD_RK3, cut_off, godunov, one_sided};

/// Source of the speed F.
#[derive(Debug, Clone, Copy)]
pub enum Speed<'a> {
    /// `F = phi - goal`, taken anew in every stage: the morph of Eq. 2.
    Towards(&'a Field),
    /// A given field, frozen over the step.
    Given(&'a Field),
}

/// Limits of the tube, px: full speed up to `beta`, none from `gamma`.
#[derive(Debug, Clone, Copy)]
pub struct Tube {
    /// Start of the cut-off.
    pub beta: f64,
    /// Half width.
    pub gamma: f64,
}

/// Buffers of a step, in band order, each run with all its room; kept by the caller so that a step allocates nothing once they have grown.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    /// phi at the start of the step.
    pub start: Vec<f64>,
    /// Right-hand side, or the next phi.
    pub next: Vec<f64>,
}

/// Moves `phi` by `dt` within the band. Pixels of N beyond T do not move: their cut-off is zero.
pub fn hj_step(
    phi: &mut Field,
    speed: Speed<'_>,
    band: &Band,
    h: [f64; 2],
    tube: Tube,
    dt: f64,
    scratch: &mut Scratch,
) {
    let room = band.room();
    scratch.start.resize(room, 0.0);
    scratch.next.resize(room, 0.0);
    let mut k = 0;
    for run in &band.runs {
        scratch.start[k..k + run.len].copy_from_slice(&phi.data[run.nodes()]);
        k += run.room();
    }
    for (a, b) in TVD_RK3 {
        let mut k = 0;
        for run in &band.runs {
            let rhs = &mut scratch.next[k..k + run.room()];
            let at = &phi.data[run.nodes()];
            match speed {
                Speed::Towards(goal) => {
                    for ((f, p), t) in rhs.iter_mut().zip(at).zip(&goal.data[run.nodes()]) {
                        *f = p - t;
                    }
                }
                Speed::Given(field) => rhs[..run.len].copy_from_slice(&field.data[run.nodes()]),
            }
            right_hand_side(&phi.data, phi.dims[0], run.start, h, tube, rhs);
            k += run.room();
        }
        let mut k = 0;
        for run in &band.runs {
            let (start, rhs) = (&scratch.start[k..k + run.len], &scratch.next[k..k + run.len]);
            for ((p, u0), l) in phi.data[run.nodes()].iter_mut().zip(start).zip(rhs) {
                *p = a * u0 + b * (*p + dt * l);
            }
            k += run.room();
        }
    }
}

/// `out <- -F c(phi) |grad phi|` from a run's start on, where `out` holds F on entry.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn right_hand_side(phi: &[f64], nx: usize, start: usize, h: [f64; 2], tube: Tube, out: &mut [f64]) {
    let WenoRows { along, across } = WenoRows::new(phi, nx, start, out.len());
    let (per_x, per_y) = (1.0 / h[0], 1.0 / h[1]);
    for k in 0..out.len() {
        let f = &mut out[k];
        let center = across[REACH][k];
        let c = cut_off(center, tube.beta, tube.gamma);
        let dx = one_sided(stencil(&along, k), per_x);
        let dy = one_sided(stencil(&across, k), per_y);
        *f = -*f * c * godunov(dx, dy, *f);
    }
}

/// The values a WENO5 stencil reads at pixels of a row, each a slice of what the pixels have there: from three pixels to the left to three to
/// the right, and from three rows below to three above.
pub(super) struct WenoRows<'a> {
    pub along: [&'a [f64]; 2 * REACH + 1],
    pub across: [&'a [f64]; 2 * REACH + 1],
}

impl<'a> WenoRows<'a> {
    /// Around `count` pixels.
    #[inline(always)]
    pub fn new(phi: &'a [f64], nx: usize, start: usize, count: usize) -> Self {
        let from = |first: usize| &phi[first..][..count];
        let row = |s: usize| from(start + s * nx - REACH * nx);
        let column = |s: usize| from(start + s - REACH);
        // One by one, since `from_fn` is not inlined into kernels: with lengths unknown every value's place would be checked, and a loop that
        // may stop at any pixel does its last ones one by one.
        WenoRows {
            along: [column(0), column(1), column(2), column(3), column(4), column(5), column(6)],
            across: [row(0), row(1), row(2), row(3), row(4), row(5), row(6)],
        }
    }
}

/// Differences that pixel `k` finds in one direction.
#[inline(always)]
pub(super) fn stencil([a, b, c, d, e, f, g]: &[&[f64]; 2 * REACH + 1], k: usize) -> [f64; 2 * REACH + 1] {
    [a[k], b[k], c[k], d[k], e[k], f[k], g[k]]
}
