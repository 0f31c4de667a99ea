// Reading packed layers, `places` and `values` of the including file; needs fairing.wgsl. The twin is src/grid/tiled.rs.

// Where the value of a pixel lies.
fn place_of(layer: vec2<u32>, p: vec2<u32>) -> u32 {
    let square = places[layer.x + (p.y / SQUARE) * shape.columns + p.x / SQUARE];
    return layer.y + square * AREA + (p.y % SQUARE) * SQUARE + p.x % SQUARE;
}

fn value_at(layer: vec2<u32>, p: vec2<u32>) -> f32 {
    return values[place_of(layer, p)];
}

// Bilinear value at a short offset from a pixel, the edge repeated.
fn sample_packed(layer: vec2<u32>, p: vec2<u32>, offset: vec2<f32>) -> f32 {
    let edge = vec2<i32>(vec2<u32>(shape.nx, shape.ny)) - 1;
    let last = max(edge - 1, vec2<i32>(0));
    let whole = floor(offset);
    let at = vec2<i32>(p) + vec2<i32>(whole);
    let corner = clamp(at, vec2<i32>(0), last);
    let off_edge = select(vec2<f32>(0.0), vec2<f32>(1.0), at > last);
    let f = select(offset - whole, off_edge, at != corner);
    let a = vec2<u32>(corner);
    let b = vec2<u32>(min(corner + 1, edge));
    let low = (1.0 - f.x) * value_at(layer, a) + f.x * value_at(layer, vec2<u32>(b.x, a.y));
    let high = (1.0 - f.x) * value_at(layer, vec2<u32>(a.x, b.y)) + f.x * value_at(layer, b);
    return (1.0 - f.y) * low + f.y * high;
}
