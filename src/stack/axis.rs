//! Axes of a volume.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Letters of the axes.
pub const NAMES: [char; 3] = ['x', 'y', 'z'];
/// Largest cosine between two axes that still counts as perpendicular.
const SHEAR_LIMIT: f64 = 1e-3;

/// Axis as the user chooses it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// The axis whose painted slices stand alone, else that of the coarsest spacing, else z.
    #[default]
    Auto,
    /// The file's first axis.
    X,
    /// The file's second axis.
    Y,
    /// The file's third axis.
    Z,
}

/// Checks that world directions are perpendicular unit vectors.
///
/// # Errors
/// A message with axis, value and limit.
pub(crate) fn check_axes(axes: &[DVec3; 3]) -> std::result::Result<(), String> {
    for (a, axis) in axes.iter().enumerate() {
        let length = axis.length();
        if length.is_nan() || (length - 1.0).abs() > SHEAR_LIMIT {
            return Err(format!("axis {a} is {length} long; it must be 1"));
        }
    }
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let cosine = axes[a].dot(axes[b]);
        if cosine.is_nan() || cosine.abs() > SHEAR_LIMIT {
            return Err(format!("axes {a} and {b} are not perpendicular (cosine {cosine:.4}, at most {SHEAR_LIMIT})"));
        }
    }
    Ok(())
}
