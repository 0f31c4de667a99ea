// What steers a sweep: each piece of contour moves by its course and is led onto the next contour by feedback at the contour's pixels.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> work: Work;
@group(0) @binding(4) var<storage, read> phi: array<f32>;
@group(0) @binding(5) var<storage, read> goal: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<Sums>;
@group(0) @binding(7) var<storage, read> courses: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> errors: array<f32>;
@group(0) @binding(9) var<storage, read_write> jobs_mut: array<Job>;
@group(0) @binding(10) var<storage, read> times: array<f32>;
@group(0) @binding(11) var<storage, read_write> reached: Reached;
@group(0) @binding(12) var<storage, read_write> line: array<f32>;
@group(0) @binding(13) var<storage, read_write> before: array<vec4<f32>>;
// What a new morph has measured: the distance that remains, and how far it is valid.
@group(0) @binding(14) var<storage, read_write> remeasured: array<vec4<f32>>;

// Largest time step, of a whole one.
const STEP_LIMIT: f32 = 0.1;
// A step that reaches this share of what is left reaches the whole: rounding must not decide between one step and two.
const ALMOST: f32 = 0.9999;
// Pieces whose particle died are steered from LATE on, and wholly LATE_RAMP later.
const LATE: f32 = 0.6;
const LATE_RAMP: f32 = 0.3;
// Largest error that the feedback answers to at once, px.
const ERROR_LIMIT: f32 = 2.0;
// The feedback's gain is GAIN / (1 - t), at most GAIN / LEAST_TIME, and never more than one whole correction per step.
const GAIN: f32 = 2.0;
const LEAST_TIME: f32 = 0.02;

// A front that is wanted within this step: whose, where its copy goes, and the share of the step.
struct Read {
    job: u32,
    copy: u32,
    share: f32,
    padding: u32,
}

// Fronts that are read from this step, with the indirect arguments of their copying.
struct Reached {
    groups_x: atomic<u32>,
    groups_y: atomic<u32>,
    groups_z: atomic<u32>,
    count: atomic<u32>,
    reads: array<Read>,
}

// Weight of the feedback at time `t`: it grows with the sweep, but for what a new morph has just measured.
fn weight_at(t: f32) -> f32 {
    return smoothstep01(t);
}

// Takes over the time that the last step has reached.
@compute @workgroup_size(lane_count)
fn advance(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let q = list_index(group, local);
    if q == 0u {
        atomicStore(&reached.groups_x, 0u);
        atomicStore(&reached.groups_y, 0u);
        atomicStore(&reached.groups_z, 0u);
        atomicStore(&reached.count, 0u);
    }
    if q >= params.job_count || jobs_mut[q].phase != RUNNING {
        return;
    }
    if jobs_mut[q].reaches == 1u {
        jobs_mut[q].now = 1.0;
        jobs_mut[q].reaches = 0u;
    } else {
        jobs_mut[q].now += jobs_mut[q].dt;
    }
}

// Lists the fronts of a job that are wanted between `t` and `next`.
fn read_between(q: u32, t: f32, next: f32) {
    while jobs_mut[q].next_time < jobs_mut[q].time_count {
        let time = times[jobs_mut[q].first_time + jobs_mut[q].next_time];
        if time > next {
            return;
        }
        let share = clamp((time - t) / (next - t), 0.0, 1.0);
        let place = atomicAdd(&reached.count, 1u);
        atomicMax(&reached.groups_y, min(place + 1u, grid));
        atomicMax(&reached.groups_z, place / grid + 1u);
        reached.reads[place] = Read(q, jobs_mut[q].first_copy + jobs_mut[q].next_time * jobs_mut[q].block_count, share, 0u);
        atomicMax(&reached.groups_x, (jobs_mut[q].block_count + lane_count - 1u) / lane_count);
        jobs_mut[q].next_time += 1u;
    }
}

// Error `e = clip(remaining - scheduled remaining)`, `valid` being how far what remains is known. Pieces whose particle died are steered only late.
fn error_of(course: vec4<f32>, t: f32, remaining: f32, valid: f32) -> f32 {
    let late = smoothstep01((t - LATE) / LATE_RAMP);
    let trust = clamp(2.0 * (max(valid, late) - 0.5), 0.0, 1.0);
    return trust * clamp(remaining - (course.x - hermite(course, t)), -ERROR_LIMIT, ERROR_LIMIT);
}

// Adds a band pixel with its error, which counts at the contour, to what is found: the largest speed, and what is left of the front.
fn with_pixel(before: Found, k: u32, q: u32, error: f32, weight: f32) -> Found {
    let node = band[k].x;
    let nx = jobs[q].nx;
    let t = jobs[q].now;
    let v = phi[node];
    var found = before;
    found.pixels++;
    found.inside += select(0u, 1u, v < 0.0);
    if abs(v) < FRONT_REACH {
        found.fastest = max(found.fastest, abs(hermite_rate(courses[k], t)));
    }
    if at_contour(node, nx) {
        let gain = weight * GAIN / max(1.0 - t, LEAST_TIME);
        found.fastest = max(found.fastest, abs(hermite_rate(courses[k], t) + gain * error));
        found.rest = crossing(found.rest, node, node + 1u);
        found.rest = crossing(found.rest, node, node + nx);
    }
    return found;
}

// Errors, where what remains is `-goal` at the closest contour point, and what they make of the step.
@compute @workgroup_size(lane_count)
fn measure(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group_index(group) * lane_count * chunk_length;
    let begin = first + local;
    let end = min(first + lane_count * chunk_length, work.band_total);
    if begin >= end {
        return;
    }
    var q = band[begin].y;
    var found = Found(0.0, 0u, 0u, Rest(0.0, 0u, 0u));
    for (var k = begin; k < end; k += lane_count) {
        if band[k].y != q {
            add(q, found);
            q = band[k].y;
            found = Found(0.0, 0u, 0u, Rest(0.0, 0u, 0u));
        }
        let node = band[k].x;
        let t = jobs[q].now;
        var error = 0.0;
        if at_contour(node, jobs[q].nx) {
            error = error_of(courses[k], t, -sample_goal(q, closest_point(q, node)), courses[k].w);
        }
        errors[k] = error;
        found = with_pixel(found, k, q, error, weight_at(t));
    }
    add(q, found);
}

// Errors where a new morph has measured what remains.
@compute @workgroup_size(lane_count)
fn recall(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let q = band[k].y;
    var error = 0.0;
    if at_contour(band[k].x, jobs[q].nx) {
        error = error_of(courses[k], jobs[q].now, remeasured[k].x, min(courses[k].w, remeasured[k].y));
    }
    errors[k] = error;
}

// What those errors make of the step: they count wholly.
@compute @workgroup_size(lane_count)
fn measure_again(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group_index(group) * lane_count * chunk_length;
    let begin = first + local;
    let end = min(first + lane_count * chunk_length, work.band_total);
    if begin >= end {
        return;
    }
    var q = band[begin].y;
    var found = Found(0.0, 0u, 0u, Rest(0.0, 0u, 0u));
    for (var k = begin; k < end; k += lane_count) {
        if band[k].y != q {
            add(q, found);
            q = band[k].y;
            found = Found(0.0, 0u, 0u, Rest(0.0, 0u, 0u));
        }
        found = with_pixel(found, k, q, errors[k], 1.0);
    }
    add(q, found);
}

// What an invocation has found of one job.
struct Found {
    fastest: f32,
    inside: u32,
    pixels: u32,
    rest: Rest,
}

fn add(q: u32, found: Found) {
    if jobs[q].phase == RUNNING {
        atomicMax(&sums[q].fastest, bitcast<u32>(found.fastest));
        atomicAdd(&sums[q].inside, found.inside);
        atomicAdd(&sums[q].pixels, found.pixels);
        add_rest(q, found.rest);
    }
}

// One step of each job: `min(CFL / max |F|, 0.1, 1 - t)`, the last two steps made equal. Times at which the front is wanted are read from
// within steps.
@compute @workgroup_size(lane_count)
fn control(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let q = list_index(group, local);
    if q >= params.job_count || jobs_mut[q].phase != RUNNING {
        return;
    }
    let crossings = atomicExchange(&sums[q].crossings, 0u);
    let residual = bitcast<f32>(atomicExchange(&sums[q].residual_max, 0u));
    let sum = atomicExchange(&sums[q].residual_sum, 0u);
    let fastest = max(bitcast<f32>(atomicExchange(&sums[q].fastest, 0u)), 1e-6);
    let inside = atomicExchange(&sums[q].inside, 0u);
    let pixels = atomicExchange(&sums[q].pixels, 0u);
    let t = jobs_mut[q].now;
    if t >= 1.0 {
        jobs_mut[q].phase = DONE;
        if crossings > 0u {
            jobs_mut[q].residual_max = residual;
            jobs_mut[q].residual_mean = f32(sum) / REST_UNIT / f32(crossings);
        }
        return;
    }
    if inside == 0u {
        jobs_mut[q].phase = VANISHED;
        jobs_mut[q].vanished = t;
        return;
    }
    let left = 1.0 - t;
    var dt = min(params.cfl * min(params.hx, params.hy) / fastest, STEP_LIMIT * params.step_share);
    if dt >= left * ALMOST {
        dt = left;
        jobs_mut[q].reaches = 1u;
    } else if left < 2.0 * dt {
        dt = 0.5 * left;
    }
    read_between(q, t, select(t + dt, 1.0, jobs_mut[q].reaches == 1u));
    jobs_mut[q].dt = dt;
    jobs_mut[q].steps += 1u;
    jobs_mut[q].pixels += pixels;
}

// Speed of the course over this step, and the correction at the contour's pixels, by this weight if not by that of the time; what fronts within
// the step are read from.
fn steer_by(k: u32, weight: f32) {
    let q = band[k].y;
    if jobs[q].phase != RUNNING {
        return;
    }
    let t = jobs[q].now;
    let dt = jobs[q].dt;
    let own = select(weight_at(t), weight, weight > 0.0);
    let correction = min(own * GAIN / max(1.0 - t, LEAST_TIME), own / dt);
    line[k] = hermite_mean_rate(courses[k], t, dt) + correction * errors[k];
    let v = phi[band[k].x];
    before[k] = vec4<f32>(v, cut_off(v, params.beta, params.gamma) * bend(courses[k], t, dt), 0.0);
}

@compute @workgroup_size(lane_count)
fn steer(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k < work.band_total {
        steer_by(k, 0.0);
    }
}

// The same after a new morph: its errors count wholly.
@compute @workgroup_size(lane_count)
fn steer_again(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k < work.band_total {
        steer_by(k, 1.0);
    }
}

// What remains after this step.
@compute @workgroup_size(lane_count)
fn spend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k < work.band_total && jobs[band[k].y].phase == RUNNING {
        remeasured[k].x -= jobs[band[k].y].dt * line[k];
    }
}
