// From seeds to the pixels at a contour: each such pixel takes the kernel-weighted mean of the seeds near its closest contour point,
// gathered through cell bins in seed order, without float atomics. Pixels that no seed reaches are filled from their neighbours.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> work: Work;
@group(0) @binding(3) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> phi: array<f32>;
@group(0) @binding(5) var<storage, read> seeds: array<Seed>;
@group(0) @binding(6) var<storage, read> bins: array<u32>;
@group(0) @binding(7) var<storage, read_write> courses: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> rounds: Rounds;
@group(0) @binding(9) var<storage, read> slots: array<u32>;

// Reach of the kernel `(1 - d / R)^2`, px.
const RADIUS: f32 = 1.5;
const FILL_ROUNDS: u32 = 30u;
override fill_width: u32 = 64u;

struct Seed {
    course: vec4<f32>,
    x: vec2<f32>,
    padding: vec2<f32>,
}

// For each band place the round in which it became known (NONE: not yet), after the list of those still unknown at the start.
struct Rounds {
    unknown: atomic<u32>,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
    known: array<Round>,
}

struct Round {
    at: atomic<u32>,
    unknown: u32,
}

@compute @workgroup_size(lane_count)
fn scatter(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let node = band[k].x;
    let q = band[k].y;
    courses[k] = vec4<f32>(0.0);
    atomicStore(&rounds.known[k].at, NONE);
    if !at_contour(node, jobs[q].nx) {
        return;
    }
    let h = vec2<f32>(params.hx, params.hy);
    let x = closest_point(q, node);
    let bins_x = jobs[q].bins_x;
    let bins_y = jobs[q].bins_y;
    let cell = min(vec2<u32>(max(x * h / RADIUS, vec2<f32>(0.0))), vec2<u32>(bins_x - 1u, bins_y - 1u));
    var sum = vec4<f32>(0.0);
    var total = 0.0;
    for (var row = max(cell.y, 1u) - 1u; row <= min(cell.y + 1u, bins_y - 1u); row++) {
        let first = bins[jobs[q].first_bin + row * bins_x + max(cell.x, 1u) - 1u];
        let last = bins[jobs[q].first_bin + row * bins_x + min(cell.x + 1u, bins_x - 1u) + 1u];
        for (var s = first; s < last; s++) {
            let near = max(1.0 - length((seeds[s].x - x) * h) / RADIUS, 0.0);
            total += near * near;
            sum += near * near * seeds[s].course;
        }
    }
    if total > 1e-6 {
        courses[k] = sum / total;
        atomicStore(&rounds.known[k].at, 0u);
    } else {
        // The order of this list does not matter: every round looks at earlier rounds only.
        rounds.known[atomicAdd(&rounds.unknown, 1u)].unknown = k;
    }
}

var<workgroup> unknown_total: u32;

// Unknown pixels take the mean of their neighbours that were known the round before. One workgroup.
@compute @workgroup_size(fill_width)
fn fill(@builtin(local_invocation_index) local: u32) {
    if local == 0u {
        unknown_total = atomicLoad(&rounds.unknown);
    }
    let total = workgroupUniformLoad(&unknown_total);
    if total == 0u {
        return;
    }
    for (var r = 1u; r <= FILL_ROUNDS; r++) {
        for (var u = local; u < total; u += fill_width) {
            let k = rounds.known[u].unknown;
            if atomicLoad(&rounds.known[k].at) == NONE {
                fill_one(k, r);
            }
        }
        storageBarrier();
    }
}

fn fill_one(k: u32, r: u32) {
    let nx = jobs[band[k].y].nx;
    var sum = vec4<f32>(0.0);
    var total = 0.0;
    for (var row = 0u; row < 3u; row++) {
        for (var column = 0u; column < 3u; column++) {
            let s = slots[band[k].x + row * nx + column - nx - 1u];
            if s != NONE && atomicLoad(&rounds.known[min(s, params.band_capacity - 1u)].at) < r {
                sum += courses[s];
                total += 1.0;
            }
        }
    }
    if total > 0.0 {
        courses[k] = sum / total;
        atomicStore(&rounds.known[k].at, r);
    }
}
