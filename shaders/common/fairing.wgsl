// What all kernels of the fairing share; needs job.wgsl. The host side is src/gpu/fairing.rs.
//
// A layer is packed as src/grid/tiled.rs packs it: `places` has where each square of it lies in `values`, counted in squares. A packed layer is told
// by a pair: where its table begins in `places`, where its values begin in `values`. What is made of a node lies in squares of its own, in four
// planes one after the other: v, n, the difference (until it is made, how far the surface goes sideways), the correction.

// Side of a square, px, and its pixels.
const SQUARE: u32 = 16u;
const AREA: u32 = 256u;
// Distance between two blocks of the motion, px.
const APART: f32 = 4.0;
// Blocks that the pixels of a square read, along an axis and in all.
const ACROSS: u32 = 6u;
const TABLE: u32 = 36u;
// Planes of a node.
const SLOPE: u32 = 1u;
const DIFFERENCE: u32 = 2u;
const CORRECTION: u32 = 3u;
// Pixels with a smaller |v| / B are wholly near the surface, those with a larger than SATURATED not at all.
const NEAR: f32 = 0.4;
const SATURATED: f32 = 0.85;
// At a contour the difference fades out between these.
const FADE: f32 = 0.82;
const FADED: f32 = 0.88;

// Pixels of a layer, squares in a row, blocks, whether layers keep to the range of their contours, the padding of the moving frame's image; the
// place of the first block, pixel sides, B, the larger pixel side, and where distances end.
struct FairingShape {
    nx: u32,
    ny: u32,
    columns: u32,
    block_columns: u32,
    block_rows: u32,
    limited: u32,
    pad_x: u32,
    pad_y: u32,
    first_x: f32,
    first_y: f32,
    dx: f32,
    dy: f32,
    bound: f32,
    side: f32,
    farthest: f32,
    padding: f32,
}

@group(0) @binding(1) var<uniform> shape: FairingShape;

// Number of a workgroup.
fn group_index(group: vec3<u32>) -> u32 {
    return group.y * GRID + group.x;
}

// Pixel number `q` of a square.
fn pixel(square: u32, q: u32) -> vec2<u32> {
    return SQUARE * vec2<u32>(square % shape.columns, square / shape.columns) + vec2<u32>(q % SQUARE, q / SQUARE);
}

fn on_layer(p: vec2<u32>) -> bool {
    return p.x < shape.nx && p.y < shape.ny;
}

// 3 t^2 - 2 t^3, 0 at `t <= 0` and 1 at `t >= 1`.
fn smooth_step(t: f32) -> f32 {
    let s = clamp(t, 0.0, 1.0);
    return s * s * (3.0 - 2.0 * s);
}

// Nearness to the surface of a pixel at `|v| / B`.
fn nearness(ratio: f32) -> f32 {
    return smooth_step((SATURATED - ratio) / (SATURATED - NEAR));
}
