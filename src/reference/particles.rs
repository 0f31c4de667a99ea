//! Tracker particles: advection along the normal, back-projection onto the front, distance covered, death.

use glam::DVec2;

use crate::contour::seeds::Seed;
use crate::grid::field::{Field, distance};

/// Way that back-projections may move a particle in all, px: more means that the front under it is gone and another piece drags it along. The sum,
/// unlike the move of one step, does not depend on how many steps there are.
pub const LOST: f64 = 1.0;
/// Farthest a living particle may be from the front after back-projection, px: at a fork it has no front of its own. Without this bound rounding
/// decides where it goes on (`fig10` 0.06 px between the two paths, half the step at a fork 0.53 px instead of 0.13).
pub const OFF_FRONT: f64 = 0.1;
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
    /// Time of death.
    pub died: Option<f64>,
    predicted: DVec2,
    velocity: DVec2,
    speed: f64,
}

impl Particle {
    /// A particle at a seed.
    pub fn at(seed: &Seed) -> Self {
        let (predicted, velocity, speed) = (seed.x, DVec2::ZERO, 0.0);
        Particle { x: seed.x, covered: 0.0, arc: 0.0, dragged: 0.0, died: None, predicted, velocity, speed }
    }
}

/// Velocity of Eq. 2 at `x`: `dx/dt = F n`, in pixels of each axis, and `F = phi(x) - phi_B(x)`.
fn motion(phi: &Field, goal: &Field, x: DVec2, h: [f64; 2]) -> (DVec2, f64) {
    let speed = phi.sample(x) - goal.sample(x);
    (speed * phi.normal(x, h) / DVec2::from(h), speed)
}

/// Predictor: an Euler step in the field before the front moves.
pub fn predict(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2], dt: f64) {
    for p in particles.iter_mut().filter(|p| p.died.is_none()) {
        (p.velocity, p.speed) = motion(phi, goal, p.x, h);
        p.predicted = p.x + dt * p.velocity;
    }
}

/// Corrector in the field after the front has moved (Heun), back-projection `x <- x - phi(x) n`, distances; `now` is the time reached.
pub fn correct(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2], dt: f64, now: f64) {
    for p in particles.iter_mut().filter(|p| p.died.is_none()) {
        let (velocity, speed) = motion(phi, goal, p.predicted, h);
        let moved = p.x + 0.5 * dt * (p.velocity + velocity);
        let projected = back_project(phi, moved, h);
        p.dragged += distance(projected, moved, h);
        if p.dragged > LOST || phi.sample(projected).abs() > OFF_FRONT {
            p.died = Some(now);
            continue;
        }
        let way = distance(projected, p.x, h);
        p.covered += (0.5 * dt * (p.speed + speed)).clamp(-2.0 * way, 2.0 * way);
        p.arc += way;
        p.x = projected;
    }
}

fn back_project(phi: &Field, mut x: DVec2, h: [f64; 2]) -> DVec2 {
    for _ in 0..PROJECTIONS {
        let (v, n) = (phi.sample(x).clamp(-1.0, 1.0), phi.normal(x, h));
        x -= v * n / DVec2::from(h);
    }
    x
}

/// The rest of the way when the morph has stopped at time `now`: `S += -phi_B(x)`. A particle that is still more than a pixel away has
/// no counterpart and is dead.
pub fn land(particles: &mut [Particle], phi: &Field, goal: &Field, h: [f64; 2], now: f64) {
    for p in particles.iter_mut().filter(|p| p.died.is_none()) {
        let rest = -goal.sample(p.x);
        if rest.abs() > LOST {
            p.died = Some(now);
            continue;
        }
        p.x += rest * phi.normal(p.x, h) / DVec2::from(h);
        p.covered += rest;
        p.arc += rest.abs();
    }
}
