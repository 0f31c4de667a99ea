// Scalar arithmetic of the level-set scheme; the twin is src/grid/stencil.rs, sentence by sentence.

const REACH: u32 = 3u;

// Keeps the smoothness weights finite (Jiang and Peng 2000, eq. 2.12), for differences of order 1.
const EPSILON: f32 = 1e-6;

fn square(x: f32) -> f32 {
    return x * x;
}

// Fifth-order one-sided derivative from five difference quotients, `a` farthest upwind; one division serves all three weights.
fn weno5(a: f32, b: f32, c: f32, d: f32, e: f32) -> f32 {
    let s1 = 13.0 / 12.0 * square(a - 2.0 * b + c) + 0.25 * square(a - 4.0 * b + 3.0 * c);
    let s2 = 13.0 / 12.0 * square(b - 2.0 * c + d) + 0.25 * square(b - d);
    let s3 = 13.0 / 12.0 * square(c - 2.0 * d + e) + 0.25 * square(3.0 * c - 4.0 * d + e);
    let q1 = square(EPSILON + s1);
    let q2 = square(EPSILON + s2);
    let q3 = square(EPSILON + s3);
    let w1 = 0.1 * (q2 * q3);
    let w2 = 0.6 * (q1 * q3);
    let w3 = 0.3 * (q1 * q2);
    let p1 = 1.0 / 3.0 * a - 7.0 / 6.0 * b + 11.0 / 6.0 * c;
    let p2 = -1.0 / 6.0 * b + 5.0 / 6.0 * c + 1.0 / 3.0 * d;
    let p3 = 1.0 / 3.0 * c + 5.0 / 6.0 * d - 1.0 / 6.0 * e;
    return (w1 * p1 + w2 * p2 + w3 * p3) / (w1 + w2 + w3);
}

// Both one-sided derivatives (minus, plus) at the middle of seven consecutive values.
fn one_sided(v: array<f32, 7>, per_h: f32) -> vec2<f32> {
    let a = (v[1] - v[0]) * per_h;
    let b = (v[2] - v[1]) * per_h;
    let c = (v[3] - v[2]) * per_h;
    let d = (v[4] - v[3]) * per_h;
    let e = (v[5] - v[4]) * per_h;
    let f = (v[6] - v[5]) * per_h;
    return vec2<f32>(weno5(a, b, c, d, e), weno5(f, e, d, c, b));
}

// Godunov's |grad phi| for `phi_t + F |grad phi| = 0`; only the sign of `speed` counts.
fn godunov(x: vec2<f32>, y: vec2<f32>, speed: f32) -> f32 {
    let s = select(-1.0, 1.0, speed > 0.0);
    let gx = max(max(s * x.x, -s * x.y), 0.0);
    let gy = max(max(s * y.x, -s * y.y), 0.0);
    return sqrt(gx * gx + gy * gy);
}

// Cut-off of the speed near the tube's edge: 1 up to `beta`, 0 from `gamma` (Peng et al. 1999, eq. 2.5).
fn cut_off(phi: f32, beta: f32, gamma: f32) -> f32 {
    let p = clamp(abs(phi), beta, gamma);
    let away = p - gamma;
    return away * away * (2.0 * p + gamma - 3.0 * beta) / ((gamma - beta) * (gamma - beta) * (gamma - beta));
}

// Smeared sign (Peng et al. 1999, eq. 3.4).
fn smeared_sign(phi: f32, gradient: vec2<f32>) -> f32 {
    return phi / sqrt(phi * phi + gradient.x * gradient.x + gradient.y * gradient.y + 1e-12);
}

// Solution of `((v - a)+ / hx)^2 + ((v - b)+ / hy)^2 = 1`, the upwind eikonal update (Zhao 2005, eq. 2.4), as the larger neighbour and what is
// added to it, a quotient of sums: nothing cancels where v is hardly above that neighbour.
fn eikonal(a: f32, b: f32, hx: f32, hy: f32) -> f32 {
    let one = min(a + hx, b + hy);
    // Pixel sides along the axes of the smaller and the larger neighbour.
    let own = select(hy, hx, a < b);
    let across = select(hx, hy, a < b);
    let d = abs(a - b);
    if d < own {
        let left = (own - d) * (own + d);
        return max(a, b) + left / (d + sqrt(d * d + (1.0 + square(own / across)) * left));
    }
    return one;
}

// |x| with the sign of `like`.
fn with_sign(x: f32, like: f32) -> f32 {
    return select(abs(x), -abs(x), like < 0.0);
}
