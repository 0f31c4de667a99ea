// Tables that all kernels share. Mirrored in src/gpu/layout.rs; tests/gpu/shaders.rs compares names and offsets.
//
// The tiles of all jobs lie one after the other in an atlas: pixel (i, j) of a tile is node `offset + j * nx + i`. A block is 64 consecutive
// nodes of one tile; tiles begin at block borders.

const NONE: u32 = 0xffffffffu;
const BLOCK: u32 = 64u;

// Phases of a job.
const RUNNING: u32 = 0u;
const DONE: u32 = 1u;
const VANISHED: u32 = 2u;

// Most workgroups along an axis; longer lists take several rows, and layers of rows.
override grid: u32 = 4096u;

override lane_count: u32 = 64u;

// Band pixels that one invocation takes where a pixel alone would be too little work: those of a workgroup lie side by side, and it takes every
// `lane_count`-th of them.
override chunk_length: u32 = 16u;

// What all jobs of a batch share. Lengths in pixels of the larger pixel side.
struct Params {
    hx: f32,
    hy: f32,
    gamma: f32,
    beta: f32,
    cfl: f32,
    // What a step counts as: 1, and less for smaller Courant numbers.
    step_share: f32,
    tolerance: f32,
    limit: f32,
    job_count: u32,
    block_count: u32,
    band_capacity: u32,
    value_capacity: u32,
}

struct Job {
    offset: u32,
    nx: u32,
    ny: u32,
    first_block: u32,
    block_count: u32,
    // State of a morph or sweep.
    phase: u32,
    steps: u32,
    pixels: u32,
    now: f32,
    dt: f32,
    // Morphs.
    most_steps: u32,
    idle: u32,
    best: f32,
    residual_max: f32,
    residual_mean: f32,
    // Sweeps: output times, the next of them, whether this step reaches the end, where copies go.
    first_time: u32,
    time_count: u32,
    next_time: u32,
    reaches: u32,
    first_copy: u32,
    vanished: f32,
    // Sweeps: bins of the seeds.
    first_bin: u32,
    bins_x: u32,
    bins_y: u32,
}

// 64 nodes: which of them are in the tubes N and T and off the tile's rim, and where the block's part of the band begins in that of the blocks
// that are listed with it, `lane_count` at a time.
struct Block {
    near: vec2<u32>,
    tube: vec2<u32>,
    inner: vec2<u32>,
    first: u32,
    job: u32,
}

// Lengths of the work lists with their indirect arguments, then the blocks that the tubes touch, in order.
struct Work {
    block_total: u32,
    band_total: u32,
    band_wanted: u32,
    padding: u32,
    block_groups: array<u32, 4>,
    eighth_groups: array<u32, 4>,
    band_groups: array<u32, 4>,
    chunk_groups: array<u32, 4>,
    blocks: array<u32>,
}

// Reductions of one job; floats that are not negative compare like their bits.
struct Sums {
    fastest: atomic<u32>,
    residual_max: atomic<u32>,
    residual_sum: atomic<u32>,
    crossings: atomic<u32>,
    inside: atomic<u32>,
    pixels: atomic<u32>,
}

// Index of a workgroup where they are dispatched in rows of `grid` and layers of `grid` rows.
fn group_index(group: vec3<u32>) -> u32 {
    return (group.z * grid + group.y) * grid + group.x;
}

// Index of an invocation in a list that is dispatched so.
fn list_index(group: vec3<u32>, local: u32) -> u32 {
    return group_index(group) * lane_count + local;
}

// Row of an invocation where each item has a row of workgroups, dispatched in layers of `grid` rows.
fn row_index(group: vec3<u32>) -> u32 {
    return group.z * grid + group.y;
}

// Workgroups along three axes for a list of `total` items.
fn list_groups(total: u32) -> vec3<u32> {
    let groups = (total + lane_count - 1u) / lane_count;
    let rows = (groups + grid - 1u) / grid;
    return vec3<u32>(min(groups, grid), min(rows, grid), (rows + grid - 1u) / grid);
}
