// Paths through layers: from the lower slice to the layer and from there to the upper one, per node. The twin is `MotionField::paths`.

// Three per node of the mid frame, displacement by displacement: u, then the rates K per interval at the lower and the upper slice of the
// trajectory through the node.
@group(0) @binding(1) var<storage, read> vectors: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> times: array<Time>;
@group(0) @binding(3) var<storage, read_write> paths: array<vec2<f32>>;

// Fixed-point passes that find the trajectory through a point.
const PASSES: u32 = 3u;

// Time of a layer in its interval; `first` and `second` are t (t - 1)^2 and t^2 (t - 1).
struct Time {
    t: f32,
    first: f32,
    second: f32,
}

// u and K of the trajectory through a place in the mid frame.
struct Trajectory {
    u: vec2<f32>,
    low: vec2<f32>,
    high: vec2<f32>,
}

fn trajectory(ij: vec2<i32>, offset: vec2<f32>) -> Trajectory {
    let nodes = image.columns * image.rows;
    return Trajectory(vector_at(0u, ij, offset), vector_at(nodes, ij, offset), vector_at(2u * nodes, ij, offset));
}

// `p(t) = t u + (K_low - u) (t^3 - 2 t^2 + t) + (K_high - u) (t^3 - t^2)`.
fn way(along: Trajectory, time: Time) -> vec2<f32> {
    return time.t * along.u + time.first * (along.low - along.u) + time.second * (along.high - along.u);
}

// The trajectory that passes through a place on the layer: what is at m in the mid frame is at m - u/2 + p(t) there.
fn through(ij: vec2<i32>, offset: vec2<f32>, time: Time) -> Trajectory {
    var found = trajectory(ij, offset);
    for (var k = 0u; k < PASSES; k++) {
        found = trajectory(ij, offset - (way(found, time) - 0.5 * found.u));
    }
    return found;
}

// `p(t)` and `u - p`: all nodes come, then all go, time by time.
@compute @workgroup_size(lane_count)
fn follow(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let nodes = image.columns * image.rows;
    if n >= image.count * nodes {
        return;
    }
    let k = n % nodes;
    let time = times[n / nodes];
    let corner = vec2<i32>(STRIDE * vec2<u32>(k % image.columns, k / image.columns));
    let found = through(corner, first_node(), time);
    let come = way(found, time);
    let place = 2u * (n - k) + k;
    paths[place] = come;
    paths[place + nodes] = found.u - come;
}
