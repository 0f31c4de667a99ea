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

// A slice: its number in `fields`, what it has on either side, its gaps, px: below and above, or at an end the nearer and the farther
// (0: there is none), those beyond these (0: there is none), how far the stack is relief, and what contours may be off by, px.
struct Knot {
    slice: u32,
    sides: u32,
    gaps: vec2<f32>,
    farther: vec2<f32>,
    relief: f32,
    doubt: f32,
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

// The gaps beside a slice between others, and what is seen together with one that is narrow beside the other.
fn beside(knot: Knot, ij: vec2<i32>) -> array<vec2<f32>, 2> {
    let s = knot.slice;
    let h = knot.gaps;
    let here = vec2<f32>(0.0);
    let own = array(vec2<f32>(secant_down(s, ij, here, h.x), h.x), vec2<f32>(secant_up(s, ij, here, h.y), h.y));
    var beyond = array(vec2<f32>(0.0), vec2<f32>(0.0));
    if narrow(h.x, h.y) > 0.0 && knot.farther.x > 0.0 {
        let u = vector(s - 1u, 1u, ij, here);
        beyond[0] = vec2<f32>(secant_down(s - 1u, ij, -u, knot.farther.x), knot.farther.x);
    }
    if narrow(h.y, h.x) > 0.0 && knot.farther.y > 0.0 {
        let u = vector(s, 0u, ij, here);
        beyond[1] = vec2<f32>(secant_up(s + 1u, ij, u, knot.farther.y), knot.farther.y);
    }
    return settled(own, beyond, knot.doubt);
}

// The slope at an end from the two gaps next to it, the nearer first.
fn at_end(nearer: vec2<f32>, next: vec2<f32>, doubt: f32) -> f32 {
    let gaps = settled(array(nearer, next), array(vec2<f32>(0.0), vec2<f32>(0.0)), doubt);
    return three_point_end(vec2<f32>(gaps[0].x, gaps[1].x), vec2<f32>(gaps[0].y, gaps[1].y));
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
        let gaps = beside(knot, ij);
        found = slope(vec2<f32>(gaps[0].x, gaps[1].x), vec2<f32>(gaps[0].y, gaps[1].y), knot.relief);
    } else if knot.sides == ABOVE {
        let d = secant_up(s, ij, here, h.x);
        found = d;
        if h.y > 0.0 {
            let u = vector(s, 0u, ij, here);
            found = at_end(vec2<f32>(d, h.x), vec2<f32>(secant_up(s + 1u, ij, u, h.y), h.y), knot.doubt);
        }
    } else {
        let d = secant_down(s, ij, here, h.x);
        found = d;
        if h.y > 0.0 {
            let u = vector(s - 1u, 1u, ij, here);
            found = at_end(vec2<f32>(d, h.x), vec2<f32>(secant_down(s - 1u, ij, -u, h.y), h.y), knot.doubt);
        }
    }
    slopes[(p.z * image.ny + p.y) * image.nx + p.x] = found;
}
