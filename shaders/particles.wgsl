// Tracker particles: advection along the normal (Heun), back-projection onto the front, distance covered, death, landing.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> phi: array<f32>;
@group(0) @binding(3) var<storage, read> goal: array<f32>;
@group(0) @binding(4) var<storage, read_write> particles: array<Particle>;

// What back-projections may move a particle in all, px: more means that the front under it is gone and another piece drags it along.
const LOST: f32 = 1.0;
// Farthest a living particle may be from the front after back-projection, px.
const OFF_FRONT: f32 = 0.1;
const PROJECTIONS: u32 = 2u;

struct Particle {
    x: vec2<f32>,
    predicted: vec2<f32>,
    velocity: vec2<f32>,
    speed: f32,
    covered: f32,
    arc: f32,
    // What back-projections have moved it in all, px.
    dragged: f32,
    // Time of death, negative while it lives.
    died: f32,
    job: u32,
}

fn h() -> vec2<f32> {
    return vec2<f32>(params.hx, params.hy);
}

fn lives(p: u32) -> bool {
    return p < arrayLength(&particles) && particles[p].died < 0.0;
}

// Predictor: an Euler step in the field before the front moves, `dx/dt = (phi(x) - phi_B(x)) n`.
@compute @workgroup_size(lane_count)
fn predict(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = list_index(group, local);
    if !lives(p) || jobs[particles[p].job].phase != RUNNING {
        return;
    }
    let q = particles[p].job;
    let x = particles[p].x;
    let speed = sample_phi(q, x) - sample_goal(q, x);
    let velocity = speed * normal_of(q, x) / h();
    particles[p].speed = speed;
    particles[p].velocity = velocity;
    particles[p].predicted = x + jobs[q].dt * velocity;
}

// Corrector in the field after the front has moved, back-projection `x <- x - phi(x) n`, distances.
@compute @workgroup_size(lane_count)
fn correct(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = list_index(group, local);
    if !lives(p) || jobs[particles[p].job].phase != RUNNING {
        return;
    }
    let q = particles[p].job;
    let dt = jobs[q].dt;
    let predicted = particles[p].predicted;
    let speed = sample_phi(q, predicted) - sample_goal(q, predicted);
    let velocity = speed * normal_of(q, predicted) / h();
    let before = particles[p].x;
    let moved = before + 0.5 * dt * (particles[p].velocity + velocity);
    var x = moved;
    for (var n = 0u; n < PROJECTIONS; n++) {
        x -= clamp(sample_phi(q, x), -1.0, 1.0) * normal_of(q, x) / h();
    }
    let dragged = particles[p].dragged + length((x - moved) * h());
    particles[p].dragged = dragged;
    if dragged > LOST || abs(sample_phi(q, x)) > OFF_FRONT {
        particles[p].died = jobs[q].now;
        return;
    }
    // No more than twice the way made: the speed goes on where a front hangs though nothing moves.
    let way = length((x - before) * h());
    particles[p].covered += clamp(0.5 * dt * (particles[p].speed + speed), -2.0 * way, 2.0 * way);
    particles[p].arc += way;
    particles[p].x = x;
}

// The rest of the way when the morph has stopped: `S += -phi_B(x)`. One that is still more than a pixel away has no counterpart.
@compute @workgroup_size(lane_count)
fn land(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = list_index(group, local);
    if !lives(p) {
        return;
    }
    let q = particles[p].job;
    let x = particles[p].x;
    let rest = -sample_goal(q, x);
    if abs(rest) > LOST {
        particles[p].died = jobs[q].now;
        return;
    }
    particles[p].x = x + rest * normal_of(q, x) / h();
    particles[p].covered += rest;
    particles[p].arc += abs(rest);
}
