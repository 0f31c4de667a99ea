// Exact Euclidean distance to the other side of a mask, the pixel edge half way (Felzenszwalb and Huttenlocher 2012): first the steps to the
// nearest pixel of a side along each column, then the lower envelope of parabolas along each row.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> side: Side;
@group(0) @binding(2) var<storage, read> jobs: array<Job>;
@group(0) @binding(3) var<storage, read> u: array<f32>;
@group(0) @binding(4) var<storage, read_write> steps: array<f32>;
@group(0) @binding(5) var<storage, read_write> feet: array<u32>;
@group(0) @binding(6) var<storage, read_write> begins: array<f32>;
@group(0) @binding(7) var<storage, read_write> distance: array<f32>;

const FAR: f32 = 1e30;
// Pixels at equal distance may give different results where a pixel is not square: within this many pixels of a tie the least one counts.
const TIE: f32 = 1e-3;

// Distance to the pixels with `u < 0` (1) or to the others (0).
struct Side {
    inside: u32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
}

fn on_side(node: u32) -> bool {
    return (u[node] < 0.0) == (side.inside == 1u);
}

@compute @workgroup_size(lane_count)
fn columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let q = row_index(group);
    if q >= arrayLength(&jobs) {
        return;
    }
    let nx = jobs[q].nx;
    let ny = jobs[q].ny;
    let i = group.x * lane_count + local;
    if i >= nx {
        return;
    }
    var run = FAR;
    for (var j = 0u; j < ny; j++) {
        let node = jobs[q].offset + j * nx + i;
        run = select(run + 1.0, 0.0, on_side(node));
        steps[node] = run;
    }
    run = FAR;
    for (var j = ny; j > 0u; j--) {
        let node = jobs[q].offset + (j - 1u) * nx + i;
        run = min(steps[node], run + 1.0);
        steps[node] = run;
    }
}

// Where the parabola of foot `b` gets below that of foot `a < b`: differences of squares as products, exact enough in f32 on any row.
fn begin_of(a: u32, b: u32, row: u32) -> f32 {
    let sa = steps[row + a];
    let sb = steps[row + b];
    let ratio = square(params.hy / params.hx);
    return 0.5 * f32(a + b) + ratio * (sb - sa) * (sb + sa) / f32(2u * (b - a));
}

// Distance to the pixel of the other side below or above `foot`, less half a pixel.
fn away(row: u32, i: u32, foot: u32) -> f32 {
    let d = vec2<f32>(f32(i) - f32(foot), steps[row + foot]);
    return length(d * vec2<f32>(params.hx, params.hy)) * (1.0 - 0.5 / max(length(d), 0.5));
}

@compute @workgroup_size(lane_count)
fn rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let q = row_index(group);
    if q >= arrayLength(&jobs) {
        return;
    }
    let nx = jobs[q].nx;
    let j = group.x * lane_count + local;
    if j >= jobs[q].ny {
        return;
    }
    let row = jobs[q].offset + j * nx;
    var count = 0u;
    for (var b = 0u; b < nx; b++) {
        if steps[row + b] >= 0.5 * FAR {
            continue;
        }
        var begin = -FAR;
        while count > 0u {
            begin = begin_of(feet[row + count - 1u], b, row);
            if begin > begins[row + count - 1u] {
                break;
            }
            count--;
            begin = -FAR;
        }
        feet[row + count] = b;
        begins[row + count] = begin;
        count++;
    }
    var k = 0u;
    for (var i = 0u; i < nx; i++) {
        if on_side(row + i) {
            continue;
        }
        if count == 0u {
            distance[row + i] = with_sign(FAR, u[row + i]);
            continue;
        }
        while k + 1u < count && begins[row + k + 1u] < f32(i) - TIE {
            k++;
        }
        var least = away(row, i, feet[row + k]);
        for (var l = k + 1u; l < count && begins[row + l] < f32(i) + TIE; l++) {
            least = min(least, away(row, i, feet[row + l]));
        }
        distance[row + i] = with_sign(least, u[row + i]);
    }
}
