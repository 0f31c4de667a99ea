// Slopes and curves of values along a trajectory; the twins are src/grid/spline.rs and `slope` in src/registration/value_curve.rs.

// Weighted harmonic mean of two secants over `h.x` and `h.y`, 0 where they differ in sign.
fn harmonic(d: vec2<f32>, h: vec2<f32>) -> f32 {
    if d.x * d.y <= 0.0 {
        return 0.0;
    }
    let w = vec2<f32>(2.0 * h.y + h.x, h.y + 2.0 * h.x);
    return (w.x + w.y) / (w.x / d.x + w.y / d.y);
}

// `m` where it has the sign of both secants and at most three times the smaller one, else the nearest such value.
fn limited(m: f32, d: vec2<f32>) -> f32 {
    if d.x * d.y <= 0.0 || m * d.x <= 0.0 {
        return 0.0;
    }
    let size = min(abs(m), 3.0 * min(abs(d.x), abs(d.y)));
    return select(size, -size, d.x < 0.0);
}

// Mean of two secants that lies near the smaller one, 0 where they differ in sign.
fn van_albada(d: vec2<f32>) -> f32 {
    let product = d.x * d.y;
    if product <= 0.0 {
        return 0.0;
    }
    return product * (d.x + d.y) / dot(d, d);
}

// Slope at a slice from the secants below and above it over `h.x` and `h.y`, of a stack that is so far relief.
fn slope(d: vec2<f32>, h: vec2<f32>, relief: f32) -> f32 {
    let standing = 0.5 * (harmonic(d, h) + limited((h.y * d.x + h.x * d.y) / (h.x + h.y), d));
    return mix(standing, van_albada(d), relief);
}

// Slope at an end from the two secants next to it, the nearer first.
fn three_point_end(d: vec2<f32>, h: vec2<f32>) -> f32 {
    let m = ((2.0 * h.x + h.y) * d.x - h.x * d.y) / (h.x + h.y);
    if m * d.x <= 0.0 {
        return 0.0;
    }
    return select(m, 3.0 * d.x, d.x * d.y <= 0.0 && abs(m) > 3.0 * abs(d.x));
}

// Cubic Hermite curve through `v.x` and `v.y` with slopes per interval.
fn hermite_values(v: vec2<f32>, m: vec2<f32>, t: f32) -> f32 {
    let s = v.y - v.x;
    return v.x + t * (m.x + t * (3.0 * s - 2.0 * m.x - m.y + t * (m.x + m.y - 2.0 * s)));
}
