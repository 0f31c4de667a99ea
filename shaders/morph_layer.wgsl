// Layers of an interval of the morph: bodies united in the mid frame, brought to their places, and packed. The twins are
// src/reference/morph_layer.rs, src/contour/canvas.rs and src/registration/warp.rs.
//
// `nearest`, or `seen`, holds an image in the frame for each layer, and behind them the ground: what lies between the contours at the lower and the upper
// one, as the contours say and as the layers beside them. Behind the slopes `fields` holds what the way to the frame and back loses of either slice.

@group(0) @binding(6) var<storage, read> bodies: array<Body>;
@group(0) @binding(7) var<storage, read> slices: array<f32>;
@group(0) @binding(8) var<storage, read> shapes: array<f32>;
@group(0) @binding(9) var<storage, read> contours: array<f32>;
@group(0) @binding(10) var<storage, read_write> nearest: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read> seen: array<u32>;
@group(0) @binding(12) var<uniform> morph: Morph;
@group(0) @binding(13) var<storage, read_write> to_middle: array<vec2<f32>>;
@group(0) @binding(14) var<storage, read> middle: array<vec2<f32>>;
@group(0) @binding(15) var<storage, read_write> fields_mut: array<f32>;
@group(0) @binding(16) var<storage, read_write> sides: array<f32>;
@group(0) @binding(17) var<storage, read_write> layers: array<u32>;
@group(0) @binding(18) var<storage, read> dense: array<u32>;
@group(0) @binding(19) var<storage, read_write> used: array<atomic<u32>>;
@group(0) @binding(20) var<storage, read_write> squares: array<vec2<u32>>;
@group(0) @binding(21) var<storage, read_write> packed: array<f32>;
@group(0) @binding(22) var<storage, read> places: array<u32>;
@group(0) @binding(23) var<storage, read_write> taken: array<f32>;

// Sources of a body's values: slices of groups, contours that groups end at, and shapes that the host has made.
const OF_SLICES: u32 = 0u;
const OF_ENDS: u32 = 1u;

// Side of a square of a sparse image, px.
const SQUARE: u32 = 16u;

// Change of distance from a contour to the layer beside, px, above which the two do not belong to one surface.
const GONE: f32 = 0.05;

// What the layers of an interval share: distances are clamped to `limit`; the image's place and size on the padded one; the numbers of layers, of bodies,
// of the groups of BLOCK pixels that they take, and how often the bodies can be halved; whether either slice is not empty, and whether there is a layer beside it; the number of places.
struct Morph {
    limit: f32,
    pad_x: u32,
    pad_y: u32,
    nx: u32,
    ny: u32,
    layers: u32,
    bodies: u32,
    groups: u32,
    halvings: u32,
    low_own: u32,
    high_own: u32,
    low_beside: u32,
    high_beside: u32,
    places: u32,
}

// A body on its tile: where its values begin, and of what; the tile's size and place on the padded image; what is added to its distances; the image
// that it is united with; and the first group that takes it.
struct Body {
    first: u32,
    source: u32,
    nx: u32,
    ny: u32,
    x: i32,
    y: i32,
    offset: f32,
    layer: u32,
    first_group: u32,
    padding: u32,
}

// Distances as numbers, larger ones for smaller distances, so that the nearest body wins in whatever order they come; 0 where there is none.
fn nearness(v: f32) -> u32 {
    let bits = bitcast<u32>(v);
    return select(~bits & 0x7fffffffu, bits, bits >= 0x80000000u);
}

fn distance_of(nearness: u32) -> f32 {
    let bits = select(~nearness & 0x7fffffffu, nearness, nearness >= 0x80000000u);
    return select(bitcast<f32>(bits), morph.limit, nearness == 0u);
}

fn image_nodes() -> u32 {
    return image.nx * image.ny;
}

// All bodies, group by group: the smaller distance counts.
@compute @workgroup_size(lane_count)
fn unite(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let own = n / BLOCK;
    if own >= morph.groups {
        return;
    }
    // The last body that begins no later.
    var low = 0u;
    var high = morph.bodies;
    for (var step = 0u; step < morph.halvings; step++) {
        let between = (low + high) / 2u;
        if bodies[between].first_group <= own {
            low = between;
        } else {
            high = between;
        }
    }
    let body = bodies[low];
    let node = n - body.first_group * BLOCK;
    if node >= body.nx * body.ny {
        return;
    }
    let i = body.x + i32(node % body.nx);
    let j = body.y + i32(node / body.nx);
    if i < 0 || j < 0 || i >= i32(image.nx) || j >= i32(image.ny) {
        return;
    }
    var value = body.offset;
    switch body.source {
        case OF_SLICES: {
            value += slices[body.first + node];
        }
        case OF_ENDS: {
            value += contours[body.first + node];
        }
        default: {
            value += shapes[body.first + node];
        }
    }
    let place = body.layer * image_nodes() + u32(j) * image.nx + u32(i);
    // What is no number is nearer than anything.
    if !(abs(value) <= 1e30) {
        atomicMax(&nearest[place], 0xffffffffu);
    } else if value < morph.limit {
        atomicMax(&nearest[place], nearness(max(value, -morph.limit)));
    }
}

// The displacement that begins at `first` of those to the middle, at a place.
fn middle_at(first: u32, ij: vec2<i32>, offset: vec2<f32>) -> vec2<f32> {
    let x = (vec2<f32>(ij) - first_node() + offset) / f32(STRIDE);
    let c = cell_of(vec2<u32>(image.columns, image.rows), vec2<i32>(0), x, 0);
    let k = first + c.node;
    let low = mix(middle[k], middle[k + 1u], c.place.x);
    let high = mix(middle[k + image.columns], middle[k + image.columns + 1u], c.place.x);
    return mix(low, high, c.place.y);
}

// Ways from the layers, then from both slices, to the mid frame, per node: `((x - come) + off_low) / 2 + ((x + go) + off_high) / 2 - x`. Behind the paths
// `vectors` holds the ways off the slices and the weights of the particles.
@compute @workgroup_size(lane_count)
fn find_middle(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let blocks = image.columns * image.rows;
    let times_count = morph.layers + 2u;
    if n >= times_count * blocks {
        return;
    }
    let t = n / blocks;
    let k = n % blocks;
    let come = vectors[2u * t * blocks + k];
    let go = vectors[(2u * t + 1u) * blocks + k];
    let corner = vec2<i32>(STRIDE * vec2<u32>(k % image.columns, k / image.columns));
    let off = 2u * times_count * blocks;
    let low = vector_at(off, corner, first_node() - come);
    let high = vector_at(off + blocks, corner, first_node() + go);
    to_middle[n] = 0.5 * ((low - come) + (high + go));
}

// Bilinear value of an image in the frame.
fn seen_at(first: u32, ij: vec2<i32>, offset: vec2<f32>) -> f32 {
    let c = cell_of(dims(), ij, offset, 0);
    let k = first + c.node;
    let low = mix(distance_of(seen[k]), distance_of(seen[k + 1u]), c.place.x);
    let high = mix(distance_of(seen[k + image.nx]), distance_of(seen[k + image.nx + 1u]), c.place.x);
    return mix(low, high, c.place.y);
}

// Value of the ground at the slice of a direction: what its contour says, but for what is gone in the layer beside it.
fn ground(contour: u32, beside: u32, has_beside: bool) -> f32 {
    let begun = distance_of(seen[contour]);
    if has_beside {
        let next = distance_of(seen[beside]);
        if abs(begun - next) > GONE {
            return next;
        }
    }
    return begun;
}

// What the way to the frame and back loses of the distances of either slice.
@compute @workgroup_size(lane_count)
fn lose(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let nodes = image_nodes();
    if n >= 2u * nodes {
        return;
    }
    let end = n / nodes;
    let own = fields_mut[n];
    let has_own = select(morph.low_own, morph.high_own, end == 1u) != 0u;
    let has_beside = select(morph.low_beside, morph.high_beside, end == 1u) != 0u;
    var lost = 0.0;
    if has_own && abs(own) < morph.limit {
        let ij = vec2<i32>(vec2<u32>(n % nodes % image.nx, n % nodes / image.nx));
        let blocks = image.columns * image.rows;
        let way = middle_at((morph.layers + end) * blocks, ij, vec2<f32>(0.0));
        let c = cell_of(dims(), ij, way, 1);
        let wx = catmull_rom(c.place.x);
        let wy = catmull_rom(c.place.y);
        let contour = (morph.layers + 2u * end) * nodes;
        var sum = 0.0;
        for (var row = 0u; row < 4u; row++) {
            var values = vec4<f32>(0.0);
            for (var column = 0u; column < 4u; column++) {
                let k = contour + c.node + row * image.nx - image.nx - 1u + column;
                values[column] = ground(k, k + nodes, has_beside);
            }
            sum += wy[row] * dot(wx, values);
        }
        lost = own - sum;
    }
    fields_mut[4u * nodes + n] = lost;
}

// Tiles whose probes, the corners and the middle, are all beyond the limit on one side by both methods: that limit; 0 for the others.
@compute @workgroup_size(lane_count)
fn find_sides(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let across = tiles();
    if n >= image.count * across.x * across.y {
        return;
    }
    let tile = vec2<u32>(n % across.x, n / across.x % across.y);
    let layer = n / (across.x * across.y);
    let first = TILE * tile;
    let last = min(first + TILE, dims()) - 1u;
    let center = (first + last) / 2u;
    var columns = array<u32, 5>(first.x, last.x, first.x, last.x, center.x);
    var rows = array<u32, 5>(first.y, first.y, last.y, last.y, center.y);
    let blocks = image.columns * image.rows;
    var smallest = morph.limit;
    var largest = -morph.limit;
    for (var k = 0u; k < 5u; k++) {
        let ij = vec2<i32>(vec2<u32>(columns[k], rows[k]));
        let value = seen_at(layer * image_nodes(), ij, middle_at(layer * blocks, ij, vec2<f32>(0.0)));
        smallest = min(smallest, value);
        largest = max(largest, value);
    }
    var side = select(select(0.0, -morph.limit, largest <= -morph.limit), morph.limit, smallest >= morph.limit);
    if side != 0.0 {
        let far = far_value(layer, tile);
        if far != 0.0 {
            side = select(0.0, side, far == side);
        } else {
            for (var k = 0u; k < 5u; k++) {
                let value = value_at(vec3<u32>(columns[k], rows[k], layer));
                side = select(0.0, side, select(value <= side, value >= side, side > 0.0));
            }
        }
    }
    sides[n] = side;
}

// Catmull-Rom value of an image in the frame.
fn seen_smooth(first: u32, ij: vec2<i32>, offset: vec2<f32>) -> f32 {
    let c = cell_of(dims(), ij, offset, 1);
    let wx = catmull_rom(c.place.x);
    let wy = catmull_rom(c.place.y);
    var sum = 0.0;
    for (var row = 0u; row < 4u; row++) {
        let k = first + c.node + row * image.nx - image.nx - 1u;
        let values = vec4<f32>(distance_of(seen[k]), distance_of(seen[k + 1u]), distance_of(seen[k + 2u]), distance_of(seen[k + 3u]));
        sum += wy[row] * dot(wx, values);
    }
    return sum;
}

// The morph's weight for `(arrived, all)` particles.
fn share_of(particles: vec2<f32>) -> f32 {
    let x = clamp((particles.x / particles.y - NO_TRUST) / (ALL_TRUST - NO_TRUST), 0.0, 1.0);
    return x * x * (3.0 - 2.0 * x);
}

// Below this share of arrived particles the morph has no say, above the other it has all of it.
const NO_TRUST: f32 = 0.75;
const ALL_TRUST: f32 = 1.0;

// Layers, tile by tile: what is seen in the frame with what the way loses of both slices, or where particles are missing the field method's value.
@compute @workgroup_size(lane_count)
fn warp(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    let p = pixel_of(n);
    if !on_image(p) {
        return;
    }
    var value = sides[n / (TILE * TILE)];
    if value == 0.0 {
        let ij = vec2<i32>(p.xy);
        let nodes = image_nodes();
        let blocks = image.columns * image.rows;
        let way = middle_at(p.z * blocks, ij, vec2<f32>(0.0));
        let ends = ends_of(p.z, ij, vec2<f32>(0.0));
        let t = times[p.z];
        let w = t * t * (3.0 - 2.0 * t);
        let low = sample(4u * nodes, dims(), ij, ends.low);
        let high = sample(5u * nodes, dims(), ij, ends.high);
        value = seen_smooth(p.z * nodes, ij, way) + (1.0 - w) * low + w * high;
        let trust = share_of(vector_at((2u * (morph.layers + 2u) + 2u) * blocks, ij, way));
        if trust < 1.0 {
            value = trust * value + (1.0 - trust) * value_at(p);
        }
        value = clamp(value, -morph.limit, morph.limit);
    }
    layers[p.z * image_nodes() + p.y * image.nx + p.x] = nearness(value);
}

var<workgroup> differs: atomic<u32>;
var<workgroup> square_place: u32;

// Squares of the layers on the image, a workgroup each: the one value of a square that is whole, with NONE before it, or the place of its values.
@compute @workgroup_size(lane_count)
fn pack(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let task = list_index(group, 0u) / lane_count;
    let across = (vec2<u32>(morph.nx, morph.ny) + SQUARE - 1u) / SQUARE;
    if task >= morph.layers * across.x * across.y {
        return;
    }
    if local == 0u {
        atomicStore(&differs, 0u);
    }
    workgroupBarrier();
    let corner = SQUARE * vec2<u32>(task % across.x, task / across.x % across.y);
    let size = min(vec2<u32>(SQUARE), vec2<u32>(morph.nx, morph.ny) - corner);
    let first = task / (across.x * across.y) * image_nodes() + (morph.pad_y + corner.y) * image.nx + morph.pad_x + corner.x;
    let one = dense[first];
    for (var k = local; k < SQUARE * SQUARE; k += lane_count) {
        let own = vec2<u32>(k % SQUARE, k / SQUARE);
        if all(own < size) && dense[first + own.y * image.nx + own.x] != one {
            atomicOr(&differs, 1u);
        }
    }
    workgroupBarrier();
    let whole = atomicLoad(&differs) == 0u;
    if local == 0u {
        if whole {
            squares[task] = vec2<u32>(NONE, bitcast<u32>(distance_of(one)));
        } else {
            square_place = atomicAdd(&used[0], 1u);
            squares[task] = vec2<u32>(square_place, 0u);
        }
    }
    workgroupBarrier();
    if whole {
        return;
    }
    let to = square_place * SQUARE * SQUARE;
    for (var k = local; k < SQUARE * SQUARE; k += lane_count) {
        let own = min(vec2<u32>(k % SQUARE, k / SQUARE), size - 1u);
        packed[to + k] = distance_of(dense[first + own.y * image.nx + own.x]);
    }
}

// Values of slices at some places.
@compute @workgroup_size(lane_count)
fn take(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = list_index(group, local);
    if n < morph.places {
        taken[n] = slices[places[n]];
    }
}
