// Layers moved by the curve through the corrections of their nodes. The twin is src/reference/fairing_layer.rs.
//
// A workgroup takes a square of a layer.

@group(0) @binding(2) var<storage, read> layers: array<FairingLayer>;
@group(0) @binding(3) var<storage, read> terms: array<FairingTerm>;
// Layer and square.
@group(0) @binding(4) var<storage, read> tasks: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> places: array<u32>;
@group(0) @binding(6) var<storage, read> values: array<f32>;
// Task by task.
@group(0) @binding(7) var<storage, read_write> faired: array<f32>;

// Distance by which a correction may leave the range of its contours, px of the larger side.
const SLACK_PX: f32 = 0.05;
// The least distance that is not 0.
const LEAST: f32 = 1.1754944e-38;

// A layer, the contours below and above it, and its terms.
struct FairingLayer {
    phi: vec2<u32>,
    low: vec2<u32>,
    high: vec2<u32>,
    first_term: u32,
    last_term: u32,
}

// A node's correction and its weight.
struct FairingTerm {
    layer: vec2<u32>,
    pair: u32,
    weight: f32,
}

@compute @workgroup_size(lane_count)
fn move_layers(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) {
        return;
    }
    let task = tasks[number];
    let layer = layers[task.x];
    for (var q = local; q < AREA; q += lane_count) {
        let p = pixel(task.y, q);
        var u = 0.0;
        if on_layer(p) {
            u = value_at(layer.phi, p);
            var c = 0.0;
            for (var k = layer.first_term; k < layer.last_term; k++) {
                c += terms[k].weight * value_at(terms[k].layer, p);
            }
            if c != 0.0 {
                if shape.limited != 0u {
                    let low = value_at(layer.low, p);
                    let high = value_at(layer.high, p);
                    let own = select(u - min(low, high), max(low, high) - u, c > 0.0);
                    let room = max(own, 0.0) + SLACK_PX * shape.side;
                    c = clamp(c, -room, room);
                }
                u = clamp(u + c, -shape.farthest, shape.farthest);
                u = select(u, LEAST, u == 0.0);
            }
        }
        faired[number * AREA + q] = u;
    }
}
