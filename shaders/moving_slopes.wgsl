// Slopes of the fields at the slices, along the trajectories. The twin is src/reference/moving_slopes.rs.
//
// Two displacements an interval: as its lower slice reads it, then as its upper slice does.

@group(0) @binding(1) var<storage, read> fields: array<f32>;
@group(0) @binding(2) var<storage, read> vectors: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> knots: array<Knot>;
@group(0) @binding(4) var<storage, read_write> slopes: array<f32>;

// What a slice has on either side.
const BOTH: u32 = 0u;
const ABOVE: u32 = 1u;
const BELOW: u32 = 2u;

// A slice: its number in `fields`, what it has on either side, and its gaps, px: below and above, or at an end the nearer and the farther
// (0: there is none), and how far the stack is relief.
struct Knot {
    slice: u32,
    sides: u32,
    gaps: vec2<f32>,
    relief: f32,
    padding: f32,
}

fn value(slice: u32, ij: vec2<i32>, offset: vec2<f32>) -> f32 {
    return sample(slice * image.nx * image.ny, vec2<u32>(image.nx, image.ny), ij, offset);
}

fn vector(interval: u32, upper: u32, ij: vec2<i32>, offset: vec2<f32>) -> vec2<f32> {
    return vector_at((2u * interval + upper) * image.columns * image.rows, ij, offset);
}

// Secant from a place of `slice` to the slice above.
fn secant_up(slice: u32, ij: vec2<i32>, offset: vec2<f32>, gap: f32) -> f32 {
    let u = vector(slice, 0u, ij, offset);
    return (value(slice + 1u, ij, offset + u) - value(slice, ij, offset)) / gap;
}

// Secant from the slice below to a place of `slice`.
fn secant_down(slice: u32, ij: vec2<i32>, offset: vec2<f32>, gap: f32) -> f32 {
    let u = vector(slice - 1u, 1u, ij, offset);
    return (value(slice, ij, offset) - value(slice - 1u, ij, offset - u)) / gap;
}

// Per px of height: between other slices `slope` of the secants, at the ends the three-point formula.
@compute @workgroup_size(lane_count)
fn find_slopes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let p = pixel_of(list_index(group, local));
    if !on_image(p) {
        return;
    }
    let ij = vec2<i32>(p.xy);
    let here = vec2<f32>(0.0);
    let knot = knots[p.z];
    let s = knot.slice;
    let h = knot.gaps;
    var found: f32;
    if knot.sides == BOTH {
        let d = vec2<f32>(secant_down(s, ij, here, h.x), secant_up(s, ij, here, h.y));
        found = slope(d, h, knot.relief);
    } else if knot.sides == ABOVE {
        let d = secant_up(s, ij, here, h.x);
        found = d;
        if h.y > 0.0 {
            let u = vector(s, 0u, ij, here);
            found = three_point_end(vec2<f32>(d, secant_up(s + 1u, ij, u, h.y)), h);
        }
    } else {
        let d = secant_down(s, ij, here, h.x);
        found = d;
        if h.y > 0.0 {
            let u = vector(s - 1u, 1u, ij, here);
            found = three_point_end(vec2<f32>(d, secant_down(s - 1u, ij, -u, h.y)), h);
        }
    }
    slopes[(p.z * image.ny + p.y) * image.nx + p.x] = found;
}
