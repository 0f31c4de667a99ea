// Offsets of the trajectories from nodes to other nodes, in the blocks that the pixels near their surfaces read. The twins are `MotionField::paths`,
// `MotionField::off_slices` and `Place::carry` in src/registration/motion_field.rs.
//
// `vectors` holds displacements on the blocks of the moving frame's padded image. Of an interval: its own, the rates of its slices times its gap,
// the lower one's first, and the displacement read at the lower and at the upper slice. Of a node: from the lower slice to it, from it to the upper
// slice, and back: from the lower and from the upper slice to it.

@group(0) @binding(2) var<storage, read_write> vectors: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> ways: array<FairingWay>;
@group(0) @binding(4) var<storage, read> origins: array<FairingOrigin>;
@group(0) @binding(5) var<storage, read> pairs: array<FairingPair>;
@group(0) @binding(6) var<storage, read> steps: array<FairingStep>;
// Node and number among its squares.
@group(0) @binding(7) var<storage, read> tasks: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read> places: array<u32>;
@group(0) @binding(9) var<storage, read> marks: array<u32>;
@group(0) @binding(10) var<storage, read_write> offsets: array<vec2<f32>>;

// Fixed-point passes that find where a trajectory is on a layer: what the blocks at the slices say themselves is near enough for half of them.
const BACK_PASSES: u32 = 2u;
// Beginnings of a way: from the lower slice, from the upper slice, over both.
const FROM_LOWER: u32 = 0u;
const FROM_UPPER: u32 = 1u;
const OVER_BOTH: u32 = 2u;

// A node and its interval: where both begin in `vectors`, its time t, t - 1/2, t (t - 1)^2 and t^2 (t - 1).
struct FairingWay {
    interval: u32,
    node: u32,
    t: f32,
    tau: f32,
    first: f32,
    second: f32,
}

// A node that trajectories begin at: its displacements, its squares, their marks, its pairs, and where its offsets begin.
struct FairingOrigin {
    node: u32,
    squares: u32,
    marks: u32,
    first_pair: u32,
    pair_count: u32,
    offsets: u32,
}

// The way to another node: where it begins, its steps, and the shares of the ways over the lower and the upper slice.
struct FairingPair {
    start: u32,
    first_step: u32,
    last_step: u32,
    lower: f32,
    upper: f32,
}

// A displacement that a way follows, ahead or back.
struct FairingStep {
    vectors: u32,
    sign: f32,
}

fn block_count() -> u32 {
    return image.columns * image.rows;
}

fn block_corner(k: u32) -> vec2<i32> {
    return vec2<i32>(STRIDE * vec2<u32>(k % image.columns, k / image.columns));
}

// The displacement of an interval at its slices; a `FairingWay` an interval.
@compute @workgroup_size(lane_count)
fn at_slices(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let count = block_count();
    if n >= image.count * count {
        return;
    }
    let k = n % count;
    let interval = ways[n / count].interval;
    let corner = block_corner(k);
    vectors[interval + 3u * count + k] = through(interval, corner, first_node(), -0.5);
    vectors[interval + 4u * count + k] = through(interval, corner, first_node(), 0.5);
}

// `p(t)` for displacement `u` and the rates of block k.
fn along(way: FairingWay, k: u32, u: vec2<f32>) -> vec2<f32> {
    let count = block_count();
    let low = vectors[way.interval + count + k];
    let high = vectors[way.interval + 2u * count + k];
    return way.t * u + (low - u) * way.first + (high - u) * way.second;
}

// From the lower slice to nodes, and from them to the upper slice.
@compute @workgroup_size(lane_count)
fn follow(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let count = block_count();
    if n >= image.count * count {
        return;
    }
    let k = n % count;
    let way = ways[n / count];
    let u = through(way.interval, block_corner(k), first_node(), way.tau);
    let come = along(way, k, u);
    vectors[way.node + k] = come;
    vectors[way.node + count + k] = u - come;
}

// From either slice to nodes.
@compute @workgroup_size(lane_count)
fn back(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let count = block_count();
    if n >= image.count * count {
        return;
    }
    let k = n % count;
    let way = ways[n / count];
    let u_low = vectors[way.interval + 3u * count + k];
    let u_high = vectors[way.interval + 4u * count + k];
    var low = along(way, k, u_low);
    var high = along(way, k, u_high) - u_high;
    for (var pass_ = 0u; pass_ < BACK_PASSES; pass_++) {
        low = vector_at(way.node, block_corner(k), first_node() + low);
        high = -vector_at(way.node + count, block_corner(k), first_node() + high);
    }
    vectors[way.node + 2u * count + k] = low;
    vectors[way.node + 3u * count + k] = high;
}

// Where the trajectories through the blocks of a square are on other nodes; a workgroup a square.
@compute @workgroup_size(lane_count)
fn carry(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) || local >= TABLE {
        return;
    }
    let task = tasks[number];
    let origin = origins[task.x];
    if marks[origin.marks + task.y] == 0u {
        return;
    }
    let square = places[origin.squares + task.y];
    let first_block = (SQUARE / STRIDE) * vec2<u32>(square % shape.columns, square / shape.columns);
    let block = min(first_block + vec2<u32>(local % ACROSS, local / ACROSS), vec2<u32>(shape.block_columns, shape.block_rows) - 1u);
    let first = vec2<f32>(shape.first_x, shape.first_y);
    let whole = floor(first);
    let ij = vec2<i32>(whole) + vec2<i32>(STRIDE * block) + vec2<i32>(vec2<u32>(shape.pad_x, shape.pad_y));
    let x = first - whole;
    let below = x - vector_at(origin.node, ij, x);
    let above = x + vector_at(origin.node + block_count(), ij, x);
    for (var k = 0u; k < origin.pair_count; k++) {
        let pair = pairs[origin.first_pair + k];
        var y = select(below, above, pair.start == FROM_UPPER);
        if pair.start == OVER_BOTH {
            let a = below + vector_at(steps[pair.first_step].vectors, ij, below);
            let b = above + vector_at(steps[pair.first_step + 1u].vectors, ij, above);
            y = pair.lower * a + pair.upper * b;
        } else {
            for (var s = pair.first_step; s < pair.last_step; s++) {
                y += steps[s].sign * vector_at(steps[s].vectors, ij, y);
            }
        }
        offsets[origin.offsets + (task.y * origin.pair_count + k) * TABLE + local] = y - x;
    }
}
