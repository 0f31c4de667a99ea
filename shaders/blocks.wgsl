// The table of the blocks of an atlas: the tile of each; no tube touches any yet. What it finds again
// is what `Atlas::new` in src/gpu/atlas.rs has laid out.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read_write> blocks: array<Block>;

@compute @workgroup_size(lane_count)
fn lay_blocks(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let b = list_index(group, local);
    if b >= params.block_count {
        return;
    }
    // The last tile that begins no later.
    var low = 0u;
    var high = params.job_count;
    for (var halving = countLeadingZeros(params.job_count); halving < 32u; halving++) {
        let between = (low + high) / 2u;
        if jobs[between].first_block <= b {
            low = between;
        } else {
            high = between;
        }
    }
    blocks[b] = Block(vec2<u32>(0u), vec2<u32>(0u), vec2<u32>(0u), 0u, low);
}
