//! Options of outputs.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::format::{Format, simplify_help};
use crate::error::{Error, Result};
#[cfg(feature = "simplify")]
use crate::estimate::memory;
#[cfg(feature = "dicom")]
use crate::rtstruct::ReferencedSet;
use crate::stack::ContourStack;
use crate::stack::appearance::Appearance;
use crate::surface::content::{Content, Paint};
use crate::surface::map::Map;
#[cfg(feature = "simplify")]
use crate::surface::simplify;

/// What is made of the result.
#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Output")]
pub struct OutputOptions {
    /// Distance between output heights [default: the input's own z_out, else the smaller pixel side]
    #[arg(long, value_name = "HEIGHT")]
    pub dz: Option<f64>,

    /// Output heights as far apart as the smaller pixel side, whatever the input says
    #[arg(long, conflicts_with = "dz")]
    pub isotropic: bool,

    /// Volumes hold 8-bit masks of 0 and 1, whatever came in
    #[arg(long)]
    pub mask: bool,

    /// Volumes hold signed distances, where labels came in too [default: labels come back as labels, anything else as distances]
    #[arg(long, conflicts_with = "mask")]
    pub distance: bool,

    /// Voxels of a mask as the input's, where labels came in
    #[arg(skip)]
    #[serde(skip)]
    pub paint: Option<Paint>,

    /// Draw the input contours into pictures
    #[arg(long)]
    pub contours: bool,

    /// The contour map that was read: where outputs lie, and which part of the stack they show
    #[arg(skip)]
    #[serde(skip)]
    pub map: Option<Arc<Map>>,

    /// Name and colour of the body, or of each label, as far as the input says them
    #[arg(skip)]
    #[serde(skip)]
    pub bodies: Vec<Appearance>,

    /// Meshes with fewer triangles, closed, no farther than this from the full one
    #[arg(long, value_name = "ERROR", help = simplify_help())]
    pub simplify: Option<f64>,

    /// The RTSTRUCT that was read, for a completed one
    #[cfg(feature = "dicom")]
    #[arg(skip)]
    #[serde(skip)]
    pub source: Option<Arc<ReferencedSet>>,
}

impl OutputOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`] with name, range and value.
    pub fn check_ranges(&self) -> Result<()> {
        let fail = |name: &str, message: String| Err(Error::Setting { name: name.into(), message });
        if self.isotropic && self.dz.is_some() {
            return fail("isotropic", "sets the distance that `dz` names".into());
        }
        if self.mask && self.distance {
            return fail("distance", "is not what `mask` asks for: choose one".into());
        }
        for (name, value) in [("dz", self.dz), ("simplify", self.simplify)] {
            if let Some(v) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return fail(name, format!("must be a positive number; got {v}"));
            }
        }
        if self.simplify.is_some() && cfg!(not(feature = "simplify")) {
            return fail("simplify", "this program was built without it (feature `simplify`)".into());
        }
        Ok(())
    }

    /// Refuses a completed RTSTRUCT where none was read.
    pub(super) fn check(&self, path: &Path, format: Format) -> Result<()> {
        let refuse = |message: &str| Err(Error::Output { path: path.into(), message: message.into() });
        match format {
            Format::ImageJ | Format::OmeTiff if self.map.is_some() => {
                return refuse("is a volume, which a contour map has none of as TIFF; its height map is NAME.dem.tif");
            }
            Format::Segments if self.distance => {
                return refuse("holds segments, no distances; `distance` is for volumes of any other format");
            }
            Format::StructureSet => {}
            _ => return Ok(()),
        }
        #[cfg(feature = "dicom")]
        if let Some(source) = &self.source {
            return source.check_output(path);
        }
        let message = "a completed RTSTRUCT needs an RTSTRUCT as input".into();
        Err(Error::Output { path: path.into(), message })
    }

    /// Bytes of memory that making a mesh simpler needs at most, one at a time; nothing where that is not asked for.
    #[cfg_attr(not(feature = "simplify"), expect(unused_variables, reason = "options have been checked"))]
    pub fn bytes_to_simplify(&self, stack: &ContourStack, heights: &[f64]) -> u64 {
        #[cfg(feature = "simplify")]
        if self.simplify.is_some() {
            return simplify::bytes(memory::triangles(stack, heights), rayon::current_num_threads());
        }
        0
    }

    /// Content of volumes: a mask where that is asked for or labels came in, else distances.
    pub(super) fn content(&self) -> Content {
        let came = self.paint.filter(|_| !self.distance);
        let paint = if self.mask { Some(Paint::default()) } else { came };
        paint.map_or(Content::Distance, Content::Mask)
    }

    /// Distance between output heights, where the options say it.
    pub fn step(&self, stack: &ContourStack) -> Option<f64> {
        let [dx, dy] = stack.spacing;
        if self.isotropic { Some(dx.min(dy)) } else { self.dz }
    }
}
