//! Parameters of the numeric stages, as far as settings have them.

use crate::settings::{AntiAlias, Settings, Sweep};

/// Options by which slices become level sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourOptions {
    /// Rule for masks.
    pub anti_alias: AntiAlias,
    /// Kernel width, samples.
    pub sigma: f64,
    /// Half width of the tubes, px.
    pub half_width: f64,
}

/// Parameters of morphs and sweeps; see [`Settings`] for units and ranges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphOptions {
    /// Half width of the tube (gamma).
    pub half_width: f64,
    /// Start of the cut-off (beta).
    pub cut_off: f64,
    /// Courant number.
    pub cfl: f64,
    /// Arrival tolerance.
    pub tolerance: f64,
    /// Distance between particles.
    pub seed_spacing: f64,
    /// Sweeps that make layers.
    pub sweep: Sweep,
    /// Steps between re-estimations, 0: never.
    pub redistance: usize,
    /// Distance to which slices are right, px.
    pub limit: f64,
}

impl From<&Settings> for ContourOptions {
    fn from(s: &Settings) -> Self {
        ContourOptions { anti_alias: s.anti_alias, sigma: s.sigma, half_width: s.half_width }
    }
}

impl From<&Settings> for MorphOptions {
    fn from(s: &Settings) -> Self {
        MorphOptions {
            half_width: s.half_width,
            cut_off: s.cut_off,
            cfl: s.cfl,
            tolerance: s.tolerance,
            seed_spacing: s.seed_spacing,
            sweep: s.sweep,
            redistance: s.redistance,
            limit: s.margin() as f64,
        }
    }
}
