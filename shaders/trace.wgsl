// What steers a morph `phi_t = (phi_B - phi) |grad phi|` (Eq. 2): how fast it goes, how far it still is, when it is done.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> work: Work;
@group(0) @binding(4) var<storage, read> phi: array<f32>;
@group(0) @binding(5) var<storage, read> goal: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<Sums>;
@group(0) @binding(7) var<storage, read_write> jobs_mut: array<Job>;

// Largest time step, of a whole one: the relaxation is unstable above 2.5 and already costs accuracy at 2.2.
const STEP_LIMIT: f32 = 0.5;
// A front that has come this close and gains less than LEAST_GAIN a whole step in PATIENCE of them hangs at kinks of phi_B.
const STALL_BELOW: f32 = 1.0;
const LEAST_GAIN: f32 = 1e-3;
const PATIENCE: f32 = 12.0;
// Steps of a morph at most: far more than any needs.
const MOST_STEPS: f32 = 1e5;
// A morph that begins this far away, or a distance that is no number away, ends at once; the host finds what is left of its way and fails.
const NOWHERE: f32 = 1e9;
// The Courant number of whole steps.
const COURANT: f32 = 0.5;
// A front has arrived that is this much farther away than the tolerance: rounding must not decide.
const SLACK: f32 = 1e-4;

// Speed near the front and distance of its crossings from the goal, some band pixels at a time.
@compute @workgroup_size(lane_count)
fn measure(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group_index(group) * lane_count * chunk_length;
    let begin = first + local;
    let end = min(first + lane_count * chunk_length, work.band_total);
    if begin >= end {
        return;
    }
    var q = band[begin].y;
    var fastest = 0.0;
    var rest = Rest(0.0, 0u, 0u);
    var pixels = 0u;
    for (var k = begin; k < end; k += lane_count) {
        let node = band[k].x;
        if band[k].y != q {
            add(q, fastest, rest, pixels);
            q = band[k].y;
            fastest = 0.0;
            rest = Rest(0.0, 0u, 0u);
            pixels = 0u;
        }
        let v = phi[node];
        if abs(v) < FRONT_REACH {
            fastest = max(fastest, abs(v - goal[node]));
        }
        rest = crossing(rest, node, node + 1u);
        rest = crossing(rest, node, node + jobs[q].nx);
        pixels++;
    }
    add(q, fastest, rest, pixels);
}

fn add(q: u32, fastest: f32, rest: Rest, pixels: u32) {
    if jobs[q].phase == RUNNING {
        atomicMax(&sums[q].fastest, bitcast<u32>(fastest));
        add_rest(q, rest);
        atomicAdd(&sums[q].pixels, pixels);
    }
}

// One step of each job, or its end.
@compute @workgroup_size(lane_count)
fn control(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let q = list_index(group, local);
    if q >= params.job_count || jobs_mut[q].phase != RUNNING {
        return;
    }
    let crossings = atomicExchange(&sums[q].crossings, 0u);
    let residual = bitcast<f32>(atomicExchange(&sums[q].residual_max, 0u));
    let sum = atomicExchange(&sums[q].residual_sum, 0u);
    let fastest = max(bitcast<f32>(atomicExchange(&sums[q].fastest, 0u)), 1e-9);
    let pixels = atomicExchange(&sums[q].pixels, 0u);
    if crossings == 0u {
        jobs_mut[q].phase = DONE;
        return;
    }
    jobs_mut[q].residual_max = residual;
    jobs_mut[q].residual_mean = f32(sum) / REST_UNIT / f32(crossings);
    if jobs_mut[q].steps == 0u {
        jobs_mut[q].most_steps = u32(clamp((3.0 * residual / (COURANT * min(params.hx, params.hy)) + 20.0) / params.step_share, 0.0, MOST_STEPS));
        // Bits compare as the numbers do, and those of what is no number are above all.
        if bitcast<u32>(residual) >= bitcast<u32>(NOWHERE) {
            jobs_mut[q].most_steps = 0u;
        }
        jobs_mut[q].best = 1e30;
    }
    jobs_mut[q].idle = select(jobs_mut[q].idle + 1u, 0u, residual < jobs_mut[q].best - LEAST_GAIN * params.step_share);
    jobs_mut[q].best = min(jobs_mut[q].best, residual);
    let stalled = residual < STALL_BELOW && f32(jobs_mut[q].idle) * params.step_share > PATIENCE;
    if residual < params.tolerance + SLACK || stalled || jobs_mut[q].steps >= jobs_mut[q].most_steps {
        jobs_mut[q].phase = DONE;
        return;
    }
    jobs_mut[q].dt = min(params.cfl * min(params.hx, params.hy) / fastest, STEP_LIMIT * params.step_share);
    jobs_mut[q].now += jobs_mut[q].dt;
    jobs_mut[q].steps += 1u;
    jobs_mut[q].pixels += pixels;
}
