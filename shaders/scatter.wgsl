// From seeds to the pixels at a contour: each such pixel takes the kernel-weighted mean of the seeds near its closest contour point,
// gathered through cell bins in seed order, without float atomics. Pixels that no seed reaches are filled from their neighbours, a dispatch a round.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> work: Work;
@group(0) @binding(3) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> phi: array<f32>;
@group(0) @binding(5) var<storage, read> seeds: array<Seed>;
@group(0) @binding(6) var<storage, read> bins: array<u32>;
@group(0) @binding(7) var<storage, read_write> courses: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> known: Known;
@group(0) @binding(9) var<storage, read> slots: array<u32>;
@group(0) @binding(10) var<storage, read_write> bins_mut: array<u32>;

// Reach of the kernel `(1 - d / R)^2`, px.
const RADIUS: f32 = 1.5;
// What `at` says of pixels at a contour that are not known yet; NONE of those that are at no contour.
const UNKNOWN: u32 = 0xfffffffeu;

// Seeds come in the order of their bins, which are numbered over all jobs. Single numbers: vectors would make a seed longer by their alignment.
struct Seed {
    s: f32,
    m0: f32,
    m1: f32,
    ok: f32,
    x: f32,
    y: f32,
    bin: u32,
}

// For each band place the round in which it became known, behind the number of the round that is being filled.
struct Known {
    round: u32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
    at: array<atomic<u32>>,
}

// Where each bin begins: at the first seed that lies in it or in a later one.
@compute @workgroup_size(lane_count)
fn lay_bins(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let bin = list_index(group, local);
    if bin >= arrayLength(&bins_mut) {
        return;
    }
    let count = arrayLength(&seeds);
    var low = 0u;
    var high = count;
    for (var halving = countLeadingZeros(count); halving < 32u; halving++) {
        let between = (low + high) / 2u;
        if low < high && seeds[between].bin < bin {
            low = between + 1u;
        } else {
            high = between;
        }
    }
    bins_mut[bin] = low;
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
    atomicStore(&known.at[k], NONE);
    if k == 0u {
        known.round = 0u;
    }
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
            let seed = seeds[s];
            let near = max(1.0 - length((vec2<f32>(seed.x, seed.y) - x) * h) / RADIUS, 0.0);
            total += near * near;
            sum += near * near * vec4<f32>(seed.s, seed.m0, seed.m1, seed.ok);
        }
    }
    if total > 1e-6 {
        courses[k] = sum / total;
        atomicStore(&known.at[k], 0u);
    } else {
        atomicStore(&known.at[k], UNKNOWN);
    }
}

// Before every round.
@compute @workgroup_size(1)
fn next_round() {
    known.round += 1u;
}

// Unknown pixels take the mean of their neighbours that were known the round before: what others become in this round does not count yet.
@compute @workgroup_size(lane_count)
fn fill(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total || atomicLoad(&known.at[k]) != UNKNOWN {
        return;
    }
    let nx = jobs[band[k].y].nx;
    var sum = vec4<f32>(0.0);
    var total = 0.0;
    for (var row = 0u; row < 3u; row++) {
        for (var column = 0u; column < 3u; column++) {
            let s = slots[band[k].x + row * nx + column - nx - 1u];
            if s != NONE && atomicLoad(&known.at[min(s, params.band_capacity - 1u)]) < known.round {
                sum += courses[s];
                total += 1.0;
            }
        }
    }
    if total > 0.0 {
        courses[k] = sum / total;
        atomicStore(&known.at[k], known.round);
    }
}
