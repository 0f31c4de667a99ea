//! Tracker particles: advection along the normal, back-projection onto the front, distance covered, and what is left of them where fronts fork.

use glam::DVec2;

use crate::contour::seeds::Seed;
use crate::grid::field::{Field, distance};
use crate::grid::spline::smoothstep;

/// Way that back-projections move a particle in all, px, until nothing is left of it: more means that the front under it is gone and another piece
/// drags it along. The sum, unlike the move of one step, does not depend on how many steps there are. What is left falls all the way there: were it
/// all or nothing, the size of a step would say which of two neighbours at a fork dies.
pub const LOST: f64 = 1.2;
/// Distance from the front after back-projection, px, at which nothing is left of a particle: at a fork it has no front of its own.
pub const OFF_FRONT: f64 = 0.25;
/// Share of either length up to which a particle is whole: rounding of fronts moves every particle a little.
pub const WHOLE: f64 = 0.25;
/// Share of the way for which half the speed at the start stands: what is known of a particle that is lost at once. At rest it would differ too much
/// from its neighbours that are not lost; at the whole speed, thin lines would jump beside their contours.
pub const PRIOR: f64 = 0.05;
/// Newton steps of a back-projection.
pub const PROJECTIONS: usize = 2;

/// A particle on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Particle {
    /// Position, pixels of the tile.
    pub x: DVec2,
    /// `S = int F dt`, px, outward positive: signed by itself. No step adds more than twice the way made in it: the speed goes on where a front hangs
    /// at a kink of phi_B though nothing moves.
    pub covered: f64,
    /// Length of the path, px.
    pub arc: f64,
    /// Way that back-projections have moved it in all, px.
    pub dragged: f64,
    /// Share that is left of it, from 1 to 0.
    pub kept: f64,
    /// `int kept F dt`, px, and the share `int kept exp(-t) dt` of its way that the relaxation `F = phi - phi_B` covers meanwhile; both with
    /// [`PRIOR`].
    pub own: f64,
    /// See `own`.
    pub share: f64,
    predicted: DVec2,
    velocity: DVec2,
    speed: f64,
}

impl Particle {
    /// A particle at a seed.
    pub fn at(seed: &Seed) -> Self {
        let (predicted, velocity, speed) = (seed.x, DVec2::ZERO, 0.0);
        let (covered, arc, dragged, kept, own, share) = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0);
        Particle { x: seed.x, covered, arc, dragged, kept, own, share, predicted, velocity, speed }
    }
}

/// Velocity of Eq. 2 at `x`: `dx/dt = F n`, in pixels of each axis, and `F = phi(x) - phi_B(x)`.
fn motion(phi: &Field, goal: &Field, x: DVec2, h: [f64; 2]) -> (DVec2, f64) {
    let speed = phi.sample(x) - goal.sample(x);
    (speed * phi.normal(x, h) / DVec2::from(h), speed)
}

/// Predictor: an Euler step in the field before the front moves.
pub fn predict(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2], dt: f64) {
    for p in particles.iter_mut().filter(|p| p.kept > 0.0) {
        (p.velocity, p.speed) = motion(phi, goal, p.x, h);
        if p.share == 0.0 {
            (p.own, p.share) = (0.5 * PRIOR * p.speed, PRIOR);
        }
        p.predicted = p.x + dt * p.velocity;
    }
}

/// Corrector in the field after the front has moved (Heun), back-projection `x <- x - phi(x) n`, distances; `now` is the time reached.
pub fn correct(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2], dt: f64, now: f64) {
    let covers = libm::exp(-now) * libm::expm1(dt);
    for p in particles.iter_mut().filter(|p| p.kept > 0.0) {
        let (velocity, speed) = motion(phi, goal, p.predicted, h);
        let moved = p.x + 0.5 * dt * (p.velocity + velocity);
        let projected = back_project(phi, moved, h);
        p.dragged += distance(projected, moved, h);
        p.kept = p.kept.min(left(p.dragged, LOST)).min(left(phi.sample(projected).abs(), OFF_FRONT));
        let way = distance(projected, p.x, h);
        let step = (0.5 * dt * (p.speed + speed)).clamp(-2.0 * way, 2.0 * way);
        p.covered += step;
        p.own += p.kept * step;
        p.share += p.kept * covers;
        p.arc += way;
        p.x = projected;
    }
}

/// What is left of a particle whose misfit has come so far: all up to a share [`WHOLE`] of `gone`, nothing from there on.
fn left(misfit: f64, gone: f64) -> f64 {
    1.0 - smoothstep((misfit / gone - WHOLE) / (1.0 - WHOLE))
}

fn back_project(phi: &Field, mut x: DVec2, h: [f64; 2]) -> DVec2 {
    for _ in 0..PROJECTIONS {
        let (v, n) = (phi.sample(x).clamp(-1.0, 1.0), phi.normal(x, h));
        x -= v * n / DVec2::from(h);
    }
    x
}

/// The rest of the way when the morph has stopped: `S += -phi_B(x)`. A particle that is still more than a pixel away has no counterpart.
pub fn land(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2]) {
    for p in particles.iter_mut().filter(|p| p.kept > 0.0) {
        let rest = -goal.sample(p.x);
        p.kept = p.kept.min(left(rest.abs(), LOST));
        if p.kept <= 0.0 {
            continue;
        }
        p.x += rest * phi.normal(p.x, h) / DVec2::from(h);
        p.covered += rest;
        p.arc += rest.abs();
    }
}
