// The value of a layer by the field method, of the slices and slopes that the including file has. The twin is src/reference/moving_layer.rs.
//
// `fields` holds the lower and the upper slice, their slopes per interval, and behind them the tiles of the lone parts.

@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> fields: array<f32>;
@group(0) @binding(3) var<storage, read> vectors: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> times: array<f32>;
@group(0) @binding(5) var<storage, read> parts: array<Part>;

// Share of `4 t^2 (1 - t)^2 |A - B|` taken off of what is no relief.
const SHRINKING: f32 = 0.2;
// At its tip a part is gone, whichever way the height was rounded.
const AT_TIP: f32 = 1.0 - 1e-6;

// What the layers of an interval share: values are clamped to `limit`, tiles farther off than `limit + reach` are skipped; lone parts of the
// lower slice, and of both; how far the stack is relief; whether one of the interval's slices is empty.
struct Span {
    limit: f32,
    reach: f32,
    lower_parts: u32,
    all_parts: u32,
    relief: f32,
    empty: u32,
    // Tiles that are asked for, and that are not.
    asked: u32,
    others: u32,
}

// A part without partner: its tile's place in `fields`, its inradius, where in the interval it closes, the slope with which it begins to, the
// largest distance that is kept, whether it goes on beyond what is known, and whether it is a hole.
struct Part {
    first: u32,
    nx: u32,
    ny: u32,
    x: i32,
    y: i32,
    depth: f32,
    height: f32,
    shrinking: f32,
    farthest: f32,
    open: u32,
    hole: u32,
}

// A layer's place on the lower and on the upper slice, as offsets from the pixel.
struct Ends {
    low: vec2<f32>,
    high: vec2<f32>,
}

fn ends_of(layer: u32, ij: vec2<i32>, offset: vec2<f32>) -> Ends {
    let blocks = image.columns * image.rows;
    let come = vector_at(2u * layer * blocks, ij, offset);
    let go = vector_at((2u * layer + 1u) * blocks, ij, offset);
    return Ends(offset - come, offset + go);
}

fn dims() -> vec2<u32> {
    return vec2<u32>(image.nx, image.ny);
}

// Value of a tile of a layer in which no contour can be, 0 where one can: distances change by a pixel per pixel.
fn far_value(layer: u32, tile: vec2<u32>) -> f32 {
    let corner = TILE * tile;
    let middle = 0.5 * vec2<f32>(min(vec2<u32>(TILE), dims() - corner) - 1u);
    let ij = vec2<i32>(corner);
    let ends = ends_of(layer, ij, middle);
    let a = sample(0u, dims(), ij, ends.low);
    let b = sample(image.nx * image.ny, dims(), ij, ends.high);
    let nearest = min(abs(a), abs(b)) - 0.05 * abs(a - b);
    let skipped = (a < 0.0) == (b < 0.0) && nearest > span.limit + span.reach;
    return select(0.0, select(span.limit, -span.limit, a < 0.0), skipped);
}

// Weights of four values in a row at place `f` between the middle two (Catmull and Rom 1974).
fn catmull_rom(f: f32) -> vec4<f32> {
    return vec4<f32>(
        ((-0.5 * f + 1.0) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((-1.5 * f + 2.0) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f
    );
}

// Catmull-Rom value of the image that begins at `first`.
fn sample_smooth(first: u32, ij: vec2<i32>, offset: vec2<f32>) -> f32 {
    let c = cell_of(dims(), ij, offset, 1);
    let wx = catmull_rom(c.place.x);
    let wy = catmull_rom(c.place.y);
    var sum = 0.0;
    for (var row = 0u; row < 4u; row++) {
        let k = first + c.node + row * image.nx - image.nx - 1u;
        sum += wy[row] * dot(wx, vec4<f32>(fields[k], fields[k + 1u], fields[k + 2u], fields[k + 3u]));
    }
    return sum;
}

// What a part's distance has grown by at time `t`: the twin is `Cap::offset` in src/contour/caps.rs.
fn closed(part: Part, t: f32) -> f32 {
    let q = t / part.height;
    if q < AT_TIP {
        return part.depth * (1.0 - (1.0 - q) * (1.0 + (1.0 - part.shrinking) * q));
    }
    return part.depth / AT_TIP + part.farthest * clamp((t - part.height) / max(1.0 - part.height, 1e-6), 0.0, 1.0);
}

// `other` united with the parts from `begin` to `end` at time `t`, counted from their own slice, and without its holes. Its value is `a`, which has no say
// in parts that are open.
fn closing(begin: u32, end: u32, ij: vec2<i32>, offset: vec2<f32>, a: f32, t: f32, other: f32) -> f32 {
    var value = other;
    for (var k = begin; k < end; k++) {
        let part = parts[k];
        let own = ij - vec2<i32>(part.x, part.y);
        let at = vec2<f32>(own) + offset;
        let last = vec2<f32>(f32(part.nx - 1u), f32(part.ny - 1u));
        if all(at >= vec2<f32>(0.0)) && all(at <= last) {
            let hole = part.hole != 0u;
            let distance = sample(part.first, vec2<u32>(part.nx, part.ny), own, offset);
            let within = select(max(distance, select(a, -a, hole)), distance, part.open != 0u) + closed(part, t);
            value = select(min(value, within), max(value, -within), hole);
        }
    }
    return value;
}

// Value at a pixel of a layer that is not far.
fn value_at(p: vec3<u32>) -> f32 {
    let ij = vec2<i32>(p.xy);
    let nodes = image.nx * image.ny;
    let ends = ends_of(p.z, ij, vec2<f32>(0.0));
    let v = vec2<f32>(sample_smooth(0u, ij, ends.low), sample_smooth(nodes, ij, ends.high));
    let m = vec2<f32>(sample(2u * nodes, dims(), ij, ends.low), sample(3u * nodes, dims(), ij, ends.high));
    let t = times[p.z];
    let bulge = t * (1.0 - t);
    let apart = abs(v.x - v.y);
    let shrinking = SHRINKING * (1.0 - span.relief) * 4.0 * bulge * bulge * apart;
    var value = hermite_values(v, m, t);
    // Only where there is room above the lesser end.
    let room = max(value - min(v.x, v.y), 0.0);
    let square = shrinking * shrinking + room * room;
    if square > 0.0 {
        value -= shrinking * room / sqrt(square);
    }
    value = select(value, span.limit, span.empty != 0u);
    value = closing(0u, span.lower_parts, ij, ends.low, v.x, t, value);
    value = closing(span.lower_parts, span.all_parts, ij, ends.high, v.y, 1.0 - t, value);
    return clamp(value, -span.limit, span.limit);
}
