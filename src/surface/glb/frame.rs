//! Unit and directions of a scene's axes.

use std::f32::consts::FRAC_1_SQRT_2;
use std::io;

use clap::ValueEnum;
use gltf_json::Node;
use gltf_json::scene::UnitQuaternion;
use serde::{Deserialize, Serialize};

use crate::surface::length;

/// A unit that a scene is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneUnit {
    /// Metres, as glTF has it.
    M,
}

/// How a scene lies; by default as all other outputs do: in the stack's unit, axes to the left, posterior, superior.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SceneFrame {
    /// Its unit, if it is not the stack's.
    pub unit: Option<SceneUnit>,
    /// Whether y is superior and z anterior: (x, y, z) becomes (x, z, -y).
    pub y_up: bool,
}

impl SceneFrame {
    /// Why a stack in `unit` cannot be in this frame.
    ///
    /// # Errors
    /// Words about a unit that has no known length.
    pub fn check(self, unit: &str) -> Result<(), String> {
        match self.unit {
            Some(SceneUnit::M) if length::metres(unit).is_none() => {
                Err(format!("m is not known of an input in {unit}; units with a length are {}", length::known()))
            }
            _ => Ok(()),
        }
    }

    /// The node that carries bodies in `unit` into this frame; nothing where they lie in it.
    pub(super) fn node(self, unit: &str) -> io::Result<Option<Node>> {
        self.check(unit).map_err(|message| io::Error::new(io::ErrorKind::InvalidInput, message))?;
        let scale = self.unit.and_then(|_| length::metres(unit)).map(|metres| [metres as f32; 3]);
        // By -90 degrees about x.
        let rotation = self.y_up.then_some(UnitQuaternion([-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]));
        let moved = scale.is_some() || rotation.is_some();
        Ok(moved.then(|| Node { scale, rotation, ..Node::default() }))
    }

    /// Unit and directions of the axes.
    pub(super) fn words(self, unit: &str) -> [&str; 2] {
        let space = if self.y_up { "left-superior-anterior" } else { "left-posterior-superior" };
        [self.unit.map_or(unit, |SceneUnit::M| "m"), space]
    }
}
