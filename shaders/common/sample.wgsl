// Reading `fields` (a storage array of the including file, images one after the other) between pixels; needs moving.wgsl.

// Bilinear value of the image of these pixels that begins at `first`.
fn sample(first: u32, dims: vec2<u32>, ij: vec2<i32>, offset: vec2<f32>) -> f32 {
    let c = cell_of(dims, ij, offset, 0);
    let k = first + c.node;
    let low = mix(fields[k], fields[k + 1u], c.place.x);
    let high = mix(fields[k + dims.x], fields[k + dims.x + 1u], c.place.x);
    return mix(low, high, c.place.y);
}
