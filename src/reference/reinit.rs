//! Reinitialisation `phi_tau + S(phi) (|grad phi| - 1) = 0` in the tube N (Eq. 6): forward Euler, WENO5, smeared sign.

use glam::DVec2;
use multiversion::multiversion;

use super::band::Band;
use super::hj_step::{Scratch, WenoRows, stencil};
use crate::grid::field::Field;
use crate::grid::stencil::{REACH, godunov, one_sided, smeared_sign};

/// Pseudo-time step in pixels of the smaller side.
pub const STEP: f64 = 0.5;

/// `iterations` steps with the sign S of the field as it comes in.
pub fn reinit(phi: &mut Field, band: &Band, h: [f64; 2], iterations: usize, scratch: &mut Scratch) {
    relax_by(STEP, phi, band, h, iterations, scratch);
}

/// This share of a step: what one step of a moving front calls for, see [`crate::grid::stencil::step_share`].
pub fn reinit_share(share: f64, phi: &mut Field, band: &Band, h: [f64; 2], scratch: &mut Scratch) {
    relax_by(share * STEP, phi, band, h, 1, scratch);
}

fn relax_by(step: f64, phi: &mut Field, band: &Band, h: [f64; 2], iterations: usize, scratch: &mut Scratch) {
    let dtau = step * h[0].min(h[1]);
    let room = band.room();
    scratch.start.resize(room, 0.0);
    scratch.next.resize(room, 0.0);
    let mut k = 0;
    for run in &band.runs {
        signs(&phi.data, phi.dims[0], run.start, h, &mut scratch.start[k..k + run.room()]);
        k += run.room();
    }
    for _ in 0..iterations {
        let mut k = 0;
        for run in &band.runs {
            let (sign, next) = (&scratch.start[k..k + run.room()], &mut scratch.next[k..k + run.room()]);
            relax(&phi.data, phi.dims[0], run.start, h, dtau, sign, next);
            k += run.room();
        }
        let mut k = 0;
        for run in &band.runs {
            phi.data[run.nodes()].copy_from_slice(&scratch.next[k..k + run.len]);
            k += run.room();
        }
    }
}

/// `out <- S(phi)` from a run's start on, gradients by central differences, which go to the steeper side where the contour comes near: on the ridge of a
/// part of about a pixel both sides cancel out, S would be 1 there and a fraction beside it, and the ridge would come up to the contour while the other
/// side stays.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn signs(phi: &[f64], nx: usize, start: usize, h: [f64; 2], out: &mut [f64]) {
    let WenoRows { along, across } = WenoRows::new(phi, nx, start, out.len());
    let (per_x, per_y) = (1.0 / h[0], 1.0 / h[1]);
    for k in 0..out.len() {
        let s = &mut out[k];
        let slope = |v: &[&[f64]; 7]| {
            let [below, own, above] = [REACH - 1, REACH, REACH + 1].map(|at| v[at][k]);
            let mean = 0.5 * (above - below).abs();
            let steeper = (own - below).abs().max((above - own).abs());
            // Pixels to the contour by that side, less than 1 where it passes on it.
            let near = (steeper - own.abs()).max(0.0) / steeper.max(f64::MIN_POSITIVE);
            mean + near * (steeper - mean)
        };
        let gradient = DVec2::new(slope(&along) * per_x, slope(&across) * per_y);
        *s = smeared_sign(across[REACH][k], gradient);
    }
}

/// `next <- phi - dtau S (|grad phi| - 1)` from a run's start on.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn relax(phi: &[f64], nx: usize, start: usize, h: [f64; 2], dtau: f64, sign: &[f64], next: &mut [f64]) {
    let WenoRows { along, across } = WenoRows::new(phi, nx, start, next.len());
    let (per_x, per_y) = (1.0 / h[0], 1.0 / h[1]);
    let sign = &sign[..next.len()];
    for k in 0..next.len() {
        let out = &mut next[k];
        let s = sign[k];
        let dx = one_sided(stencil(&along, k), per_x);
        let dy = one_sided(stencil(&across, k), per_y);
        *out = across[REACH][k] - dtau * s * (godunov(dx, dy, s) - 1.0);
    }
}
