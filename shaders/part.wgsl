// Distance field of a part of a contour: distances to its own edges and to the others', and the whole contour's value where its nearest
// edge is the part's own, which fades out where it is not. The twin is src/reference/part.rs.
//
// A job has two tiles one after the other, `own` first. `whole` and `inside`, a bit for each pixel, are given once for both.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> blocks: array<Block>;
@group(0) @binding(4) var<storage, read> whole: array<f32>;
@group(0) @binding(5) var<storage, read> inside: array<u32>;
@group(0) @binding(6) var<storage, read_write> d: array<f32>;
@group(0) @binding(7) var<storage, read_write> awake: array<atomic<u32>>;

const FAR: f32 = 1e30;
const PATCH: u32 = 16u;
// Where an edge of another part is nearer by less than this, the whole contour's field still has a share in the value, px.
const BOTH: f32 = 0.5;

// Place of a node of tile `q` in what is given once: each tile is as long as its twin, so that half of the places come before.
fn place_of(q: u32, node: u32) -> u32 {
    return node - jobs[q].offset + jobs[q & ~1u].offset / 2u;
}

fn is_inside(place: u32) -> bool {
    return ((inside[place / 32u] >> (place % 32u)) & 1u) == 1u;
}

// Whether the contour crosses an edge between the pixel at a place and its neighbours that is the part's own, and one that is not.
fn edges(q: u32, place: u32, i: u32, j: u32) -> vec2<bool> {
    let nx = jobs[q].nx;
    var found = vec2<bool>(false);
    if i > 0u {
        found |= edge(place, place - 1u);
    }
    if i + 1u < nx {
        found |= edge(place, place + 1u);
    }
    if j > 0u {
        found |= edge(place, place - nx);
    }
    if j + 1u < jobs[q].ny {
        found |= edge(place, place + nx);
    }
    return found;
}

fn edge(place: u32, next: u32) -> vec2<bool> {
    let crossed = (whole[next] < 0.0) != (whole[place] < 0.0);
    let own = is_inside(next) != is_inside(place);
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
    let place = place_of(q, node);
    let found = edges(q, place, i, j);
    let of_own = (q & 1u) == 0u;
    d[node] = FAR;
    if select(found.y, found.x, of_own) {
        d[node] = -max(abs(whole[place]), 1e-30);
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
    let place = place_of(q, node);
    let own = d[node];
    let other = d[twin];
    let part = is_inside(place);
    let same_side = (whole[place] < 0.0) == part;
    let kept = select(0.0, 1.0 - clamp((abs(own) - abs(other)) / BOTH, 0.0, 1.0), same_side);
    let away = kept * abs(whole[place]) + (1.0 - kept) * abs(own);
    d[node] = select(away, -away, part);
}
