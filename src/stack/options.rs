//! What a user may choose of an input.

use serde::{Deserialize, Serialize};

use super::volume::axis::Axis;

/// What to read from an input.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Input")]
pub struct ReadOptions {
    /// Grey slices: the contour runs where the value crosses this level, inside is above [default: the middle of the stack's range]
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub level: Option<f64>,

    /// Label volumes: reconstruct this label only [default: all that is not zero]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub label: Option<i64>,

    /// Label volumes: use every K-th slice only [default: the slices that have the label]
    #[arg(long, value_name = "K", conflicts_with = "slices")]
    pub keep: Option<usize>,

    /// Label volumes: use these slices only, numbered from 0
    #[arg(long, value_name = "I,J,..", value_delimiter = ',')]
    pub slices: Option<Vec<usize>>,

    /// Label volumes: the axis along which slices lie [default: that along which painted slices stand alone, else that of the coarsest
    /// spacing, else z]
    #[arg(long, value_name = "AXIS", default_value = "auto", hide_default_value = true)]
    pub axis: Axis,

    /// Label volumes whose file does not tell (.npy, plain TIFF): sides of a voxel along x, y, z, mm [default: 1 px]
    #[arg(long, value_name = "DX,DY,DZ", value_delimiter = ',', allow_negative_numbers = true)]
    pub spacing: Option<Vec<f64>>,
}
