// The tubes of Peng et al. 1999: T = {|phi| < gamma} and N = T and its ring of eight neighbours; outside N phi is +-(gamma + 1/2).
//
// The twin keeps N as runs of pixels. Here it is one bit per pixel in blocks of 64, and the list of band pixels is compacted from the bits:
// `tube` marks T in the blocks of the old N and every block that the new N may touch, `gather` lists those blocks, `grow` makes N from T by
// shifting whole words, `scan` gives each block its place, `collect` writes the list. A rebuild looks at the old tube's blocks only, and the
// list is in row order and the same in every run.

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

// Width of the one workgroup that gathers and scans.
override scan_width: u32 = 256u;
const SCAN_MOST: u32 = 256u;
var<workgroup> totals: array<u32, SCAN_MOST>;

// The whole tile is the old tube: clamps phi, marks T, and lists every block.
@compute @workgroup_size(lane_count)
fn start(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let b = list_index(group, local);
    if b >= params.block_count {
        return;
    }
    let q = blocks[b].job;
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let first = (b - jobs[q].first_block) * BLOCK;
    let outside = params.gamma + 0.5;
    var inner = vec2<u32>(0u);
    var tube = vec2<u32>(0u);
    for (var c = 0u; c < BLOCK; c++) {
        let n = first + c;
        let node = jobs[q].offset + n;
        let v = clamp(phi[node], -outside, outside);
        phi[node] = v;
        other[node] = v;
        slots[node] = NONE;
        let i = n % nx;
        let j = n / nx;
        if i >= RIM && i + RIM < nx && j >= RIM && j + RIM < ny {
            inner[c >> 5u] |= 1u << (c & 31u);
            if abs(v) < params.gamma {
                tube[c >> 5u] |= 1u << (c & 31u);
            }
        }
    }
    blocks[b].near = inner;
    blocks[b].inner = inner;
    blocks[b].tube = tube;
    work_mut.blocks[b] = b;
    if b == 0u {
        set_block_total(params.block_count);
    }
}

fn set_block_total(total: u32) {
    work_mut.block_total = total;
    work_mut.block_groups = groups_of(total);
}

// Arguments of a dispatch over a list.
fn groups_of(total: u32) -> array<u32, 4> {
    let groups = list_groups(total);
    return array<u32, 4>(groups.x, groups.y, groups.z, 0u);
}

fn touch(b: u32) {
    atomicOr(&touched[b >> 5u], 1u << (b & 31u));
}

// Nodes of a word that lie in T: those of the old N that are close to the contour now.
fn tube_bits(near: u32, first: u32) -> u32 {
    var bits = near;
    var tube = 0u;
    while bits != 0u {
        let c = countTrailingZeros(bits);
        bits &= bits - 1u;
        if abs(phi[first + c]) < params.gamma {
            tube |= 1u << c;
        }
    }
    return tube;
}

// T in each listed block, and the blocks that N may touch. Jobs that are done mark nothing and so leave the list.
@compute @workgroup_size(lane_count)
fn tube(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.block_total {
        return;
    }
    let b = work.blocks[k];
    let q = blocks[b].job;
    var bits = vec2<u32>(0u);
    if jobs[q].phase == RUNNING {
        let near = blocks[b].near;
        bits = vec2<u32>(tube_bits(near.x, b * BLOCK), tube_bits(near.y, b * BLOCK + 32u));
        if any(near != vec2<u32>(0u)) {
            touch(b);
        }
        if any(bits != vec2<u32>(0u)) {
            let first = select(32u + countTrailingZeros(bits.y), countTrailingZeros(bits.x), bits.x != 0u);
            let last = select(31u - countLeadingZeros(bits.x), 63u - countLeadingZeros(bits.y), bits.y != 0u);
            let nx = jobs[q].nx;
            for (var row = 0u; row < 3u; row++) {
                let base = b * BLOCK + row * nx - nx;
                for (var t = (base + first - 1u) / BLOCK; t <= (base + last + 1u) / BLOCK; t++) {
                    touch(t);
                }
            }
        }
    }
    blocks[b].tube = bits;
}

// Lists the touched blocks in order and wipes the marks. One workgroup; each invocation takes a stretch of words.
@compute @workgroup_size(scan_width)
fn gather(@builtin(local_invocation_index) local: u32) {
    let words = (params.block_count + 31u) / 32u;
    let stretch = (words + scan_width - 1u) / scan_width;
    let begin = min(local * stretch, words);
    let end = min(begin + stretch, words);
    var count = 0u;
    for (var w = begin; w < end; w++) {
        count += countOneBits(atomicLoad(&touched[w]));
    }
    totals[local] = count;
    workgroupBarrier();
    var place = 0u;
    for (var t = 0u; t < local; t++) {
        place += totals[t];
    }
    for (var w = begin; w < end; w++) {
        var bits = atomicLoad(&touched[w]);
        atomicStore(&touched[w], 0u);
        while bits != 0u {
            let c = countTrailingZeros(bits);
            bits &= bits - 1u;
            work_mut.blocks[place] = w * 32u + c;
            place++;
        }
    }
    if local == scan_width - 1u {
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
    if k >= work.block_total {
        return;
    }
    let b = work.blocks[k];
    let nx = jobs[blocks[b].job].nx;
    let inner = blocks[b].inner;
    let near = vec2<u32>(grown(b * BLOCK, nx, inner.x), grown(b * BLOCK + 32u, nx, inner.y));
    let leaving = blocks[b].near & ~near;
    put_outside(leaving.x, b * BLOCK);
    put_outside(leaving.y, b * BLOCK + 32u);
    blocks[b].near = near;
    blocks[b].first = countOneBits(near.x) + countOneBits(near.y);
}

// Turns the blocks' counts into places and says how long the band is.
@compute @workgroup_size(scan_width)
fn scan(@builtin(local_invocation_index) local: u32) {
    let total = work_mut.block_total;
    let stretch = (total + scan_width - 1u) / scan_width;
    let begin = min(local * stretch, total);
    let end = min(begin + stretch, total);
    var count = 0u;
    for (var k = begin; k < end; k++) {
        count += blocks[work_mut.blocks[k]].first;
    }
    totals[local] = count;
    workgroupBarrier();
    var place = 0u;
    for (var t = 0u; t < local; t++) {
        place += totals[t];
    }
    for (var k = begin; k < end; k++) {
        let b = work_mut.blocks[k];
        let own = blocks[b].first;
        blocks[b].first = place;
        place += own;
    }
    if local == scan_width - 1u {
        let kept = min(place, params.band_capacity);
        work_mut.band_wanted = max(work_mut.band_wanted, place);
        work_mut.band_total = kept;
        work_mut.band_groups = groups_of(kept);
        work_mut.chunk_groups = groups_of((kept + chunk_length - 1u) / chunk_length);
    }
}

fn list_nodes(near: u32, first: u32, q: u32, place: u32) -> u32 {
    var bits = near;
    var k = place;
    while bits != 0u {
        let node = first + countTrailingZeros(bits);
        bits &= bits - 1u;
        if k < params.band_capacity {
            band[k] = vec2<u32>(node, q);
            earlier[k] = slots[node];
            slots[node] = k;
        }
        k++;
    }
    return k;
}

// The band's pixels in row order with their jobs, where each was in the list before, and the way back from a pixel to the list.
@compute @workgroup_size(lane_count)
fn collect(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= work.block_total {
        return;
    }
    let b = work.blocks[k];
    let q = blocks[b].job;
    let near = blocks[b].near;
    let middle = list_nodes(near.x, b * BLOCK, q, blocks[b].first);
    list_nodes(near.y, b * BLOCK + 32u, q, middle);
}
