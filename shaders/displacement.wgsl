// The displacement of every interval, one round: both slices where the displacement brings them together, moments per node, their window
// means, the evidence of each interval, differences to the guess joint over the intervals. Before the first of some rounds that are alike, what
// the slices differ by where the guess brings them together. The twin is src/reference/displacement.rs.
//
// Moments, changes and vectors are smoothed by one kernel: numbers of a node side by side, `width` of them. A node gathers the pixels that are
// nearer than STRIDE to it, weighted by the tent `1 - |x - node| / STRIDE` along both axes.

@group(0) @binding(1) var<uniform> iteration: Iteration;
@group(0) @binding(2) var<storage, read> fields: array<f32>;
@group(0) @binding(3) var<storage, read> vectors: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> pairs: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> numbers: array<f32>;
@group(0) @binding(6) var<uniform> axis: Axis;
@group(0) @binding(7) var<storage, read> weights: array<f32>;
@group(0) @binding(8) var<storage, read> rough: array<f32>;
@group(0) @binding(9) var<storage, read_write> smoothed: array<f32>;
@group(0) @binding(10) var<storage, read_write> evidence: array<f32>;
@group(0) @binding(11) var<storage, read> intervals: array<Interval>;
@group(0) @binding(12) var<storage, read> guess: array<vec2<f32>>;
@group(0) @binding(13) var<storage, read_write> vectors_mut: array<vec2<f32>>;

// Numbers of a node: weight, <gx gx>, <gy gy>, <gx gy>, <gx r>, <gy r>, <gx>, <gy>, <r>.
const MOMENTS: u32 = 9u;
// Numbers of a node: S (xx, yy, xy), S (v - guess) + d (x, y), and e^2, what the slices differ by.
const EVIDENCE: u32 = 6u;
// Numbers of a node: weight and <r r>.
const CHANGES: u32 = 2u;

// One round; lengths in px. The weight of a pixel is exp(-(d / width)^2), zero beyond `reach`.
struct Iteration {
    clip: f32,
    width: f32,
    reach: f32,
    half_evidence: f32,
    coupling: f32,
    no_change: f32,
    padding_a: u32,
    padding_b: u32,
}

// A pass of smoothing: along rows or columns of nodes, with weights from `first` on, `reach` to each side.
struct Axis {
    vertical: u32,
    first: u32,
    reach: u32,
    width: u32,
}

// What an interval takes part in: weights of its neighbours' displacements as rates (0: there is none), and the weight of no motion but the guess.
struct Interval {
    before: f32,
    after: f32,
    ridge: f32,
    padding: f32,
}

fn all_nodes() -> u32 {
    return image.columns * image.rows;
}

fn clipped(k: u32) -> f32 {
    return clamp(fields[k], -iteration.clip, iteration.clip);
}

// A slice, clipped, at an offset from a pixel. Where the pixel is farther off than `reach` so is everything the offset may reach.
fn clipped_at(first: u32, ij: vec2<u32>, offset: vec2<f32>, reach: f32) -> f32 {
    let here = first + ij.y * image.nx + ij.x;
    if abs(fields[here]) >= reach {
        return clipped(here);
    }
    let c = cell_of(vec2<u32>(image.nx, image.ny), vec2<i32>(ij), offset, 0);
    let k = first + c.node;
    let low = mix(clipped(k), clipped(k + 1u), c.place.x);
    let high = mix(clipped(k + image.nx), clipped(k + image.nx + 1u), c.place.x);
    return mix(low, high, c.place.y);
}

// `(a, b)` at every pixel.
@compute @workgroup_size(lane_count)
fn bring_together(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = pixel_of(list_index(group, local));
    if !on_image(p) {
        return;
    }
    let nodes = image.nx * image.ny;
    let offset = 0.5 * vector_at(p.z * all_nodes(), vec2<i32>(p.xy), vec2<f32>(0.0));
    let reach = iteration.clip + length(offset) + 2.0;
    let a = clipped_at(p.z * nodes, p.xy, -offset, reach);
    let b = clipped_at((p.z + 1u) * nodes, p.xy, offset, reach);
    pairs[p.z * nodes + p.y * image.nx + p.x] = vec2<f32>(a, b);
}

fn pixel_weight(d: f32) -> f32 {
    let part = d / iteration.width;
    return select(exp(-part * part), 0.0, d > iteration.reach);
}

// What a node gathers.
struct Gathered {
    at: vec2<f32>,
    begin: vec2<u32>,
    end: vec2<u32>,
}

// Pixels nearer than STRIDE to node `k` of an interval, those at the image's edge left out.
fn gathered(k: u32) -> Gathered {
    let node = k % all_nodes();
    let at = first_node() + f32(STRIDE) * vec2<f32>(f32(node % image.columns), f32(node / image.columns));
    let reach = i32(STRIDE) - 1;
    let last = vec2<i32>(i32(image.nx), i32(image.ny)) - 2;
    let begin = max(vec2<i32>(floor(at)) - reach, vec2<i32>(1));
    let end = max(begin, min(vec2<i32>(ceil(at)) + reach, last) + 1);
    return Gathered(at, vec2<u32>(begin), vec2<u32>(end));
}

// Share of a pixel in a node along an axis.
fn tent(pixel: u32, at: f32) -> f32 {
    return 1.0 - abs(f32(pixel) - at) / f32(STRIDE);
}

// Weighted moments of the pixels around a node.
@compute @workgroup_size(lane_count)
fn sum_moments(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    let around = gathered(k);
    let begin = around.begin;
    var end = around.end;
    let nodes = image.nx * image.ny;
    let first = k / all_nodes() * nodes;
    var sum = array<f32, MOMENTS>();
    let middle = clamp(vec2<i32>(floor(around.at)), vec2<i32>(0), vec2<i32>(i32(image.nx), i32(image.ny)) - 1);
    let low = first + u32(middle.y) * image.nx + u32(middle.x);
    // Farther off than this, no pixel that the node gathers reads anything within the clip of either slice.
    let reach = iteration.clip + 0.5 * length(vectors[k]) + 3.0 * f32(STRIDE);
    if min(abs(fields[low]), abs(fields[low + nodes])) >= reach {
        var share = vec2<f32>(0.0);
        for (var i = begin.x; i < end.x; i++) {
            share.x += tent(i, around.at.x);
        }
        for (var j = begin.y; j < end.y; j++) {
            share.y += tent(j, around.at.y);
        }
        sum[0] = share.x * share.y * pixel_weight(iteration.clip);
        sum[8] = sum[0] * (clipped(low) - clipped(low + nodes));
        end = begin;
    }
    for (var j = begin.y; j < end.y; j++) {
        for (var i = begin.x; i < end.x; i++) {
            let n = first + j * image.nx + i;
            let here = pairs[n];
            let w = tent(i, around.at.x) * tent(j, around.at.y) * pixel_weight(min(abs(here.x), abs(here.y)));
            let along = pairs[n + 1u] - pairs[n - 1u];
            let across = pairs[n + image.nx] - pairs[n - image.nx];
            let gx = 0.25 * (along.x + along.y) / image.hx;
            let gy = 0.25 * (across.x + across.y) / image.hy;
            let r = here.x - here.y;
            sum[0] += w;
            sum[1] += w * gx * gx;
            sum[2] += w * gy * gy;
            sum[3] += w * gx * gy;
            sum[4] += w * gx * r;
            sum[5] += w * gy * r;
            sum[6] += w * gx;
            sum[7] += w * gy;
            sum[8] += w * r;
        }
    }
    for (var m = 0u; m < MOMENTS; m++) {
        numbers[k * MOMENTS + m] = sum[m];
    }
}

// The same of what the slices differ by, `pairs` being where the guess brings them together.
@compute @workgroup_size(lane_count)
fn sum_changes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    let around = gathered(k);
    let first = k / all_nodes() * image.nx * image.ny;
    var sum = vec2<f32>(0.0);
    for (var j = around.begin.y; j < around.end.y; j++) {
        for (var i = around.begin.x; i < around.end.x; i++) {
            let here = pairs[first + j * image.nx + i];
            let w = tent(i, around.at.x) * tent(j, around.at.y) * pixel_weight(min(abs(here.x), abs(here.y)));
            let r = here.x - here.y;
            sum += w * vec2<f32>(1.0, r * r);
        }
    }
    numbers[k * CHANGES] = sum.x;
    numbers[k * CHANGES + 1u] = sum.y;
}

// Keeps the window means of what the slices differ by beside the evidence.
@compute @workgroup_size(lane_count)
fn keep_changes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    evidence[(k + all_nodes()) * EVIDENCE + 5u] = rough[k * CHANGES + 1u] / (rough[k * CHANGES] + least_weight());
}

// Weight that is added to that of a node, so that there is some.
fn least_weight() -> f32 {
    return 1e-6 * f32(STRIDE * STRIDE);
}

// One axis of the Gaussian means of `rough`, the edge repeated.
@compute @workgroup_size(lane_count)
fn window_mean(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    if n >= image.count * all_nodes() * axis.width {
        return;
    }
    let k = n / axis.width % all_nodes();
    let at = select(k % image.columns, k / image.columns, axis.vertical == 1u);
    let last = select(image.columns, image.rows, axis.vertical == 1u) - 1u;
    let step = select(1u, image.columns, axis.vertical == 1u) * axis.width;
    let origin = n - at * step;
    var sum = 0.0;
    for (var w = 0u; w <= 2u * axis.reach; w++) {
        let reading = min(max(at + w, axis.reach) - axis.reach, last);
        sum += weights[axis.first + w] * rough[origin + reading * step];
    }
    smoothed[n] = sum;
}

// `S = <J J'> - <J><J>'` and `S (v - guess) + d`, `d = <J r> - <J><r>`, times the trust in them; one interval on in `evidence`, so that those before
// and after the batch have room.
@compute @workgroup_size(lane_count)
fn weigh(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    let pixels = f32(STRIDE * STRIDE);
    let m = k * MOMENTS;
    let weight = rough[m] / pixels;
    let whole = rough[m] + least_weight();
    let trust = weight / (weight + iteration.half_evidence);
    let square = vec3<f32>(rough[m + 1u], rough[m + 2u], rough[m + 3u]) / whole;
    let product = vec2<f32>(rough[m + 4u], rough[m + 5u]) / whole;
    let g = vec2<f32>(rough[m + 6u], rough[m + 7u]) / whole;
    let s = square - vec3<f32>(g.x * g.x, g.y * g.y, g.x * g.y);
    let d = product - g * (rough[m + 8u] / whole);
    let v = (vectors[k] - guess[k]) * vec2<f32>(image.hx, image.hy);
    let e = (k + all_nodes()) * EVIDENCE;
    evidence[e] = trust * s.x;
    evidence[e + 1u] = trust * s.y;
    evidence[e + 2u] = trust * s.z;
    evidence[e + 3u] = trust * (d.x + s.x * v.x + s.z * v.y);
    evidence[e + 4u] = trust * (d.y + s.z * v.x + s.y * v.y);
}

struct System {
    s: vec3<f32>,
    b: vec2<f32>,
    share: f32,
}

// A neighbour's evidence by its share of what changes, its displacement as a rate; nothing where there is no neighbour. `own` is what the interval
// itself changes by.
fn beside(k: u32, rate: f32, own: f32) -> System {
    if rate == 0.0 {
        return System(vec3<f32>(0.0), vec2<f32>(0.0), 0.0);
    }
    let e = k * EVIDENCE;
    let share = own / (own + rate * rate * evidence[e + 5u] + iteration.no_change);
    return System(
        share * vec3<f32>(evidence[e], evidence[e + 1u], evidence[e + 2u]),
        share * rate * vec2<f32>(evidence[e + 3u], evidence[e + 4u]),
        share
    );
}

// `v - guess = (S + ridge)^-1 b`, the neighbours' part added up first: the same either way up.
@compute @workgroup_size(lane_count)
fn solve(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    let interval = intervals[k / all_nodes()];
    let e = (k + all_nodes()) * EVIDENCE;
    let before = beside(k, interval.before, evidence[e + 5u]);
    let after = beside(k + 2u * all_nodes(), interval.after, evidence[e + 5u]);
    let own = vec3<f32>(evidence[e], evidence[e + 1u], evidence[e + 2u]);
    let s = own + iteration.coupling * (before.s + after.s);
    let h = vec2<f32>(image.hx, image.hy);
    let b = vec2<f32>(evidence[e + 3u], evidence[e + 4u]) + iteration.coupling * (before.b + after.b);
    let ridge = interval.ridge * (1.0 + iteration.coupling * (before.share + after.share));
    let xx = s.x + ridge;
    let yy = s.y + ridge;
    let determinant = xx * yy - s.z * s.z;
    let v = vec2<f32>(yy * b.x - s.z * b.y, xx * b.y - s.z * b.x) / determinant / h;
    numbers[2u * k] = v.x;
    numbers[2u * k + 1u] = v.y;
}

// The vectors: their smoothed differences to the guess, and the guess.
@compute @workgroup_size(lane_count)
fn add_guess(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= image.count * all_nodes() {
        return;
    }
    vectors_mut[k] = guess[k] + vec2<f32>(rough[2u * k], rough[2u * k + 1u]);
}
