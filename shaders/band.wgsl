// The tubes of Peng et al. 1999: T = {|phi| < gamma} and N = T and its ring of eight neighbours; outside N phi is +-(gamma + 1/2).
//
// The twin keeps N as runs of pixels. Here it is one bit per pixel in blocks of 64, and the list of band pixels is compacted from the bits:
// `tube` marks T in the blocks of the old N and every block that the new N may touch, `tally` and `gather` list those blocks, `grow` makes N
// from T by shifting whole words, `scan` gives each block its place, `collect` writes the list. A rebuild looks at the old tube's blocks only,
// and the list is in row order and the same in every run. Where pixels are looked at an invocation takes an eighth of a block.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read_write> blocks: array<Block>;
@group(0) @binding(3) var<storage, read> work: Work;
@group(0) @binding(4) var<storage, read_write> work_mut: Work;
@group(0) @binding(5) var<storage, read_write> phi: array<f32>;
@group(0) @binding(6) var<storage, read_write> other: array<f32>;
@group(0) @binding(7) var<storage, read_write> slots: array<u32>;
@group(0) @binding(8) var<storage, read_write> touched: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> band: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> earlier: array<u32>;

// Pixels at a tile's edge that never belong to a tube: a WENO5 stencil and one more.
const RIM: u32 = 4u;

// Counts of blocks or marks, one for each workgroup that has counted; from `scan` on what comes before each.
@group(0) @binding(11) var<storage, read_write> places: array<u32>;

// Width of the one workgroup that scans.
override scan_width: u32 = 256u;
const SCAN_MOST: u32 = 256u;
var<workgroup> totals: array<u32, SCAN_MOST>;
var<workgroup> listed_blocks: u32;
// Nodes of an eighth of a block, and eighths of a block.
const EIGHTH: u32 = 8u;
// Two bits for each node of the eighths of a workgroup's blocks, the second ones from bit 8 on.
var<workgroup> eighths: array<u32, 64>;

// Sum of `count` over a workgroup's invocations up to this one, of which there are `width`; the last entry of `totals` is the whole.
fn sum_up_to(count: u32, local: u32, width: u32) -> u32 {
    totals[local] = count;
    workgroupBarrier();
    for (var reach = 1u; reach < width; reach *= 2u) {
        let before = select(0u, totals[max(local, reach) - reach], local >= reach);
        workgroupBarrier();
        totals[local] += before;
        workgroupBarrier();
    }
    return totals[local];
}

// One of the bits of a whole block, from bit `shift` of its eighths on, of which the first is `first`.
fn whole_block(first: u32, shift: u32) -> vec2<u32> {
    var bits = vec2<u32>(0u);
    for (var e = 0u; e < EIGHTH; e++) {
        bits[e >> 2u] |= ((eighths[first + e] >> shift) & 255u) << (EIGHTH * (e & 3u));
    }
    return bits;
}

// The whole tile is the old tube: clamps phi, marks T, and lists every block.
@compute @workgroup_size(lane_count)
fn start(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    let b = min(k / EIGHTH, params.block_count - 1u);
    let q = blocks[b].job;
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let first = (b - jobs[q].first_block) * BLOCK + (k % EIGHTH) * EIGHTH;
    let outside = params.gamma + 0.5;
    let listed = k < params.block_count * EIGHTH;
    var bits = 0u;
    for (var c = 0u; listed && c < EIGHTH; c++) {
        let n = first + c;
        let node = jobs[q].offset + n;
        let v = clamp(phi[node], -outside, outside);
        phi[node] = v;
        other[node] = v;
        slots[node] = NONE;
        let i = n % nx;
        let j = n / nx;
        if i >= RIM && i + RIM < nx && j >= RIM && j + RIM < ny {
            bits |= select(256u, 257u, abs(v) < params.gamma) << c;
        }
    }
    eighths[local] = bits;
    workgroupBarrier();
    if listed && k % EIGHTH == 0u {
        let inner = whole_block(local, 8u);
        blocks[b].near = inner;
        blocks[b].inner = inner;
        blocks[b].tube = whole_block(local, 0u);
        work_mut.blocks[b] = b;
        if b == 0u {
            set_block_total(params.block_count);
        }
    }
}

fn set_block_total(total: u32) {
    work_mut.block_total = total;
    work_mut.block_groups = groups_of(total);
    work_mut.eighth_groups = groups_of(total * EIGHTH);
}

// Arguments of a dispatch over a list.
fn groups_of(total: u32) -> array<u32, 4> {
    let groups = list_groups(total);
    return array<u32, 4>(groups.x, groups.y, groups.z, 0u);
}

fn touch(b: u32) {
    atomicOr(&touched[b >> 5u], 1u << (b & 31u));
}

// T in each listed block, and the blocks that N may touch. Jobs that are done mark nothing and so leave the list.
@compute @workgroup_size(lane_count)
fn tube(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    let e = k % EIGHTH;
    let listed = k < work.block_total * EIGHTH;
    let b = work.blocks[min(k / EIGHTH, work.block_total - 1u)];
    let q = blocks[b].job;
    let runs = listed && jobs[q].phase == RUNNING;
    let near = blocks[b].near;
    // Those of the old N that are close to the contour now.
    var bits = select(0u, (near[e >> 2u] >> (EIGHTH * (e & 3u))) & 255u, runs);
    var own = 0u;
    while bits != 0u {
        let c = countTrailingZeros(bits);
        bits &= bits - 1u;
        if abs(phi[b * BLOCK + e * EIGHTH + c]) < params.gamma {
            own |= 1u << c;
        }
    }
    eighths[local] = own;
    workgroupBarrier();
    if !listed || e != 0u {
        return;
    }
    let tube = whole_block(local, 0u);
    blocks[b].tube = tube;
    if runs && any(near != vec2<u32>(0u)) {
        touch(b);
    }
    if any(tube != vec2<u32>(0u)) {
        let first = select(32u + countTrailingZeros(tube.y), countTrailingZeros(tube.x), tube.x != 0u);
        let last = select(31u - countLeadingZeros(tube.x), 63u - countLeadingZeros(tube.y), tube.y != 0u);
        let nx = jobs[q].nx;
        for (var row = 0u; row < 3u; row++) {
            let base = b * BLOCK + row * nx - nx;
            for (var t = (base + first - 1u) / BLOCK; t <= (base + last + 1u) / BLOCK; t++) {
                touch(t);
            }
        }
    }
}

// Marks in 32 blocks, none beyond the last word.
fn touched_blocks(w: u32) -> u32 {
    if w >= (params.block_count + 31u) / 32u {
        return 0u;
    }
    return atomicLoad(&touched[w]);
}

// How many blocks are touched, by a word an invocation.
@compute @workgroup_size(lane_count)
fn tally(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let own = sum_up_to(countOneBits(touched_blocks(list_index(group, local))), local, lane_count);
    if local == lane_count - 1u {
        places[group_index(group)] = own;
    }
}

// Lists the touched blocks in order and wipes the marks.
@compute @workgroup_size(lane_count)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let g = group_index(group);
    var before = 0u;
    for (var t = local; t < g; t += lane_count) {
        before += places[t];
    }
    sum_up_to(before, local, lane_count);
    let first = totals[lane_count - 1u];
    workgroupBarrier();
    let w = list_index(group, local);
    var bits = touched_blocks(w);
    let count = countOneBits(bits);
    var place = first + sum_up_to(count, local, lane_count) - count;
    if bits != 0u {
        atomicStore(&touched[w], 0u);
    }
    while bits != 0u {
        let c = countTrailingZeros(bits);
        bits &= bits - 1u;
        work_mut.blocks[place] = w * 32u + c;
        place++;
    }
    let words = (params.block_count + 31u) / 32u;
    if w == words - 1u {
        set_block_total(place);
    }
}

// T as one string of bits, a word of it.
fn tube_word(w: u32) -> u32 {
    return blocks[w >> 1u].tube[w & 1u];
}

// The 32 bits that begin at bit `shift` of three words, `shift` at most 64.
fn cut_out(words: vec3<u32>, shift: u32) -> u32 {
    let low = select(words.x, words.y, shift >= 32u);
    let high = select(words.y, words.z, shift >= 32u);
    let by = shift & 31u;
    return select((low >> by) | (high << (32u - by)), low, by == 0u);
}

// T and its ring in the 32 nodes from `node` on.
fn grown(node: u32, nx: u32, inner: u32) -> u32 {
    if inner == 0u {
        return 0u;
    }
    var bits = 0u;
    for (var row = 0u; row < 3u; row++) {
        let first = node + row * nx - nx - 1u;
        let w = first >> 5u;
        let words = vec3<u32>(tube_word(w), tube_word(w + 1u), tube_word(w + 2u));
        let shift = first & 31u;
        bits |= cut_out(words, shift) | cut_out(words, shift + 1u) | cut_out(words, shift + 2u);
    }
    return bits & inner;
}

fn put_outside(leaving: u32, first: u32) {
    var bits = leaving;
    while bits != 0u {
        let node = first + countTrailingZeros(bits);
        bits &= bits - 1u;
        let v = with_sign(params.gamma + 0.5, phi[node]);
        phi[node] = v;
        other[node] = v;
        slots[node] = NONE;
    }
}

// N = T and its ring; pixels that leave N become outside.
@compute @workgroup_size(lane_count)
fn grow(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    let listed = k < work.block_total;
    let b = work.blocks[min(k, work.block_total - 1u)];
    var count = 0u;
    if listed {
        let nx = jobs[blocks[b].job].nx;
        let inner = blocks[b].inner;
        let near = vec2<u32>(grown(b * BLOCK, nx, inner.x), grown(b * BLOCK + 32u, nx, inner.y));
        let leaving = blocks[b].near & ~near;
        put_outside(leaving.x, b * BLOCK);
        put_outside(leaving.y, b * BLOCK + 32u);
        blocks[b].near = near;
        count = countOneBits(near.x) + countOneBits(near.y);
    }
    let sum = sum_up_to(count, local, lane_count);
    if listed {
        blocks[b].first = sum - count;
    }
    // Where rows of workgroups are more than the list, others have no place.
    if local == lane_count - 1u && group_index(group) * lane_count < work.block_total {
        places[group_index(group)] = sum;
    }
}

// Turns the counts of the workgroups of `grow` into places and says how long the band is.
@compute @workgroup_size(scan_width)
fn scan(@builtin(local_invocation_index) local: u32) {
    if local == 0u {
        listed_blocks = work_mut.block_total;
    }
    let count = (workgroupUniformLoad(&listed_blocks) + lane_count - 1u) / lane_count;
    var place = 0u;
    for (var first = 0u; first < count; first += scan_width) {
        let k = first + local;
        var own = 0u;
        if k < count {
            own = places[k];
        }
        let sum = sum_up_to(own, local, scan_width);
        if k < count {
            places[k] = place + sum - own;
        }
        place += totals[scan_width - 1u];
        workgroupBarrier();
    }
    if local == 0u {
        let kept = min(place, params.band_capacity);
        work_mut.band_wanted = max(work_mut.band_wanted, place);
        work_mut.band_total = kept;
        work_mut.band_groups = groups_of(kept);
        work_mut.chunk_groups = groups_of((kept + chunk_length - 1u) / chunk_length);
    }
}

// The band's pixels in row order with their jobs, where each was in the list before, and the way back from a pixel to the list.
@compute @workgroup_size(lane_count)
fn collect(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.block_total * EIGHTH {
        return;
    }
    let b = work.blocks[k / EIGHTH];
    let q = blocks[b].job;
    let near = blocks[b].near;
    let e = k % EIGHTH;
    let shift = EIGHTH * (e & 3u);
    let word = near[e >> 2u];
    var place = places[k / (EIGHTH * lane_count)] + blocks[b].first;
    place += countOneBits(word & ((1u << shift) - 1u)) + select(0u, countOneBits(near.x), e >= 4u);
    var bits = (word >> shift) & 255u;
    while bits != 0u {
        let node = b * BLOCK + e * EIGHTH + countTrailingZeros(bits);
        bits &= bits - 1u;
        if place < params.band_capacity {
            band[place] = vec2<u32>(node, q);
            earlier[place] = slots[node];
            slots[node] = place;
        }
        place++;
    }
}
