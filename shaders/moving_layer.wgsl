// Layers of an interval: Hermite curves of the fields along the trajectories. The twin is src/reference/moving_layer.rs.

@group(0) @binding(6) var<storage, read_write> far: array<f32>;
@group(0) @binding(7) var<storage, read> tasks: array<u32>;
@group(0) @binding(8) var<storage, read_write> layers: array<f32>;

// Values of the tiles in which no contour can be.
@compute @workgroup_size(lane_count)
fn find_far(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let across = tiles();
    if n >= image.count * across.x * across.y {
        return;
    }
    far[n] = far_value(n / (across.x * across.y), vec2<u32>(n % across.x, n / across.x % across.y));
}

// The tiles that are asked for, numbered layer by layer, one after the other with all their pixels.
@compute @workgroup_size(lane_count)
fn interpolate(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let task = n / (TILE * TILE);
    if task >= span.asked {
        return;
    }
    let tile = tasks[task];
    let all_far = far[tile];
    let p = pixel_of(tile * TILE * TILE + n % (TILE * TILE));
    var value = all_far;
    if all_far == 0.0 && on_image(p) {
        value = value_at(p);
    }
    layers[n] = value;
}

// Of the tiles that nobody asks for what their probes say, the corners and the middle: the limit where all are beyond it, on one side, else 0.
@compute @workgroup_size(lane_count)
fn probe(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    if n >= span.others {
        return;
    }
    let tile = tasks[n];
    layers[n] = far[tile];
    if far[tile] != 0.0 {
        return;
    }
    let first = pixel_of(tile * TILE * TILE);
    let last = min(first.xy + TILE, dims()) - 1u;
    let middle = (first.xy + last) / 2u;
    var columns = array<u32, 5>(first.x, last.x, first.x, last.x, middle.x);
    var rows = array<u32, 5>(first.y, first.y, last.y, last.y, middle.y);
    var least = span.limit;
    var most = -span.limit;
    for (var k = 0u; k < 5u; k++) {
        let value = value_at(vec3<u32>(columns[k], rows[k], first.z));
        least = min(least, value);
        most = max(most, value);
    }
    layers[n] = select(select(0.0, -span.limit, most <= -span.limit), span.limit, least >= span.limit);
}
