// A course `[S, m0, m1, ok]`: the cubic Hermite curve with s(0) = 0, s(1) = S, s'(0) = m0, s'(1) = m1; the twin is src/spline.rs.

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

fn smoothstep01(t: f32) -> f32 {
    let s = clamp(t, 0.0, 1.0);
    return s * s * (3.0 - 2.0 * s);
}
