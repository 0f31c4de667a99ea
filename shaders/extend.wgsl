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

// Neighbours to either side that differ by less than this are as close, px: neither rounding nor the direction in which pixels are numbered must
// decide from which side a value comes; both count.
const ALIKE: f32 = 1e-3;

// Band places of the upwind neighbours in x and in y, one of them twice where only one is closer, and the weight of those in x; a pixel that keeps
// its value points at itself.
struct Source {
    x: u32,
    other_x: u32,
    y: u32,
    other_y: u32,
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
    var source = Source(k, k, k, k, 1.0);
    if !at_contour(node, nx) {
        let at = abs(phi[node]);
        let x = closer(node - 1u, node + 1u);
        let y = closer(node - nx, node + nx);
        let wx = gain(at, x) / (params.hx * params.hx);
        let wy = gain(at, y) / (params.hy * params.hy);
        if wx + wy > 1e-12 {
            let from_x = select(vec2<u32>(k), vec2<u32>(slots[x.x], slots[x.y]), wx > 0.0);
            let from_y = select(vec2<u32>(k), vec2<u32>(slots[y.x], slots[y.y]), wy > 0.0);
            source = Source(from_x.x, from_x.y, from_y.x, from_y.y, wx / (wx + wy));
        }
    }
    sources[k] = source;
}

// The closer of the neighbours before and behind, twice, or both.
fn closer(before: u32, behind: u32) -> vec2<u32> {
    let a = abs(phi[before]);
    let b = abs(phi[behind]);
    let alike = a >= b - ALIKE && b >= a - ALIKE;
    if alike && speaks(before) == speaks(behind) {
        return vec2<u32>(before, behind);
    }
    return vec2<u32>(select(behind, before, select(a < b, speaks(before), alike)));
}

// Only pixels of T have something to say, and none of the rim, which no list holds.
fn speaks(node: u32) -> bool {
    return abs(phi[node]) < params.gamma && slots[node] != NONE;
}

// How much closer to the contour neighbours are.
fn gain(at: f32, nodes: vec2<u32>) -> f32 {
    let v = 0.5 * (abs(phi[nodes.x]) + abs(phi[nodes.y]));
    return select(0.0, max(at - v, 0.0), speaks(nodes.x) && speaks(nodes.y));
}

@compute @workgroup_size(lane_count)
fn extend_courses(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let s = sources[k];
    let x = 0.5 * (courses[s.x] + courses[s.other_x]);
    let y = 0.5 * (courses[s.y] + courses[s.other_y]);
    next_courses[k] = s.weight * x + (1.0 - s.weight) * y;
}

@compute @workgroup_size(lane_count)
fn extend_line(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.band_total {
        return;
    }
    let s = sources[k];
    let x = 0.5 * (line[s.x] + line[s.other_x]);
    let y = 0.5 * (line[s.y] + line[s.other_y]);
    next_line[k] = s.weight * x + (1.0 - s.weight) * y;
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
