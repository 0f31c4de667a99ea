// v of nodes, and their gradient n where the surface stands upright. The twins are src/reference/fairing_transform.rs and fairing_flatness.rs.
//
// A workgroup takes a square of a node; of the blocks, by which flatness is known, it takes four squares of 4 x 4.

@group(0) @binding(2) var<storage, read> nodes: array<FairingNode>;
// Node and number among its own squares, or among those of the blocks.
@group(0) @binding(3) var<storage, read> tasks: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read_write> values: array<f32>;
@group(0) @binding(6) var<storage, read_write> marks: array<atomic<u32>>;
// What is upright and all, by nearness: of blocks, then means over them.
@group(0) @binding(7) var<storage, read_write> sums: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> means: array<vec2<f32>>;
@group(0) @binding(9) var<storage, read> weights: array<f32>;
@group(0) @binding(10) var<uniform> axis: Axis;

// Beyond this `u / (n B)` tanh stays as it is.
const TANH_END: f32 = 6.0;
// Least gradient.
const LEAST_GRADIENT: f32 = 0.3;
// A pixel that goes sideways by more than the first per height stands less by itself, one that goes by more than the second not at all.
const ALONE_STEEP: f32 = 3.0;
const ALONE_FLAT: f32 = 8.0;
// The same among its neighbours.
const STEEP: f32 = 1.5;
const FLAT: f32 = 4.0;
// Means below the first count as flat, above the second as upright.
const LYING: f32 = 0.35;
const STANDING: f32 = 0.65;
// Blocks along a side of a square.
const BLOCKS: u32 = 4u;

// A node: its layer and those below and above, its own squares, how long a plane of them is, where the list of its squares begins in `places`, its
// marks in `marks`, its blocks in `sums`; and the height between the layers beside it.
struct FairingNode {
    phi: vec2<u32>,
    below: vec2<u32>,
    above: vec2<u32>,
    own: vec2<u32>,
    plane: u32,
    squares: u32,
    marks: u32,
    blocks: u32,
    rise: f32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
}

// A pass of smoothing: of 2 * reach + 1 weights from `first` on.
struct Axis {
    vertical: u32,
    first: u32,
    reach: u32,
    width: u32,
}

// Lambert's continued fraction cut after x^9: to 1e-5.
fn rational_tanh(given: f32) -> f32 {
    let x = clamp(given, -TANH_END, TANH_END);
    let s = x * x;
    let p = x * ((((s + 990.0) * s + 135135.0) * s + 4729725.0) * s + 34459425.0);
    let q = (((45.0 * s + 13860.0) * s + 945945.0) * s + 16216200.0) * s + 34459425.0;
    return clamp(p / q, -1.0, 1.0);
}

// Uprightness of a surface that goes sideways by this per height.
fn upright(sideways: f32, steep: f32, lying: f32) -> f32 {
    return 1.0 - smooth_step((sideways - steep) / (lying - steep));
}

@compute @workgroup_size(lane_count)
fn transform(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) {
        return;
    }
    let task = tasks[number];
    let node = nodes[task.x];
    let square = places[node.squares + task.y];
    let edge = vec2<u32>(shape.nx, shape.ny) - 1u;
    for (var q = local; q < AREA; q += lane_count) {
        // A square that others share has a value beyond the edge, too.
        let p = min(pixel(square, q), edge);
        let u = value_at(node.phi, p);
        // One-sided differences at the edges.
        let left = value_at(node.phi, vec2<u32>(max(p.x, 1u) - 1u, p.y));
        let right = value_at(node.phi, vec2<u32>(min(p.x + 1u, edge.x), p.y));
        let down = max(p.y, 1u) - 1u;
        let up = min(p.y + 1u, edge.y);
        let across = select(1.0, 2.0, p.x == 0u || p.x == edge.x);
        let gx = across * (right - left) * (0.5 / shape.dx);
        let gy = (value_at(node.phi, vec2<u32>(p.x, up)) - value_at(node.phi, vec2<u32>(p.x, down)))
            / (shape.dy * f32(max(up - down, 1u)));
        let gz = (value_at(node.above, p) - value_at(node.below, p)) / node.rise;
        let along = gx * gx + gy * gy;
        let sideways = abs(gz) / max(sqrt(along), LEAST_GRADIENT);
        let n = max(sqrt(along + gz * gz), LEAST_GRADIENT);
        let ratio = rational_tanh(u / (n * shape.bound));
        let near = abs(ratio) < SATURATED;
        let place = node.own.y + task.y * AREA + q;
        values[place] = shape.bound * ratio;
        values[place + SLOPE * node.plane] = select(0.0, n * upright(sideways, ALONE_STEEP, ALONE_FLAT), near);
        values[place + DIFFERENCE * node.plane] = select(0.0, sideways, near);
        if abs(ratio) < FADED {
            atomicStore(&marks[node.marks + task.y], 1u);
        }
    }
}

// The block of an invocation of those that take four squares of blocks a workgroup, and its node; NONE where there is none.
fn block_of(n: u32) -> vec3<u32> {
    let number = n / (BLOCKS * BLOCKS);
    if number >= arrayLength(&tasks) {
        return vec3<u32>(NONE);
    }
    let task = tasks[number];
    let across = (shape.block_columns + BLOCKS - 1u) / BLOCKS;
    let own = n % (BLOCKS * BLOCKS);
    let block = BLOCKS * vec2<u32>(task.y % across, task.y / across) + vec2<u32>(own % BLOCKS, own / BLOCKS);
    let there = task.x != NONE && block.x < shape.block_columns && block.y < shape.block_rows;
    return select(vec3<u32>(NONE), vec3<u32>(block, task.x), there);
}

// What is upright among the pixels around a block and all of them, each by a tent and by how near the surface it is.
@compute @workgroup_size(lane_count)
fn sum_up(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = block_of(list_index(group, local));
    if block.z == NONE {
        return;
    }
    let node = nodes[block.z];
    let centre = vec2<f32>(shape.first_x, shape.first_y) + APART * vec2<f32>(block.xy);
    let begin = vec2<u32>(max(floor(centre - APART), vec2<f32>(0.0)));
    let end = min(vec2<u32>(max(ceil(centre + APART), vec2<f32>(0.0))), vec2<u32>(shape.nx, shape.ny));
    var sum = vec2<f32>(0.0);
    for (var y = begin.y; y < end.y; y++) {
        let across = 1.0 - abs(f32(y) - centre.y) / APART;
        for (var x = begin.x; x < end.x; x++) {
            let own = place_of(node.own, vec2<u32>(x, y));
            let ratio = abs(values[own]) / shape.bound;
            if ratio < SATURATED {
                let tent = max(across, 0.0) * max(1.0 - abs(f32(x) - centre.x) / APART, 0.0);
                let weight = tent * nearness(ratio);
                let sideways = values[own + DIFFERENCE * node.plane];
                sum += weight * vec2<f32>(upright(sideways, STEEP, FLAT), 1.0);
            }
        }
    }
    sums[node.blocks + block.y * shape.block_columns + block.x] = sum;
}

// Gaussian means along an axis, the edge repeated.
@compute @workgroup_size(lane_count)
fn average(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = block_of(list_index(group, local));
    if block.z == NONE {
        return;
    }
    let blocks = nodes[block.z].blocks;
    let size = vec2<i32>(vec2<u32>(shape.block_columns, shape.block_rows));
    let step = select(vec2<i32>(1, 0), vec2<i32>(0, 1), axis.vertical != 0u);
    var sum = vec2<f32>(0.0);
    for (var k = 0u; k <= 2u * axis.reach; k++) {
        let at = clamp(vec2<i32>(block.xy) + (i32(k) - i32(axis.reach)) * step, vec2<i32>(0), size - 1);
        sum += weights[axis.first + k] * sums[blocks + u32(at.y * size.x + at.x)];
    }
    means[blocks + block.y * shape.block_columns + block.x] = sum;
}

// Scales n by how upright the surface stands around each pixel.
@compute @workgroup_size(lane_count)
fn stand(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) {
        return;
    }
    let task = tasks[number];
    let node = nodes[task.x];
    let square = places[node.squares + task.y];
    for (var q = local; q < AREA; q += lane_count) {
        let p = pixel(square, q);
        let place = node.own.y + task.y * AREA + q;
        if !on_layer(p) || abs(values[place]) >= SATURATED * shape.bound {
            continue;
        }
        let x = (vec2<f32>(p) - vec2<f32>(shape.first_x, shape.first_y)) / APART;
        let before = min(vec2<u32>(x), vec2<u32>(shape.block_columns, shape.block_rows) - 2u);
        let f = x - vec2<f32>(before);
        let k = node.blocks + before.y * shape.block_columns + before.x;
        let low = mix(sums[k], sums[k + 1u], f.x);
        let high = mix(sums[k + shape.block_columns], sums[k + shape.block_columns + 1u], f.x);
        let sum = mix(low, high, f.y);
        let share = smooth_step((sum.x / max(sum.y, 1e-30) - LYING) / (STANDING - LYING));
        values[place + SLOPE * node.plane] *= share;
    }
}
