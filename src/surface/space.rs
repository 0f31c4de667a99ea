//! Points and directions in space.

use crate::stack::Geometry;

/// `a - b`.
pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Scalar product.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Length of a vector.
pub(super) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// A vector of length one in the same direction.
pub(super) fn unit(a: [f64; 3]) -> [f64; 3] {
    let l = length(a).max(f64::MIN_POSITIVE);
    a.map(|v| v / l)
}

/// A point of the stack (`x = i dx`, `y = j dy`, height) in the world.
pub fn to_world(g: &Geometry, p: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| g.origin[a] + p[0] * g.axes[0][a] + p[1] * g.axes[1][a] + p[2] * g.axes[2][a])
}
