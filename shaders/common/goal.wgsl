// Reading `goal`, the level set to arrive at, between pixels; needs field.wgsl.

fn sample_goal(q: u32, x: vec2<f32>) -> f32 {
    let c = cell_of(q, x, 0u);
    let nx = jobs[q].nx;
    let low = (1.0 - c.place.x) * goal[c.node] + c.place.x * goal[c.node + 1u];
    let high = (1.0 - c.place.x) * goal[c.node + nx] + c.place.x * goal[c.node + nx + 1u];
    return (1.0 - c.place.y) * low + c.place.y * high;
}
