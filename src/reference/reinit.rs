//! Reinitialisation `phi_tau + S(phi) (|grad phi| - 1) = 0` in the tube N (Eq. 6): forward Euler, WENO5, smeared sign.

use multiversion::multiversion;

use super::band::{Band, Run};
use super::hj_step::{Scratch, Window};
use crate::field::Field;
use crate::stencil::{REACH, godunov, one_sided, smeared_sign};

/// Pseudo-time step in pixels of the smaller side.
pub const STEP: f64 = 0.5;

/// `iterations` steps with the sign S of the field as it comes in.
pub fn reinit(phi: &mut Field, band: &Band, h: [f64; 2], iterations: usize, scratch: &mut Scratch) {
    relax_by(STEP, phi, band, h, iterations, scratch);
}

/// This share of a step: what one step of a moving front calls for, see [`crate::stencil::step_share`].
pub fn reinit_share(share: f64, phi: &mut Field, band: &Band, h: [f64; 2], scratch: &mut Scratch) {
    relax_by(share * STEP, phi, band, h, 1, scratch);
}

fn relax_by(step: f64, phi: &mut Field, band: &Band, h: [f64; 2], iterations: usize, scratch: &mut Scratch) {
    let dtau = step * h[0].min(h[1]);
    scratch.start.clear();
    scratch.start.resize(band.count, 0.0);
    scratch.next.resize(band.count, 0.0);
    let mut k = 0;
    for run in &band.runs {
        signs(&phi.data, phi.dims[0], *run, h, &mut scratch.start[k..k + run.len]);
        k += run.len;
    }
    for _ in 0..iterations {
        let mut k = 0;
        for run in &band.runs {
            let (sign, next) = (&scratch.start[k..k + run.len], &mut scratch.next[k..k + run.len]);
            relax(&phi.data, phi.dims[0], *run, h, dtau, sign, next);
            k += run.len;
        }
        let mut k = 0;
        for run in &band.runs {
            phi.data[run.nodes()].copy_from_slice(&scratch.next[k..k + run.len]);
            k += run.len;
        }
    }
}

/// `out <- S(phi)` along one run, gradients by central differences.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn signs(phi: &[f64], nx: usize, run: Run, h: [f64; 2], out: &mut [f64]) {
    let Window { along, across } = Window::new(phi, nx, run);
    let (per_x, per_y) = (0.5 / h[0], 0.5 / h[1]);
    for (k, s) in out[..run.len].iter_mut().enumerate() {
        let dx = (along[k + REACH + 1] - along[k + REACH - 1]) * per_x;
        let dy = (across[REACH + 1][k] - across[REACH - 1][k]) * per_y;
        *s = smeared_sign(across[REACH][k], [dx, dy]);
    }
}

/// `next <- phi - dtau S (|grad phi| - 1)` along one run.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn relax(phi: &[f64], nx: usize, run: Run, h: [f64; 2], dtau: f64, sign: &[f64], next: &mut [f64]) {
    let Window { along, across } = Window::new(phi, nx, run);
    let (per_x, per_y) = (1.0 / h[0], 1.0 / h[1]);
    let sign = &sign[..run.len];
    for (k, out) in next[..run.len].iter_mut().enumerate() {
        let s = sign[k];
        let dx = one_sided(std::array::from_fn(|q| along[k + q]), per_x);
        let dy = one_sided(std::array::from_fn(|q| across[q][k]), per_y);
        *out = across[REACH][k] - dtau * s * (godunov(dx, dy, s) - 1.0);
    }
}
