// Differences `K v - v` of nodes, and what their layers are moved by: the difference less what would move the contours. The twins are
// src/reference/fairing_correct.rs and fairing_limit.rs.
//
// A workgroup takes a square of a node.

@group(0) @binding(2) var<storage, read> averages: array<FairingMean>;
@group(0) @binding(3) var<storage, read> terms: array<FairingTerm>;
// Node and number among its own squares.
@group(0) @binding(4) var<storage, read> tasks: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> places: array<u32>;
@group(0) @binding(6) var<storage, read_write> values: array<f32>;
@group(0) @binding(7) var<storage, read> marks: array<u32>;
@group(0) @binding(8) var<storage, read> offsets: array<vec2<f32>>;

// Distance by which a correction may leave the range of its contours, px of the larger side.
const SLACK_PX: f32 = 0.05;
// A contour this much of the farthest distance that counts away leads nowhere.
const ALONE: f32 = 0.8;
const ALONE_END: f32 = 0.98;
// Beyond this square of a correction by its room the eighth root is the ratio itself.
const ROOT_END: f32 = 100.0;

// A node: its own squares, its layer, how long a plane is, the list of its squares and their marks, its terms, its offsets and pairs, whether it is
// a contour. The contours below and above it: places and values of their differences and of their layers. Layers of the contours beyond these. Pairs
// of the way to all four. The share of the strength at each pixel; the strength, and the upper contour's weight.
struct FairingMean {
    own: vec2<u32>,
    phi: vec2<u32>,
    plane: u32,
    squares: u32,
    marks: u32,
    first_term: u32,
    last_term: u32,
    offsets: u32,
    pair_count: u32,
    at_contour: u32,
    low: vec4<u32>,
    high: vec4<u32>,
    beyond: vec4<u32>,
    pairs: vec4<u32>,
    share: vec2<u32>,
    alpha: f32,
    weight: f32,
}

// A node of a mean: its v, the pair of the way to it, its weight.
struct FairingTerm {
    layer: vec2<u32>,
    pair: u32,
    weight: f32,
}

// Offset of the trajectory through a pixel of a square, of those in the table of its blocks that begins at `first`.
fn moved(first: u32, square: u32, p: vec2<u32>) -> vec2<f32> {
    let corner = (SQUARE / u32(APART)) * vec2<u32>(square % shape.columns, square / shape.columns);
    let x = (vec2<f32>(p) - vec2<f32>(shape.first_x, shape.first_y)) / APART;
    let before = floor(x);
    let f = x - before;
    let block = vec2<u32>(before) - corner;
    let k = first + block.y * ACROSS + block.x;
    return mix(mix(offsets[k], offsets[k + 1u], f.x), mix(offsets[k + ACROSS], offsets[k + ACROSS + 1u], f.x), f.y);
}

// A layer where the trajectory through a pixel is on it: along a pair, or straight where there is none.
fn along(mean: FairingMean, layer: vec2<u32>, pair: u32, slot: u32, square: u32, p: vec2<u32>) -> f32 {
    if pair == NONE {
        return value_at(layer, p);
    }
    return sample_packed(layer, p, moved(mean.offsets + (slot * mean.pair_count + pair) * TABLE, square, p));
}

@compute @workgroup_size(lane_count)
fn difference(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) {
        return;
    }
    let task = tasks[number];
    let mean = averages[task.x];
    let square = places[mean.squares + task.y];
    let marked = marks[mean.marks + task.y] != 0u;
    let far = shape.bound * select(SATURATED, FADED, mean.at_contour != 0u);
    for (var q = local; q < AREA; q += lane_count) {
        let p = pixel(square, q);
        let place = mean.own.y + task.y * AREA + q;
        var sum = 0.0;
        if marked && on_layer(p) && abs(values[place]) < far {
            let v = values[place];
            sum = -v;
            for (var k = mean.first_term; k < mean.last_term; k++) {
                sum += terms[k].weight * along(mean, terms[k].layer, terms[k].pair, task.y, square, p);
            }
            if mean.at_contour != 0u {
                sum *= smooth_step((FADED - abs(v) / shape.bound) / (FADED - FADE));
            }
        }
        values[place + DIFFERENCE * mean.plane] = sum;
    }
}

// Share to which the surface goes on from one contour to another whose distances there are these.
fn goes_on(a: f32, b: f32) -> f32 {
    return smooth_step((ALONE_END - max(abs(a), abs(b)) / shape.farthest) / (ALONE_END - ALONE));
}

// Room of a distance u to move towards the side of c between distances of contours.
fn room(c: f32, u: f32, a: f32, b: f32) -> f32 {
    let own = select(u - min(a, b), max(a, b) - u, c > 0.0);
    return max(own, 0.0) + SLACK_PX * shape.side;
}

// `c / (1 + (|c| / room)^8)^(1/8)`.
fn limited(c: f32, room: f32) -> f32 {
    let ratio = min((c / room) * (c / room), 2.0 * ROOT_END);
    let fourth = ratio * ratio;
    let root = sqrt(sqrt(sqrt(1.0 + fourth * fourth)));
    return select(c / root, select(room, -room, c < 0.0), ratio > ROOT_END);
}

@compute @workgroup_size(lane_count)
fn correct(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = group_index(group);
    if number >= arrayLength(&tasks) {
        return;
    }
    let task = tasks[number];
    let mean = averages[task.x];
    let square = places[mean.squares + task.y];
    let marked = marks[mean.marks + task.y] != 0u;
    for (var q = local; q < AREA; q += lane_count) {
        let p = pixel(square, q);
        let place = mean.own.y + task.y * AREA + q;
        var c = 0.0;
        if marked && on_layer(p) && abs(values[place]) < SATURATED * shape.bound {
            let ratio = abs(values[place]) / shape.bound;
            let d = values[place + DIFFERENCE * mean.plane];
            let low_d = along(mean, mean.low.xy, mean.pairs.x, task.y, square, p);
            let high_d = along(mean, mean.high.xy, mean.pairs.y, task.y, square, p);
            let low = along(mean, mean.low.zw, mean.pairs.x, task.y, square, p);
            let high = along(mean, mean.high.zw, mean.pairs.y, task.y, square, p);
            var share = goes_on(low, high);
            // Tips: a surface that ends in an interval still goes on if it does so from its contour to the other side.
            if share < 1.0 && mean.beyond.x != NONE && abs(low) < abs(high) {
                share = max(share, goes_on(low, along(mean, mean.beyond.xy, mean.pairs.z, task.y, square, p)));
            }
            if share < 1.0 && mean.beyond.z != NONE && abs(high) < abs(low) {
                share = max(share, goes_on(high, along(mean, mean.beyond.zw, mean.pairs.w, task.y, square, p)));
            }
            var strength = mean.alpha * share;
            if mean.share.x != NONE {
                strength *= value_at(mean.share, p);
            }
            let rise = strength * (d - (1.0 - mean.weight) * low_d - mean.weight * high_d);
            c = values[place + SLOPE * mean.plane] * rise * nearness(ratio);
            if shape.limited != 0u {
                let u = value_at(mean.phi, p);
                let straight = room(c, u, value_at(mean.low.zw, p), value_at(mean.high.zw, p));
                c = limited(c, min(room(c, u, low, high), straight));
            }
        }
        values[place + CORRECTION * mean.plane] = c;
    }
}
