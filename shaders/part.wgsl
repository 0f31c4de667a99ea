// Distance field of a part of a contour: distances to its own edges and to the others', and the whole contour's value where its nearest
// edge is the part's own, which fades out where it is not. The twin is src/reference/part.rs.
//
// A job has two tiles one after the other, `own` first: `whole` and `inside` (1 or 0) are given on both.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> blocks: array<Block>;
@group(0) @binding(4) var<storage, read> whole: array<f32>;
@group(0) @binding(5) var<storage, read> inside: array<f32>;
@group(0) @binding(6) var<storage, read_write> d: array<f32>;
@group(0) @binding(7) var<storage, read_write> awake: array<atomic<u32>>;

const FAR: f32 = 1e30;
const PATCH: u32 = 16u;
// Where an edge of another part is nearer by less than this, the whole contour's field still has a share in the value, px.
const BOTH: f32 = 0.5;

// Whether the contour crosses an edge between a pixel and its neighbours that is the part's own, and one that is not.
fn edges(q: u32, node: u32, i: u32, j: u32) -> vec2<bool> {
    let nx = jobs[q].nx;
    var found = vec2<bool>(false);
    if i > 0u {
        found |= edge(node, node - 1u);
    }
    if i + 1u < nx {
        found |= edge(node, node + 1u);
    }
    if j > 0u {
        found |= edge(node, node - nx);
    }
    if j + 1u < jobs[q].ny {
        found |= edge(node, node + nx);
    }
    return found;
}

fn edge(node: u32, next: u32) -> vec2<bool> {
    let crossed = (whole[next] < 0.0) != (whole[node] < 0.0);
    let own = inside[next] != inside[node];
    return vec2<bool>(crossed && own, crossed && !own);
}

// Start values of both sweeps; a value with its sign bit set stays.
@compute @workgroup_size(lane_count)
fn start_part(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let n = node - jobs[q].offset;
    let i = n % jobs[q].nx;
    let j = n / jobs[q].nx;
    if j >= jobs[q].ny {
        return;
    }
    let found = edges(q, node, i, j);
    let of_own = (q & 1u) == 0u;
    d[node] = FAR;
    if select(found.y, found.x, of_own) {
        d[node] = -max(abs(whole[node]), 1e-30);
        atomicStore(&awake[jobs[q].first_copy + (j / PATCH) * ((jobs[q].nx + PATCH - 1u) / PATCH) + i / PATCH], 2u);
    }
}

// The part's signed distance, into the tile of `own`.
@compute @workgroup_size(lane_count)
fn finish_part(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    if (q & 1u) == 1u {
        return;
    }
    let twin = node - jobs[q].offset + jobs[q + 1u].offset;
    let own = d[node];
    let other = d[twin];
    let same_side = (whole[node] < 0.0) == (inside[node] > 0.5);
    let kept = select(0.0, 1.0 - clamp((abs(own) - abs(other)) / BOTH, 0.0, 1.0), same_side);
    let away = kept * abs(whole[node]) + (1.0 - kept) * abs(own);
    d[node] = select(away, -away, inside[node] > 0.5);
}
