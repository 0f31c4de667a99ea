// Tracker particles: advection along the normal (Heun), back-projection onto the front, distance covered, what is left of them, landing.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> phi: array<f32>;
@group(0) @binding(3) var<storage, read> goal: array<f32>;
@group(0) @binding(4) var<storage, read_write> particles: array<Particle>;
@group(0) @binding(5) var<storage, read> starts: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read> firsts: array<u32>;

// What back-projections move a particle in all, px, until nothing is left of it: the front under it is gone and another piece drags it along.
const LOST: f32 = 1.2;
// Distance from the front after back-projection, px, at which nothing is left of it.
const OFF_FRONT: f32 = 0.25;
// Share of the way for which half the speed at the start stands.
const PRIOR: f32 = 0.05;
// Share of either length up to which a particle is whole.
const WHOLE: f32 = 0.25;
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
    // Share that is left of it, from 1 to 0.
    kept: f32,
    // What it covered while it was kept, px, and the share of its way that the relaxation covers meanwhile.
    own: f32,
    share: f32,
    job: u32,
}

fn h() -> vec2<f32> {
    return vec2<f32>(params.hx, params.hy);
}

fn lives(p: u32) -> bool {
    return p < arrayLength(&particles) && particles[p].kept > 0.0;
}

// What is left of a particle whose misfit has come so far: all up to a share of `gone`, nothing from there on.
fn left(misfit: f32, gone: f32) -> f32 {
    return 1.0 - smoothstep(WHOLE * gone, gone, misfit);
}

// Particles where they start, job by job; `firsts` is the number of each job's first, and behind them that of all.
@compute @workgroup_size(lane_count)
fn begin(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = list_index(group, local);
    if p >= firsts[params.job_count] {
        return;
    }
    // The last job that begins no later.
    var low = 0u;
    var high = params.job_count;
    for (var halving = countLeadingZeros(params.job_count); halving < 32u; halving++) {
        let between = (low + high) / 2u;
        if firsts[between] <= p {
            low = between;
        } else {
            high = between;
        }
    }
    let none = vec2<f32>(0.0);
    particles[p] = Particle(starts[p], none, none, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, low);
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
    if particles[p].share == 0.0 {
        particles[p].own = 0.5 * PRIOR * speed;
        particles[p].share = PRIOR;
    }
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
    let kept = min(particles[p].kept, min(left(dragged, LOST), left(abs(sample_phi(q, x)), OFF_FRONT)));
    particles[p].kept = kept;
    // No more than twice the way made: the speed goes on where a front hangs though nothing moves.
    let way = length((x - before) * h());
    let step = clamp(0.5 * dt * (particles[p].speed + speed), -2.0 * way, 2.0 * way);
    particles[p].covered += step;
    particles[p].own += kept * step;
    particles[p].share += kept * exp(-jobs[q].now) * (exp(dt) - 1.0);
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
    particles[p].kept = min(particles[p].kept, left(abs(rest), LOST));
    if particles[p].kept <= 0.0 {
        return;
    }
    particles[p].x = x + rest * normal_of(q, x) / h();
    particles[p].covered += rest;
    particles[p].arc += abs(rest);
}
