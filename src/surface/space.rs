//! Directions in space.

use glam::DVec3;

/// A vector of length one in the same direction; zero stays zero. Divides by the length, which glam's `normalize_or_zero` multiplies by the
/// inverse of: normals in files keep their last bits.
pub(super) fn unit(a: DVec3) -> DVec3 {
    a / a.length().max(f64::MIN_POSITIVE)
}
