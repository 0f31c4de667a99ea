//! Places of the voxels of a volume in the world.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::stack::axis::check_axes;
use crate::stack::lengths::check_length;
use crate::stack::space::WorldSpace;

/// Message of a reader without the file's name.
pub(crate) type Failure<T> = std::result::Result<T, String>;

/// What to do with an image of more than three axes: which of its volumes is meant nobody can guess.
pub(crate) const TAKE_ONE: &str = "save the one that is meant (a time, a channel) as a file of its own, and give that";

/// The three axes of a volume among those of these sizes: all of three, and of more those that are left without as many of length 1, where no other choice
/// of these is possible. Of axes of length 1 it is those that are said to be none of space, where these are as many.
pub(crate) fn three_of(sizes: &[usize], of_space: impl Fn(usize) -> bool) -> Option<[usize; 3]> {
    let all = || 0..sizes.len();
    let short = |axis: &usize| sizes.len() > 3 && sizes[*axis] == 1;
    let without =
        |passed: &dyn Fn(&usize) -> bool| all().filter(|axis| !passed(axis)).collect::<Vec<_>>().try_into().ok();
    without(&short).or_else(|| without(&|axis| short(axis) && !of_space(*axis)))
}

/// Most voxels of a volume: the header of a damaged file may ask for anything.
const MOST_VOXELS: usize = 1 << 40;

/// Grid of the voxels of a volume in the world (LPS).
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeGrid {
    /// Voxels along x, y, z, the file's first, second and third axis.
    pub dims: [usize; 3],
    /// Position of voxel (0, 0, 0).
    pub origin: DVec3,
    /// Steps from voxel to voxel along each axis.
    pub steps: [DVec3; 3],
    /// Length unit.
    pub unit: String,
    /// Whether the file says how far apart its voxels are.
    pub spaced: bool,
    /// Space that positions are of.
    pub space: WorldSpace,
}

impl VolumeGrid {
    /// A grid without place or spacing: 1 px along each axis.
    pub fn unspaced(dims: [usize; 3]) -> Self {
        VolumeGrid {
            dims,
            origin: DVec3::ZERO,
            steps: DVec3::AXES,
            unit: "px".into(),
            spaced: false,
            space: WorldSpace::default(),
        }
    }

    /// Whether neither the file nor anybody says how far apart its voxels are, which count as 1 px then.
    pub fn is_assumed(&self) -> bool {
        !self.spaced && self.unit == "px"
    }

    /// Voxel sides.
    pub fn spacing(&self) -> [f64; 3] {
        self.steps.map(DVec3::length)
    }

    /// Unit vectors along the axes.
    pub fn axes(&self) -> [DVec3; 3] {
        self.steps.map(|step| step / step.length())
    }

    pub(crate) fn check(&self) -> Failure<()> {
        let [nx, ny, nz] = self.dims;
        let count = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz));
        if !count.is_some_and(|n| (1..=MOST_VOXELS).contains(&n)) {
            return Err(format!("sizes {nx} {ny} {nz} are no volume of 1 to {MOST_VOXELS} voxels"));
        }
        if let Some(bad) = self.origin.to_array().into_iter().find(|v| !v.is_finite()) {
            return Err(format!("the origin holds {bad}"));
        }
        for (axis, step) in self.steps.into_iter().enumerate() {
            // The square of a length may be beyond all numbers, where the length is not.
            let largest = step.abs().max_element();
            let side = if largest.is_normal() { largest * (step / largest).length() } else { step.length() };
            check_length(side).map_err(|m| format!("voxel spacing along axis {axis} {m}"))?;
        }
        check_axes(&self.axes()).map_err(|m| format!("{m}; resample the volume first"))
    }
}

/// The sides of a voxel as a user gives them.
///
/// # Errors
/// [`Error::Setting`] for other than three positive numbers.
pub(crate) fn sides(given: &[f64]) -> Result<[f64; 3]> {
    let wrong = |message: String| Error::Setting { name: "spacing".into(), message };
    let &[dx, dy, dz] = given else {
        return Err(wrong(format!("must be three numbers DX,DY,DZ; got {}", given.len())));
    };
    if let Some(bad) = given.iter().find(|h| !(h.is_finite() && **h > 0.0)) {
        return Err(wrong(format!("must be three positive numbers; got {bad}")));
    }
    given.iter().try_for_each(|h| check_length(*h)).map_err(wrong)?;
    Ok([dx, dy, dz])
}
