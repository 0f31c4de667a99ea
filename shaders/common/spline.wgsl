// Slopes and curves of values along a trajectory; the twins are src/grid/spline.rs, src/grid/near_knots.rs and `slope` in
// src/registration/value_curve.rs.

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

// Gaps are unlike where one is more than so many times the other; by the noise of contours a narrow one is doubted where the other is WHOLLY times as wide.
const UNLIKE: f32 = 4.0;
const WHOLLY: f32 = 8.0;

// Share to which a gap is narrow beside another one.
fn narrow(gap: f32, other: f32) -> f32 {
    return clamp((other / gap - UNLIKE) / (WHOLLY - UNLIKE), 0.0, 1.0);
}

// Times the noise of contours by which a gap is doubted beside another one.
fn doubted(gap: f32, other: f32) -> f32 {
    return narrow(gap, other) * sqrt(max(other / (WHOLLY * gap), 1.0));
}

// What is left of a difference of `by` px that may be noise of `doubt` px.
fn believed(by: f32, doubt: f32) -> f32 {
    let seen = by * by;
    let noise = doubt * doubt;
    if noise <= 0.0 {
        return by;
    }
    return by * (seen / (seen + noise));
}

// The gap `own`, (secant, height), where it is narrow beside `other`: seen together with the one beyond it, as far as it is doubted.
fn seen_with(own: vec2<f32>, beyond: vec2<f32>, other: vec2<f32>, doubt: f32) -> vec2<f32> {
    let share = narrow(own.y, other.y);
    if share <= 0.0 {
        return own;
    }
    let both = own.y + beyond.y;
    let way = (own.x * own.y + beyond.x * beyond.y) - other.x * both;
    let across = other.x + believed(way, doubt * doubted(both, other.y)) / both;
    let by = (own.x - across) * own.y;
    let left = believed(by, doubt * doubted(own.y, other.y));
    var kept = 1.0 - share;
    if by != 0.0 {
        kept = left / by;
    }
    return vec2<f32>(across + left / own.y, kept * own.y + (1.0 - kept) * both);
}

// The gaps below and above a slice, `farther` those on the other side of these (0 high: there is none).
fn settled(gaps: array<vec2<f32>, 2>, farther: array<vec2<f32>, 2>, doubt: f32) -> array<vec2<f32>, 2> {
    return array(seen_with(gaps[0], farther[0], gaps[1], doubt), seen_with(gaps[1], farther[1], gaps[0], doubt));
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
