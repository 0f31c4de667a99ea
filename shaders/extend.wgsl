// Extension of values off the contour along its normals (Eq. 3): Jacobi passes of the steady first-order upwind form. Every band pixel takes
// the mean of its neighbours closer to the contour, weighted by how much closer; pixels at the contour keep their values.
//
// Values lie in band order, so that a pass streams through memory; `find` turns neighbours into band places once per front.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> work: Work;
@group(0) @binding(3) var<storage, read> band: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> phi: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<u32>;
@group(0) @binding(6) var<storage, read_write> sources: array<Source>;
@group(0) @binding(7) var<storage, read> courses: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> next_courses: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> line: array<f32>;
@group(0) @binding(10) var<storage, read_write> next_line: array<f32>;
@group(0) @binding(11) var<storage, read> earlier: array<u32>;

// Neighbours to either side that differ by less than this are as close, px: rounding must not decide from which side a value comes.
const ALIKE: f32 = 1e-3;

// Band places of the upwind neighbours and the weight of the one in x; a pixel that keeps its value points at itself.
struct Source {
    x: u32,
    y: u32,
    weight: f32,
}

@compute @workgroup_size(lane_count)
fn find(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let node = band[k].x;
    let nx = jobs[band[k].y].nx;
    var source = Source(k, k, 1.0);
    if !at_contour(node, nx) {
        let at = abs(phi[node]);
        let x = select(node + 1u, node - 1u, abs(phi[node - 1u]) < abs(phi[node + 1u]) - ALIKE);
        let y = select(node + nx, node - nx, abs(phi[node - nx]) < abs(phi[node + nx]) - ALIKE);
        let wx = gain(at, x) / (params.hx * params.hx);
        let wy = gain(at, y) / (params.hy * params.hy);
        if wx + wy > 1e-12 {
            source = Source(select(k, slots[x], wx > 0.0), select(k, slots[y], wy > 0.0), wx / (wx + wy));
        }
    }
    sources[k] = source;
}

// How much closer to the contour a neighbour is; only pixels of T have something to say, and none of the rim, which no list holds.
fn gain(at: f32, node: u32) -> f32 {
    let v = abs(phi[node]);
    return select(max(at - v, 0.0), 0.0, v >= params.gamma || slots[node] == NONE);
}

@compute @workgroup_size(lane_count)
fn extend_courses(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let s = sources[k];
    next_courses[k] = s.weight * courses[s.x] + (1.0 - s.weight) * courses[s.y];
}

@compute @workgroup_size(lane_count)
fn extend_line(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let s = sources[k];
    next_line[k] = s.weight * line[s.x] + (1.0 - s.weight) * line[s.y];
}

// Brings the courses to the places of a rebuilt band; pixels that are new know nothing yet.
@compute @workgroup_size(lane_count)
fn carry(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let e = earlier[k];
    next_courses[k] = select(courses[min(e, params.band_capacity - 1u)], vec4<f32>(0.0), e == NONE);
}
