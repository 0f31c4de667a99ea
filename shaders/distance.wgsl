// Fast sweeping: distance to the zero set of `u`, |grad d| = 1 (Zhao 2005), with sub-cell start values.
//
// The twin sweeps whole images in four directions. Here an invocation sweeps one patch of 16 x 16 pixels in four directions; patches of one
// colour of a checkerboard run together and never touch each other's neighbours, then the other colour. A patch whose border changes wakes
// the patches next to it; the sweeps end when no patch is awake. The fixed point is the same, the work follows the front.
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

const FAR: f32 = 1e30;
const PATCH: u32 = 16u;
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

// Four sweeps of every patch of one colour that is awake.
@compute @workgroup_size(lane_count)
fn sweep_patches(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let k = list_index(group, local);
    if k >= colour.count {
        return;
    }
    let own = patches[colour.first + k];
    let p = own.number;
    let state = atomicExchange(&awake[p], 0u);
    if state == 0u {
        return;
    }
    let q = own.job;
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let i0 = own.column * PATCH;
    let j0 = own.row * PATCH;
    let width = min(PATCH, nx - i0);
    let height = min(PATCH, ny - j0);
    var changed = false;
    // West, east, south, north border.
    var border = vec4<bool>(state == 2u);
    for (var direction = 0u; direction < 4u; direction++) {
        for (var row = 0u; row < height; row++) {
            let j = j0 + select(row, height - 1u - row, direction >= 2u);
            for (var column = 0u; column < width; column++) {
                let i = i0 + select(column, width - 1u - column, (direction & 1u) == 1u);
                let node = jobs[q].offset + j * nx + i;
                let old = d[node];
                if old < 0.0 {
                    continue;
                }
                var a = FAR;
                var b = FAR;
                if i > 0u {
                    a = abs(d[node - 1u]);
                }
                if i + 1u < nx {
                    a = min(a, abs(d[node + 1u]));
                }
                if j > 0u {
                    b = abs(d[node - nx]);
                }
                if j + 1u < ny {
                    b = min(b, abs(d[node + nx]));
                }
                if min(a, b) >= old {
                    continue;
                }
                let v = eikonal(a, b, params.hx, params.hy);
                if v < old {
                    d[node] = v;
                    if v < old - SETTLED {
                        changed = true;
                        border = border | vec4<bool>(i == i0, i == i0 + width - 1u, j == j0, j == j0 + height - 1u);
                    }
                }
            }
        }
    }
    let columns = columns_of(q);
    let rows = (ny + PATCH - 1u) / PATCH;
    if changed {
        atomicMax(&awake[p], 1u);
    }
    if border.x && own.column > 0u {
        atomicMax(&awake[p - 1u], 1u);
    }
    if border.y && own.column + 1u < columns {
        atomicMax(&awake[p + 1u], 1u);
    }
    if border.z && own.row > 0u {
        atomicMax(&awake[p - columns], 1u);
    }
    if border.w && own.row + 1u < rows {
        atomicMax(&awake[p + columns], 1u);
    }
    if changed || any(border) {
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
