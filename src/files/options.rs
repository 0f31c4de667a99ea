//! Options of outputs.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::format::{Format, Kind, kind, simplify_help};
use super::like::Like;
use crate::error::{Error, Result};
#[cfg(feature = "simplify")]
use crate::estimate::memory;
#[cfg(feature = "dicom")]
use crate::rtstruct::ReferencedSet;
use crate::settings::{EndRule, Settings};
use crate::stack::ContourStack;
use crate::stack::appearance::Appearance;
use crate::stack::heights::height_grid;
use crate::stack::options::Below;
use crate::surface::content::{Content, Paint};
use crate::surface::glb::{SceneFrame, SceneUnit};
use crate::surface::length;
use crate::surface::map::Map;
#[cfg(feature = "simplify")]
use crate::surface::simplify;

/// What is made of the result.
#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Output")]
pub struct OutputOptions {
    /// Distance between output heights [default: the input's own grid or z_out; of a contour map an eighth of the usual distance of its levels; else the smaller pixel
    /// side]
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

    /// Volumes and height maps on the grid of this volume, GeoTIFF or folder of DICOM images; a completed RTSTRUCT on the planes of these images,
    /// to which it refers
    #[arg(long, value_name = "IMAGE|FOLDER", conflicts_with_all = ["dz", "isotropic"])]
    pub like: Option<PathBuf>,

    /// What was read of it
    #[arg(skip)]
    #[serde(skip)]
    pub target: Option<Arc<Like>>,

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

    /// `.glb` in metres, as glTF has it [default: in the input's unit]
    #[arg(long, value_name = "UNIT")]
    pub units: Option<SceneUnit>,

    /// `.glb` with y upwards, as glTF has it: x left, y superior, z anterior
    #[arg(long)]
    pub y_up: bool,

    /// The RTSTRUCT that was read, for a completed one
    #[cfg(feature = "dicom")]
    #[arg(skip)]
    #[serde(skip)]
    pub source: Option<Arc<ReferencedSet>>,
}

/// Share of the distance of planes by which a plane of another image and a slice may differ and be one: files round places and directions, and a plane
/// that lay beside the last slice by less would be empty.
const SAME_PLANE: f64 = 0.01;
/// Share of what is drawn that may lie beyond a grid without a word: rims that a coarser one cuts.
const BEYOND: f64 = 1e-3;

/// Gives planes at increasing `heights` that lie on a slice that one's height.
fn take_slices(heights: &mut [f64], slices: impl Iterator<Item = f64>) {
    for z in slices {
        let above = heights.partition_point(|h| *h < z);
        let around = above.saturating_sub(1)..(above + 1).min(heights.len());
        let Some(k) = around.min_by(|a, b| (heights[*a] - z).abs().total_cmp(&(heights[*b] - z).abs())) else {
            continue;
        };
        let beside = [k.checked_sub(1), Some(k + 1).filter(|next| *next < heights.len())];
        let step =
            beside.into_iter().flatten().map(|other| (heights[other] - heights[k]).abs()).fold(f64::INFINITY, f64::min);
        if step.is_finite() && (heights[k] - z).abs() <= SAME_PLANE * step {
            heights[k] = z;
        }
    }
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
        if self.like.is_some() && (self.isotropic || self.dz.is_some()) {
            return fail("like", "sets the heights that `dz` and `isotropic` are for".into());
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
        if kind(path)? == Kind::Volume
            && let Some(Err(message)) = self.target.as_ref().map(|like| like.grid.check_even())
        {
            return refuse(&format!("cannot be like what `like` names: {message}"));
        }
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
        let message =
            "a completed RTSTRUCT needs an RTSTRUCT as input of `reconstruct` or `batch`; parts do not hold it".into();
        Err(Error::Output { path: path.into(), message })
    }

    /// Notes for a person on a grid that does not go with a stack.
    pub(super) fn doubts(&self, stack: &ContourStack) -> Vec<String> {
        let mut doubts = Vec::new();
        let own = &stack.unit;
        if let Some(unit) = self.target.as_ref().and_then(|like| like.unit.as_ref()) {
            let metres = length::metres(unit).zip(length::metres(own));
            if metres.is_some_and(|(a, b)| (a - b).abs() > 1e-9 * b) {
                doubts.push(format!(
                    "`like` names a grid in {unit}, and the slices are in {own}: numbers are compared as they are, not places"
                ));
            }
        }
        let frame = self.target.as_ref().and_then(|like| like.grid.frame(&stack.geometry).ok());
        let beyond = frame.map_or(0.0, |frame| frame.beyond(stack));
        if beyond > BEYOND {
            doubts.push(format!(
                "{} of what is drawn lies beyond the grid that `like` names, and is in no volume",
                match 100.0 * beyond {
                    share if share < 1.0 => "less than 1 %".into(),
                    share => format!("{share:.0} %"),
                }
            ));
        }
        if let (Some(dz), Some(first), Some(last)) = (self.dz, stack.slices.first(), stack.slices.last()) {
            let high = last.z - first.z;
            if dz > high {
                doubts.push(format!(
                    "`dz` is {dz} {own}, and the body is {high} {own} high: no layer lies between its contours"
                ));
            }
        }
        doubts
    }

    /// What is asked for of outputs that are none of `paths`, `below` of a map among it: a sentence for each option that changes nothing.
    pub fn idle(&self, below: Option<Below>, paths: &[PathBuf]) -> Vec<String> {
        let has = |is: &dyn Fn(&Path) -> bool| paths.iter().any(|path| is(path));
        let format = |path: &Path| Format::of(path).ok();
        let volume = has(&|path| matches!(kind(path), Ok(Kind::Volume)));
        let mesh = has(&|path| matches!(kind(path), Ok(Kind::Mesh)));
        let scene = has(&|path| format(path) == Some(Format::Glb));
        let picture = has(&|path| format(path) == Some(Format::Png));
        let heights = has(&|path| format(path) == Some(Format::Dem));
        let [scenes, pictures, maps] = [Format::Glb, Format::Png, Format::Dem].map(Format::extension);
        let options = [
            ("mask", self.mask, volume, "volumes"),
            ("distance", self.distance, volume, "volumes"),
            ("contours", self.contours, picture, &pictures),
            ("simplify", self.simplify.is_some(), mesh, "meshes"),
            ("units", self.units.is_some(), scene, &scenes),
            ("y_up", self.y_up, scene, &scenes),
            ("below", below.is_some(), heights, &maps),
        ];
        let idle = options.into_iter().filter(|(_, asked, there, _)| *asked && !there);
        idle.map(|(name, .., of)| format!("setting `{name}` changes nothing: it is for {of}, and none is written"))
            .collect()
    }

    /// That some of `paths` end with the drawn planes although the body goes on beyond them.
    pub fn ends_before(paths: &[PathBuf], settings: &Settings) -> Option<String> {
        let completed = paths.iter().find(|path| Format::of(path).ok() == Some(Format::StructureSet))?;
        let goes_on = [settings.end_bottom, settings.end_top].iter().any(|rule| *rule != EndRule::Flat);
        goes_on.then(|| {
            format!(
                "{}: a completed RTSTRUCT ends with the planes that were drawn; what `end_bottom` and `end_top` add beyond them is in other outputs alone",
                completed.display()
            )
        })
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

    /// Reads what `like` names, once.
    ///
    /// # Errors
    /// The errors of [`Like::read`].
    pub fn look(&mut self) -> Result<()> {
        if let (Some(path), None) = (&self.like, &self.target) {
            self.target = Some(Arc::new(Like::read(path)?));
        }
        Ok(())
    }

    /// Output heights of a stack: those of the grid that was asked for, else those that its steps and `settings` make.
    ///
    /// # Errors
    /// [`Error::Setting`] for a grid that lies oblique to the slices or beside them; [`Error::Stack`] for too many heights.
    pub fn heights(&self, stack: &ContourStack, settings: &Settings) -> Result<Vec<f64>> {
        if let Some(like) = &self.target {
            let frame = like.grid.frame(&stack.geometry);
            let frame = frame.map_err(|message| Error::Setting { name: "like".into(), message })?;
            if !frame.meets(&stack.geometry, stack.dims, stack.spacing) {
                let message = "names a grid that has no place in common with the slices: is it of another scan or map?";
                return Err(Error::Setting { name: "like".into(), message: message.into() });
            }
            if let Some(mut heights) = frame.heights(&stack.geometry) {
                take_slices(&mut heights, stack.slices.iter().map(|slice| slice.z));
                return Ok(heights);
            }
        }
        height_grid(stack, settings, self.step(stack)).heights()
    }

    /// Content of volumes: a mask where that is asked for or labels came in, else distances.
    pub(super) fn content(&self) -> Content {
        let came = self.paint.filter(|_| !self.distance);
        let paint = if self.mask { Some(Paint::default()) } else { came };
        paint.map_or(Content::Distance, Content::Mask)
    }

    /// How a scene lies.
    pub(super) fn frame(&self) -> SceneFrame {
        SceneFrame { unit: self.units, y_up: self.y_up }
    }

    /// Checks that a stack in `unit` can be had in the unit that is asked for.
    ///
    /// # Errors
    /// [`Error::Setting`] for a unit of unknown length.
    pub fn check_unit(&self, unit: &str) -> Result<()> {
        self.frame().check(unit).map_err(|message| Error::Setting { name: "units".into(), message })
    }

    /// Distance between output heights, where the options say it.
    pub fn step(&self, stack: &ContourStack) -> Option<f64> {
        let [dx, dy] = stack.spacing;
        if self.isotropic { Some(dx.min(dy)) } else { self.dz }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_beside_a_slice_by_rounding_is_that_slices() {
        let mut heights = vec![-3.9999, 0.0, 3.99, 8.0003, 12.0];
        take_slices(&mut heights, [-4.0, 4.0, 8.0, 8.9].into_iter());
        assert_eq!(heights, [-4.0, 0.0, 4.0, 8.0, 12.0]);
        let mut apart = vec![0.05, 4.0];
        take_slices(&mut apart, [0.0, 3.9].into_iter());
        assert_eq!(apart, [0.05, 4.0], "more than a hundredth away");
        let mut alone = vec![1e-9];
        take_slices(&mut alone, [0.0].into_iter());
        assert_eq!(alone, [1e-9], "of one plane nobody knows the distance");
    }
}
