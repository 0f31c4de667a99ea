//! Axes of a volume.

use serde::{Deserialize, Serialize};

/// Letters of the axes.
pub const NAMES: [char; 3] = ['x', 'y', 'z'];

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
