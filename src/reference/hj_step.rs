//! One TVD-RK3 step of `phi_t + F |grad phi| = 0` in the tube (algorithm: Godunov, WENO5, Peng's cut-off).

use multiversion::multiversion;

use super::band::{Band, Run};
use crate::field::Field;
use crate::stencil::{REACH, TVD_RK3, cut_off, godunov, one_sided};

/// Where the speed F comes from.
#[derive(Debug, Clone, Copy)]
pub enum Speed<'a> {
    /// `F = phi - target`, taken anew in every stage: the morph of Eq. 2.
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

/// Buffers of a step, in band order; kept by the caller so that a step allocates nothing once they have grown.
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
    scratch.start.clear();
    for run in &band.runs {
        scratch.start.extend_from_slice(&phi.data[run.nodes()]);
    }
    scratch.next.resize(band.count, 0.0);
    for (a, b) in TVD_RK3 {
        let mut k = 0;
        for run in &band.runs {
            let rhs = &mut scratch.next[k..k + run.len];
            let at = &phi.data[run.nodes()];
            match speed {
                Speed::Towards(target) => {
                    for ((f, p), t) in rhs.iter_mut().zip(at).zip(&target.data[run.nodes()]) {
                        *f = p - t;
                    }
                }
                Speed::Given(field) => rhs.copy_from_slice(&field.data[run.nodes()]),
            }
            right_hand_side(&phi.data, phi.dims[0], *run, h, tube, rhs);
            k += run.len;
        }
        let mut k = 0;
        for run in &band.runs {
            let (start, rhs) = (&scratch.start[k..k + run.len], &scratch.next[k..k + run.len]);
            for ((p, u0), l) in phi.data[run.nodes()].iter_mut().zip(start).zip(rhs) {
                *p = a * u0 + b * (*p + dt * l);
            }
            k += run.len;
        }
    }
}

/// `out <- -F c(phi) |grad phi|` along one run, where `out` holds F on entry.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn right_hand_side(phi: &[f64], nx: usize, run: Run, h: [f64; 2], tube: Tube, out: &mut [f64]) {
    let Window { along, across } = Window::new(phi, nx, run);
    let (per_x, per_y) = (1.0 / h[0], 1.0 / h[1]);
    for (k, f) in out[..run.len].iter_mut().enumerate() {
        let center = across[REACH][k];
        let c = cut_off(center, tube.beta, tube.gamma);
        let dx = one_sided(std::array::from_fn(|s| along[k + s]), per_x);
        let dy = one_sided(std::array::from_fn(|s| across[s][k]), per_y);
        *f = -*f * c * godunov(dx, dy, *f);
    }
}

/// The values a WENO5 stencil reads along a run: its own row with three pixels to each side, and the seven rows around it.
pub(super) struct Window<'a> {
    pub along: &'a [f64],
    pub across: [&'a [f64]; 2 * REACH + 1],
}

impl<'a> Window<'a> {
    #[inline(always)]
    pub fn new(phi: &'a [f64], nx: usize, run: Run) -> Self {
        let first = run.start - REACH * nx;
        Window {
            along: &phi[run.start - REACH..run.start + run.len + REACH],
            across: std::array::from_fn(|s| &phi[first + s * nx..first + s * nx + run.len]),
        }
    }
}
