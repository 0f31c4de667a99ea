// Fast sweeping: distance to the zero set of `u`, |grad d| = 1 (Zhao 2005), with sub-cell start values.
//
// The twin sweeps whole images in four directions. Here a workgroup takes a patch of 16 x 16 pixels with its border into its own memory and
// updates every second pixel in turn until none changes; patches of one colour of a checkerboard run together and never touch each other's
// neighbours, then the other colour. A patch whose border changes wakes the patches next to it; all ends when no patch is awake. The fixed
// point is the same, the work follows the front.
//
// Distances are not negative. A start value is kept with its sign bit set: it does not change.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> colour: Colour;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> blocks: array<Block>;
@group(0) @binding(4) var<storage, read> u: array<f32>;
@group(0) @binding(5) var<storage, read_write> d: array<f32>;
@group(0) @binding(6) var<storage, read_write> awake: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read> patches: array<Patch>;
@group(0) @binding(8) var<storage, read_write> changes: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read_write> patches_mut: array<Patch>;

const FAR: f32 = 1e30;
const PATCH: u32 = 16u;
// A patch with its border, which is row -1, row 16 and as many columns.
const SIDE: u32 = 18u;
// Patches that a workgroup looks at, one after the other, far from each other: those that are awake lie side by side.
const PATCHES: u32 = 8u;
// Twice as many updates are made of a patch at most before others have their turn.
const UPDATES: u32 = 16u;
// Smallest change that wakes a patch, px.
const SETTLED: f32 = 1e-6;
// Pixels this close to a contour keep what the sweep of the front made of them, px.
const TRUSTED: f32 = 3.0;

// The patches of one colour in `patches`.
struct Colour {
    first: u32,
    count: u32,
    padding_a: u32,
    padding_b: u32,
}

// 16 x 16 pixels of a tile, or less at its edge; its number, row by row over all tiles, is its place in `awake`.
struct Patch {
    job: u32,
    column: u32,
    row: u32,
    number: u32,
}

// Fraction of the pixel side at which the contour crosses towards a neighbour, FAR where it does not.
fn crossing_at(c: f32, v: f32) -> f32 {
    return select(FAR, abs(c) / (abs(c) + abs(v) + 1e-30), (v < 0.0) != (c < 0.0));
}

fn columns_of(q: u32) -> u32 {
    return (jobs[q].nx + PATCH - 1u) / PATCH;
}

fn wake_at(q: u32, i: u32, j: u32) {
    // A tile's first patch number is kept in `first_copy`.
    atomicStore(&awake[jobs[q].first_copy + (j / PATCH) * columns_of(q) + i / PATCH], 2u);
}

// The patch of every number, in its colour's part of the list: `colour` is the second. Jobs keep how many patches there are before their tile in
// `first_copy`, and how many of the first colour in `first_bin`.
@compute @workgroup_size(lane_count)
fn lay_patches(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let number = list_index(group, local);
    if number >= colour.first + colour.count {
        return;
    }
    // The last tile that begins no later.
    var low = 0u;
    var high = params.job_count;
    for (var halving = countLeadingZeros(params.job_count); halving < 32u; halving++) {
        let between = (low + high) / 2u;
        if jobs[between].first_copy <= number {
            low = between;
        } else {
            high = between;
        }
    }
    let columns = columns_of(low);
    let own = number - jobs[low].first_copy;
    let row = own / columns;
    let column = own % columns;
    let second = (row + column) & 1u;
    // Of its colour: in two rows as many as there are columns, in the first of them half, and half of what is before it in its own row.
    let before = row / 2u * columns + (row & 1u) * ((columns + 1u - second) / 2u) + column / 2u;
    let first = jobs[low].first_bin;
    let place = select(first, colour.first + jobs[low].first_copy - first, second == 1u) + before;
    patches_mut[place] = Patch(low, column, row, number);
}

// Start values: along each axis the linear crossing, both combined as `1 / d^2 = 1 / dx^2 + 1 / dy^2`; elsewhere FAR, or `limit` if there is
// one: the sweeps then go no farther.
@compute @workgroup_size(lane_count)
fn start(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let n = node - jobs[q].offset;
    let nx = jobs[q].nx;
    let i = n % nx;
    let j = n / nx;
    if j >= jobs[q].ny {
        return;
    }
    let c = u[node];
    var dx = FAR;
    var dy = FAR;
    if i > 0u {
        dx = min(dx, crossing_at(c, u[node - 1u]));
    }
    if i + 1u < nx {
        dx = min(dx, crossing_at(c, u[node + 1u]));
    }
    if j > 0u {
        dy = min(dy, crossing_at(c, u[node - nx]));
    }
    if j + 1u < jobs[q].ny {
        dy = min(dy, crossing_at(c, u[node + nx]));
    }
    d[node] = select(FAR, params.limit, params.limit > 0.0);
    if dx < FAR || dy < FAR {
        var inverse = 0.0;
        if dx < FAR {
            inverse += 1.0 / square(max(dx * params.hx, 1e-6));
        }
        if dy < FAR {
            inverse += 1.0 / square(max(dy * params.hy, 1e-6));
        }
        d[node] = -1.0 / sqrt(inverse);
        wake_at(q, i, j);
    }
}

// A field that is right near its contour: start values are what can be trusted, everything else is at most `limit`.
@compute @workgroup_size(lane_count)
fn start_far(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node >= params.block_count * BLOCK {
        return;
    }
    let q = blocks[node / BLOCK].job;
    let n = node - jobs[q].offset;
    let j = n / jobs[q].nx;
    if j >= jobs[q].ny {
        return;
    }
    d[node] = params.limit;
    if abs(u[node]) < TRUSTED {
        d[node] = -max(abs(u[node]), 1e-30);
        wake_at(q, n % jobs[q].nx, j);
    }
}

// News of a patch: pixels of its west, east, south, north border have changed; it has not come to rest.
const WEST: u32 = 1u;
const EAST: u32 = 2u;
const SOUTH: u32 = 4u;
const NORTH: u32 = 8u;
const MOVES: u32 = 16u;

var<workgroup> tile: array<f32, 324>;
var<workgroup> states: array<u32, PATCHES>;
var<workgroup> moves: u32;
var<workgroup> news: atomic<u32>;

// Updates every second pixel of the patch in `tile` and tells what is new; pixels outside the image are kept, at FAR.
fn update_half(local: u32, parity: u32) -> u32 {
    var told = 0u;
    for (var m = local; m < PATCH * PATCH / 2u; m += lane_count) {
        let row = m / (PATCH / 2u);
        let column = 2u * (m % (PATCH / 2u)) + ((row + parity) & 1u);
        let c = (row + 1u) * SIDE + column + 1u;
        let old = tile[c];
        let a = min(abs(tile[c - 1u]), abs(tile[c + 1u]));
        let b = min(abs(tile[c - SIDE]), abs(tile[c + SIDE]));
        if old < 0.0 || min(a, b) >= old {
            continue;
        }
        let v = eikonal(a, b, params.hx, params.hy);
        if v < old {
            tile[c] = v;
            if v < old - SETTLED {
                let at_row = select(0u, SOUTH, row == 0u) | select(0u, NORTH, row == PATCH - 1u);
                let at_column = select(0u, WEST, column == 0u) | select(0u, EAST, column == PATCH - 1u);
                told |= MOVES | at_row | at_column;
            }
        }
    }
    return told;
}

// Every patch of one colour that is awake, until it is settled.
@compute @workgroup_size(lane_count)
fn sweep_patches(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group_index(group);
    let stride = (colour.count + PATCHES - 1u) / PATCHES;
    if local < PATCHES {
        let k = first + local * stride;
        states[local] = 0u;
        if first < stride && k < colour.count {
            states[local] = atomicExchange(&awake[patches[colour.first + k].number], 0u);
        }
    }
    var all = workgroupUniformLoad(&states);
    var awoken = 0u;
    for (var k = 0u; k < PATCHES; k++) {
        awoken |= all[k] << (2u * k);
    }
    while awoken != 0u {
        let k = countTrailingZeros(awoken) / 2u;
        let state = (awoken >> (2u * k)) & 3u;
        awoken &= ~(3u << (2u * k));
        let own = patches[colour.first + first + k * stride];
        let q = own.job;
        let nx = jobs[q].nx;
        let ny = jobs[q].ny;
        // Others write what lies beyond its corners, and nobody reads it.
        for (var c = local; c < SIDE * SIDE; c += lane_count) {
            let column = c % SIDE;
            let row = c / SIDE;
            // One more than the pixel's own.
            let i = own.column * PATCH + column;
            let j = own.row * PATCH + row;
            let corner = (column == 0u || column == SIDE - 1u) && (row == 0u || row == SIDE - 1u);
            var value = -FAR;
            if !corner && i > 0u && j > 0u && i <= nx && j <= ny {
                value = d[jobs[q].offset + (j - 1u) * nx + i - 1u];
            }
            tile[c] = value;
        }
        if local == 0u {
            // Its start values are news for all its neighbours.
            atomicStore(&news, select(0u, WEST | EAST | SOUTH | NORTH, state == 2u));
            moves = 1u;
        }
        for (var n = 0u; n < UPDATES; n++) {
            if workgroupUniformLoad(&moves) == 0u {
                break;
            }
            var told = update_half(local, 0u);
            workgroupBarrier();
            told |= update_half(local, 1u);
            workgroupBarrier();
            // What the second update leaves as it is has come to rest.
            told = (told & ~MOVES) | update_half(local, 0u);
            workgroupBarrier();
            told |= update_half(local, 1u);
            if told != 0u {
                atomicOr(&news, told);
            }
            workgroupBarrier();
            if local == 0u {
                moves = atomicAnd(&news, ~MOVES) & MOVES;
            }
        }
        let unsettled = workgroupUniformLoad(&moves) != 0u;
        for (var m = local; m < PATCH * PATCH; m += lane_count) {
            let column = m % PATCH;
            let row = m / PATCH;
            let i = own.column * PATCH + column;
            let j = own.row * PATCH + row;
            if i < nx && j < ny {
                d[jobs[q].offset + j * nx + i] = tile[(row + 1u) * SIDE + column + 1u];
            }
        }
        if local == 0u {
            wake_around(own, select(0u, MOVES, unsettled) | atomicLoad(&news));
        }
        // The next patch takes this one's place in the workgroup's memory.
        workgroupBarrier();
    }
}

// Wakes a patch that is not settled, and those beside it for which it has news.
fn wake_around(own: Patch, told: u32) {
    let p = own.number;
    let columns = columns_of(own.job);
    let rows = (jobs[own.job].ny + PATCH - 1u) / PATCH;
    if (told & MOVES) != 0u {
        atomicMax(&awake[p], 1u);
    }
    if (told & WEST) != 0u && own.column > 0u {
        atomicMax(&awake[p - 1u], 1u);
    }
    if (told & EAST) != 0u && own.column + 1u < columns {
        atomicMax(&awake[p + 1u], 1u);
    }
    if (told & SOUTH) != 0u && own.row > 0u {
        atomicMax(&awake[p - columns], 1u);
    }
    if (told & NORTH) != 0u && own.row + 1u < rows {
        atomicMax(&awake[p + columns], 1u);
    }
    if told != 0u {
        atomicStore(&changes[0], 1u);
    }
}

// The signed distance: negative where `u` is.
@compute @workgroup_size(lane_count)
fn finish(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let node = list_index(group, local);
    if node < params.block_count * BLOCK {
        d[node] = with_sign(d[node], u[node]);
    }
}
