// From a slice to its level set: half a pixel to either side of a mask, anti-aliasing with `2 G - G * G`, the side of every pixel kept, the limit by
// the exact distance, the conditioned values put in, and the area of the mask restored. The twin is src/reference/contour_field.rs.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> rule: Rule;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> blocks: array<Block>;
@group(0) @binding(4) var<storage, read> first: array<f32>;
@group(0) @binding(5) var<storage, read> second: array<f32>;
@group(0) @binding(6) var<storage, read> sides: array<f32>;
@group(0) @binding(7) var<storage, read_write> result: array<f32>;
@group(0) @binding(8) var<storage, read_write> lengths: array<f32>;
@group(0) @binding(9) var<storage, read> mask: array<u32>;

// Weights of a Gaussian in groups of four, `reach` to each side; smallest |value| that keeps a pixel's side; largest move from the exact
// distance; how far conditioned values count; least length of contour that an area is divided by; largest move
// for an area; square of a gradient that tells of no direction.
struct Rule {
    weights: array<vec4<f32>, 11>,
    reach: u32,
    vertical: u32,
    mask_floor: f32,
    field_floor: f32,
    kernel_clip: f32,
    conditioned: f32,
    least_length: f32,
    most_shift: f32,
    flat_square: f32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
}

fn keep_side(v: f32, side: f32, floor: f32) -> f32 {
    return select(max(v, floor), min(v, -floor), side < 0.0);
}

// Half a pixel inside or outside, by the pixels' bits; 1 behind each tile.
@compute @workgroup_size(lane_count)
fn spread(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let inside = ((mask[node / 32u] >> (node % 32u)) & 1u) == 1u;
    result[node] = select(1.0, select(0.5, -0.5, inside), node - jobs[q].offset < jobs[q].nx * jobs[q].ny);
}

// One axis of a Gaussian of `first`, the tile's edge repeated.
@compute @workgroup_size(lane_count)
fn gaussian(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let n = node - jobs[q].offset;
    if n >= nx * ny {
        return;
    }
    let i = n % nx;
    let j = n / nx;
    let at = select(i, j, rule.vertical == 1u);
    let last = select(nx, ny, rule.vertical == 1u) - 1u;
    let stride = select(1u, nx, rule.vertical == 1u);
    let origin = node - at * stride;
    var sum = 0.0;
    for (var k = 0u; k <= 2u * rule.reach; k++) {
        let reading = min(max(at + k, rule.reach) - rule.reach, last);
        sum += rule.weights[k / 4u][k % 4u] * first[origin + reading * stride];
    }
    result[node] = sum;
}

// `2 G u - G G u` on the mask's side.
@compute @workgroup_size(lane_count)
fn sharpen(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node < params.block_count * BLOCK {
        result[node] = keep_side(2.0 * first[node] - second[node], sides[node], rule.mask_floor);
    }
}

// `first` on the mask's side.
@compute @workgroup_size(lane_count)
fn hold_sides(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node < params.block_count * BLOCK {
        result[node] = keep_side(first[node], sides[node], rule.mask_floor);
    }
}

// `result` no farther than KERNEL_CLIP from the exact distance `first`.
@compute @workgroup_size(lane_count)
fn limit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node < params.block_count * BLOCK {
        result[node] = clamp(result[node], first[node] - rule.kernel_clip, first[node] + rule.kernel_clip);
    }
}

// The distance `second`, replaced by the conditioned field `first` near the contour; no pixel changes its side.
@compute @workgroup_size(lane_count)
fn put_conditioned(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let b = node / BLOCK;
    let bit = 1u << (node & 31u);
    let near = blocks[b].near[(node >> 5u) & 1u];
    let use_first = (near & bit) != 0u && abs(first[node]) < rule.conditioned;
    result[node] = keep_side(select(second[node], first[node], use_first), second[node], rule.field_floor);
}

// Share of a pixel inside a contour at that distance from it.
fn covered(v: f32) -> f32 {
    return clamp(0.5 - v, 0.0, 1.0);
}

// Width of a pixel across the contour whose level set has this gradient.
fn pixel_width(gradient: vec2<f32>) -> f32 {
    let sides = vec2(params.hx, params.hy);
    let least = min(sides.x, sides.y);
    let squares = gradient * gradient;
    return sqrt((dot(squares, sides * sides) + rule.flat_square * least * least) / (squares.x + squares.y + rule.flat_square));
}

// The area that each pixel lacks of its mask in the level set `first`, and the length of contour in it.
@compute @workgroup_size(lane_count)
fn measure_area(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let n = node - jobs[q].offset;
    result[node] = 0.0;
    lengths[node] = 0.0;
    let v = first[node];
    // No pixel is wider than 1.
    if n >= nx * ny || abs(v) >= 1.0 {
        return;
    }
    let i = n % nx;
    let j = n / nx;
    let right = node + select(1u, 0u, i + 1u == nx);
    let left = node - select(1u, 0u, i == 0u);
    let up = node + select(nx, 0u, j + 1u == ny);
    let down = node - select(nx, 0u, j == 0u);
    // The steeper side: in the middle of a thin part the level set rises to both.
    let across = max(abs(first[right] - v), abs(first[left] - v));
    let along = max(abs(first[up] - v), abs(first[down] - v));
    let width = pixel_width(vec2(across / params.hx, along / params.hy));
    result[node] = select(0.0, 1.0, sides[node] < 0.0) - covered(v / width);
    lengths[node] = 2.0 * (covered(v / width - 0.25) - covered(v / width + 0.25)) / width;
}

// `result` moved by the area `first` that it lacks per length `second`, both from around the pixel; no pixel changes its side.
@compute @workgroup_size(lane_count)
fn restore_area(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node < params.block_count * BLOCK {
        let shift = clamp(first[node] / max(second[node], rule.least_length), -rule.most_shift, rule.most_shift);
        result[node] = keep_side(result[node] - shift, sides[node], rule.field_floor);
    }
}
