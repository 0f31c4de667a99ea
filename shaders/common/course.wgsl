// A course `[S, m0, m1, ok]`: the cubic Hermite curve with s(0) = 0, s(1) = S, s'(0) = m0, s'(1) = m1; the twin is src/grid/spline.rs.

fn hermite(c: vec4<f32>, t: f32) -> f32 {
    return t * (c.y * (1.0 - t) * (1.0 - t) + t * (c.x * (3.0 - 2.0 * t) - c.z * (1.0 - t)));
}

fn hermite_rate(c: vec4<f32>, t: f32) -> f32 {
    return 6.0 * t * (1.0 - t) * c.x + (1.0 - t) * (1.0 - 3.0 * t) * c.y + t * (3.0 * t - 2.0) * c.z;
}

// Mean speed `(s(t + dt) - s(t)) / dt`, without the difference of two close numbers: s is a cubic, so Simpson's rule is exact.
fn hermite_mean_rate(c: vec4<f32>, t: f32, dt: f32) -> f32 {
    return (hermite_rate(c, t) + 4.0 * hermite_rate(c, t + 0.5 * dt) + hermite_rate(c, t + dt)) / 6.0;
}

// How a course bends off its chord over a step: `s(t + q dt) = (1 - q) s(t) + q s(t + dt) - q (1 - q) (b + c q)` with these b and c.
fn bend(c: vec4<f32>, t: f32, dt: f32) -> vec2<f32> {
    let square = 3.0 * c.x - 2.0 * c.y - c.z;
    let cube = c.y + c.z - 2.0 * c.x;
    return dt * dt * vec2<f32>(square + cube * (3.0 * t + dt), dt * cube);
}

fn smoothstep01(t: f32) -> f32 {
    let s = clamp(t, 0.0, 1.0);
    return s * s * (3.0 - 2.0 * s);
}
