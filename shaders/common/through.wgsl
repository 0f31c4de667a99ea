// Trajectories through a place; needs moving.wgsl. The twin is `Displacement::through`.

// Fixed-point passes that find the trajectory through a point.
const PASSES: u32 = 3u;

// Displacement, of those that begin at `first`, of the trajectory that passes through a pixel's place at time `1/2 + tau`: `u = v(x - tau u)`.
fn through(first: u32, ij: vec2<i32>, offset: vec2<f32>, tau: f32) -> vec2<f32> {
    var u = vector_at(first, ij, offset);
    for (var k = 0u; k < PASSES; k++) {
        u = vector_at(first, ij, offset - tau * u);
    }
    return u;
}
