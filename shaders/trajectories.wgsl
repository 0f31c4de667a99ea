// Paths through layers: from the lower slice to the layer and from there to the upper one, per node. The twins are
// `Displacement::through` and `MotionField::paths`.

@group(0) @binding(1) var<storage, read> vectors: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> rates: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> times: array<Time>;
@group(0) @binding(4) var<storage, read_write> paths: array<vec2<f32>>;

// Time of a layer in its interval; `first` and `second` are t (t - 1)^2 and t^2 (t - 1).
struct Time {
    t: f32,
    tau: f32,
    first: f32,
    second: f32,
}

// `p(t) = t u + (K_low - u) (t^3 - 2 t^2 + t) + (K_high - u) (t^3 - t^2)` and `u - p`, with the slices' rates K per interval in `rates`,
// the lower one's first: all nodes come, then all go, time by time.
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
    let u = through(0u, corner, first_node(), time.tau);
    let come = time.t * u + time.first * (rates[k] - u) + time.second * (rates[nodes + k] - u);
    let place = 2u * (n - k) + k;
    paths[place] = come;
    paths[place + nodes] = u - come;
}
