// From sweeps to slices. A front is copied as bits (in N, inside) and the values of N alone, so that the copies of a sweep take little more
// room than its contours; the copies of both directions are then blended into whole tiles.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> blocks: array<Block>;
@group(0) @binding(3) var<storage, read> phi: array<f32>;
@group(0) @binding(4) var<storage, read> reached: Reached;
@group(0) @binding(5) var<storage, read_write> copies: array<Copy>;
@group(0) @binding(6) var<storage, read_write> values: Values;
@group(0) @binding(7) var<storage, read> items: array<Item>;
@group(0) @binding(8) var<storage, read_write> blended: array<f32>;
@group(0) @binding(9) var<storage, read> slots: array<u32>;
@group(0) @binding(10) var<storage, read> before: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> holes: array<Hole>;
@group(0) @binding(12) var<storage, read> hole_values: array<f32>;

// How much deeper one sweep's field may be than the other's when they are blended, px: the reason is in src/backend/jobs.rs.
const DISAGREEMENT: f32 = 0.5;

// A front that is wanted within a step: whose, where its copy goes, and the share of the step.
struct Read {
    job: u32,
    copy: u32,
    share: f32,
    padding: u32,
}

struct Reached {
    groups_x: u32,
    groups_y: u32,
    groups_z: u32,
    count: u32,
    reads: array<Read>,
}

// A block of a copied front.
struct Copy {
    near: vec2<u32>,
    inside: vec2<u32>,
    first: u32,
    padding: u32,
}

struct Values {
    used: atomic<u32>,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
    phi: array<f32>,
}

// A slice of a group: its copies from below and above (NONE: that front has vanished), their weights, and where it goes.
struct Item {
    up: u32,
    down: u32,
    up_weight: f32,
    down_weight: f32,
    block_count: u32,
    offset: u32,
    // Holes that are cut out of it.
    first_hole: u32,
    hole_count: u32,
    nx: u32,
}

// A hole: where its distances begin, what is added to them, and its own tile in pixels of its slice's.
struct Hole {
    first: u32,
    offset: f32,
    x: u32,
    y: u32,
    nx: u32,
    ny: u32,
}

// A pixel of a front at this share of a step, `(1 - q) phi_n + q phi_{n+1} + q (1 - q) (b + c q)`: steps are the sweep's own, whatever times
// are asked for. With the bends b and c of the courses pieces of contour go as their courses go, not along the chords of steps.
fn value_between(node: u32, near: bool, q: f32) -> f32 {
    let after = phi[node];
    if !near {
        return after;
    }
    let b = before[min(slots[node], params.band_capacity - 1u)];
    return (1.0 - q) * b.x + q * after + q * (1.0 - q) * (b.y + q * b.z);
}

// Copies the fronts that are wanted within this step, block by block, before the band follows.
@compute @workgroup_size(lane_count)
fn copy_front(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let row = row_index(group);
    if row >= reached.count {
        return;
    }
    let wanted = reached.reads[row];
    let q = wanted.job;
    let k = group.x * lane_count + local;
    if k >= jobs[q].block_count {
        return;
    }
    let b = jobs[q].first_block + k;
    let near = blocks[b].near;
    var inside = vec2<u32>(0u);
    for (var c = 0u; c < BLOCK; c++) {
        let bit = 1u << (c & 31u);
        if value_between(b * BLOCK + c, (near[c >> 5u] & bit) != 0u, wanted.share) < 0.0 {
            inside[c >> 5u] |= bit;
        }
    }
    let count = countOneBits(near.x) + countOneBits(near.y);
    var first = 0u;
    if count > 0u {
        first = atomicAdd(&values.used, count);
        var place = first;
        for (var word = 0u; word < 2u; word++) {
            var bits = near[word];
            while bits != 0u {
                let node = b * BLOCK + word * 32u + countTrailingZeros(bits);
                bits &= bits - 1u;
                if place < params.value_capacity {
                    values.phi[place] = value_between(node, true, wanted.share);
                }
                place++;
            }
        }
    }
    copies[wanted.copy + k] = Copy(near, inside, first, 0u);
}

// A pixel of a copied front, clamped to the tube.
fn front_value(block: Copy, c: u32) -> f32 {
    let outside = params.gamma + 0.5;
    let bit = 1u << (c & 31u);
    let near = block.near[c >> 5u];
    if (near & bit) == 0u {
        return select(outside, -outside, (block.inside[c >> 5u] & bit) != 0u);
    }
    let rank = countOneBits(near & (bit - 1u)) + select(0u, countOneBits(block.near.x), c >= 32u);
    return clamp(values.phi[min(block.first + rank, params.value_capacity - 1u)], -outside, outside);
}

fn disagreement(weight: f32) -> f32 {
    return DISAGREEMENT * max(0.5 / max(1.0 - weight, 1e-6), 1.0);
}

// `(1 - w) up + w down`, neither deeper than the other by more than `disagreement`, without the holes that end between the contours.
@compute @workgroup_size(lane_count)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let row = row_index(group);
    if row >= arrayLength(&items) {
        return;
    }
    let item = items[row];
    let k = group.x * lane_count + local;
    if k >= item.block_count {
        return;
    }
    let gone = Copy(vec2<u32>(0u), vec2<u32>(0u), 0u, 0u);
    var up = gone;
    var down = gone;
    if item.up != NONE {
        up = copies[item.up + k];
    }
    if item.down != NONE {
        down = copies[item.down + k];
    }
    for (var c = 0u; c < BLOCK; c++) {
        let a = front_value(up, c);
        let b = front_value(down, c);
        let nearer = min(abs(a), abs(b));
        let up_limit = nearer + disagreement(item.up_weight);
        let down_limit = nearer + disagreement(item.down_weight);
        var value = item.up_weight * clamp(a, -up_limit, up_limit) + item.down_weight * clamp(b, -down_limit, down_limit);
        let node = k * BLOCK + c;
        for (var h = item.first_hole; h < item.first_hole + item.hole_count; h++) {
            let hole = holes[h];
            // Where a pixel lies before the hole's first column or row the difference wraps, and is more than any size.
            let i = node % item.nx - hole.x;
            let j = node / item.nx - hole.y;
            if i < hole.nx && j < hole.ny {
                value = max(value, -(hole_values[hole.first + j * hole.nx + i] + hole.offset));
            }
        }
        blended[item.offset + node] = value;
    }
}
