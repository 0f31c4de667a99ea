//! Presets: settings under a name.

use clap::ValueEnum;

use crate::settings::{AntiAlias, EndRule, Method, Motion, Settings, SlopeRule, Sweep};

/// Settings that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// The published method of Nilsson, Breen and Museth (docs/method.md).
    Paper,
    /// The field method: no sweeps.
    Fast,
}

impl Preset {
    /// The settings of that name.
    pub fn settings(self) -> Settings {
        match self {
            Preset::Paper => Settings {
                motion: Motion::None,
                fair: 0.0,
                anti_alias: AntiAlias::Eq6,
                slope: SlopeRule::Natural,
                sweep: Sweep::Forward,
                redistance: 1,
                end_bottom: EndRule::Flat,
                end_top: EndRule::Flat,
                ..Settings::default()
            },
            Preset::Fast => Settings { method: Method::Field, ..Settings::default() },
        }
    }
}
