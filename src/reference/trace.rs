//! The morph of one contour onto the next with tracker particles: `phi_t = (phi_B - phi) |grad phi|` (Eq. 2).

use super::band::Band;
use super::hj_step::{Scratch, Speed, Tube, hj_step};
use super::particles::{Particle, correct, land, predict};
use super::reinit::reinit_share;
use crate::backend::MorphOptions;
use crate::backend::jobs::{TraceJob, Traced, Track, full_distance};
use crate::grid::field::Field;
use crate::grid::stencil::{COURANT, FRONT_REACH, step_share};
use crate::report::Residual;

/// Largest time step, of a whole one: the relaxation `phi_t = phi_B - phi` is unstable above 2.5 and already costs accuracy at 2.2.
pub const STEP_LIMIT: f64 = 0.5;
/// A front that has come this close and gains less than [`LEAST_GAIN`] in [`PATIENCE`] steps hangs at kinks of phi_B.
pub const STALL_BELOW: f64 = 1.0;
/// Least gain of a front that does not hang, px a whole step.
pub const LEAST_GAIN: f64 = 1e-3;
/// Whole steps without gain after which a front hangs.
pub const PATIENCE: f64 = 12.0;

/// A front has arrived that is this much farther away than the tolerance, px: pixels' edges are half a pixel apart, and rounding must not decide.
pub const SLACK: f64 = 1e-4;

/// Runs the morph until the front has arrived, stalls, or has used up its steps.
pub fn trace(job: &TraceJob<'_>, h: [f64; 2], options: &MorphOptions) -> Traced {
    let mut phi = job.source.clone().into_owned();
    let mut band = Band::new(&mut phi, options.half_width);
    let mut particles: Vec<Particle> = job.seeds.iter().map(Particle::at).collect();
    let tube = Tube { beta: options.cut_off, gamma: options.half_width };
    let mut scratch = Scratch::default();
    let mut out = Traced::default();
    let mut now = 0.0;
    let (mut best, mut idle) = (f64::INFINITY, 0);
    let (mut most_steps, share) = (None, step_share(options.cfl));
    let side = h[0].min(h[1]);
    loop {
        let residual = arrival(&phi, &job.goal, &band);
        let Some(r) = residual else { break };
        out.residual = r;
        let most = *most_steps.get_or_insert_with(|| ((3.0 * r.max / (COURANT * side) + 20.0) / share) as usize);
        idle = if r.max < best - LEAST_GAIN * share { 0 } else { idle + 1 };
        best = best.min(r.max);
        if r.max < options.tolerance + SLACK
            || (r.max < STALL_BELOW && idle as f64 * share > PATIENCE)
            || out.steps >= most
        {
            break;
        }
        let fastest = band
            .nodes()
            .filter(|&n| phi.data[n].abs() < FRONT_REACH)
            .map(|n| (phi.data[n] - job.goal.data[n]).abs())
            .fold(1e-9, f64::max);
        let dt = (options.cfl * side / fastest).min(STEP_LIMIT * share);
        predict(&mut particles, &phi, &job.goal, h, dt);
        hj_step(&mut phi, Speed::Towards(&job.goal), &band, h, tube, dt, &mut scratch);
        reinit_share(share, &mut phi, &band, h, &mut scratch);
        out.pixels += band.count;
        out.steps += 1;
        band.rebuild(&mut phi);
        now += dt;
        correct(&mut particles, &phi, &job.goal, h, dt, now);
    }
    land(&mut particles, &phi, &job.goal, h);
    out.tracks = particles
        .iter()
        .map(|p| Track {
            distance: full_distance(p.covered, p.kept, [p.own, p.share]),
            arc: p.arc,
            landing: p.x,
            kept: p.kept,
        })
        .collect();
    out
}

/// `|goal|` where the contour of `phi` crosses the edges between pixels; `None` where there is no contour.
pub fn arrival(phi: &Field, goal: &Field, band: &Band) -> Option<Residual> {
    let nx = phi.dims[0];
    let (mut sum, mut count, mut max) = (0.0, 0usize, 0.0f64);
    for node in band.nodes() {
        let a = phi.data[node];
        for next in [node + 1, node + nx] {
            let b = phi.data[next];
            if (a < 0.0) != (b < 0.0) {
                let f = a / (a - b);
                let v = ((1.0 - f) * goal.data[node] + f * goal.data[next]).abs();
                sum += v;
                count += 1;
                max = max.max(v);
            }
        }
    }
    (count > 0).then(|| Residual { mean: sum / count as f64, max })
}
