//! Input stack: parallel contours, each at its own height.
//!
//! One reader per format; each gives a [`ContourStack`]. Numerics see only this type and know nothing of files.

pub mod appearance;
pub mod axis;
pub(crate) mod beyond;
pub mod change;
pub mod cut;
pub mod doubts;
pub(crate) mod ending;
mod forgotten;
pub mod heights;
pub(crate) mod lengths;
pub mod level;
pub mod links;
pub mod mask;
pub mod members;
pub mod options;
mod pinholes;
mod ruggedness;
pub mod space;
mod specks;
pub(crate) mod unresolved;
pub(crate) mod window;

use lengths::check_length;
pub use level::LevelSlice;
pub use mask::Mask;
pub use options::ReadOptions;
pub use space::WorldSpace;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::grid::tile::Tile;

/// Most output heights of a run; a `dz` that asks for more is a mistake.
pub const MOST_HEIGHTS: usize = 10_000_000;
/// Longest pixels, in their widths: of longer ones a contour's surroundings alone would be larger than most images.
const MOST_ASPECT: f64 = 100.0;

/// A stack of parallel contours. Pixel (0, 0) has its centre at `geometry.origin`; rows run along the second axis.
#[derive(Debug, Clone)]
pub struct ContourStack {
    /// Pixels per slice, `[nx, ny]`.
    pub dims: [usize; 2],
    /// Pixel spacing `[dx, dy]` in `unit`, both > 0.
    pub spacing: [f64; 2],
    /// Name of the length unit ("mm"), carried to the outputs.
    pub unit: String,
    /// Slices by strictly increasing height; at least two, at least one not empty.
    pub slices: Vec<Slice>,
    /// Output heights asked for by the input itself.
    pub z_out: Option<HeightGrid>,
    /// Place of the stack in the world.
    pub geometry: Geometry,
    /// Pixels that the input covers, where its contours go on beyond them; nothing where all are covered.
    pub known: Option<Known>,
}

/// Part of a stack that its input covers: within the border of a contour map, say, beyond which lines go on before they are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Known {
    /// Pixels of the stack that are covered.
    pub part: Tile,
    /// Pixels beyond them up to which contours go on as they come; what closes them lies farther out.
    pub onward: usize,
}

/// One contour of the stack.
#[derive(Debug, Clone)]
pub struct Slice {
    /// Name in messages: file name or "k=17".
    pub name: String,
    /// Height in the stack's unit.
    pub z: f64,
    /// A user's added contour: an ordinary knot outside the counted stack.
    pub extra: bool,
    /// The contour itself.
    pub content: SliceContent,
}

/// Content of a slice, which says where its contour is. Row-major, `dims[0] * dims[1]` values.
#[derive(Debug, Clone)]
pub enum SliceContent {
    /// Inside or not; the contour runs half way between pixels.
    Mask(Mask),
    /// Implicit function, `level - value` of a grey slice: the contour is its sub-pixel zero set.
    Level(LevelSlice),
}

impl SliceContent {
    /// Whether pixel `node` is inside; what lies beyond the last pixel is not.
    pub fn inside(&self, node: usize) -> bool {
        match self {
            SliceContent::Mask(m) => m.at(node),
            SliceContent::Level(u) => u.sides().at(node),
        }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            SliceContent::Mask(m) => m.len(),
            SliceContent::Level(u) => u.sides().len(),
        }
    }

    /// Whether no pixel is inside.
    pub fn is_empty(&self) -> bool {
        match self {
            SliceContent::Mask(m) => m.is_blank(),
            SliceContent::Level(u) => u.sides().is_blank(),
        }
    }

    /// Pixels inside.
    pub fn mask(&self) -> &Mask {
        match self {
            SliceContent::Mask(mask) => mask,
            SliceContent::Level(level) => level.sides(),
        }
    }

    /// Whether each pixel is inside.
    pub fn sides(&self) -> Vec<bool> {
        let mut sides = vec![false; self.len()];
        self.read(0, &mut sides);
        sides
    }

    /// Whether the pixels from `first` on are inside.
    pub fn read(&self, first: usize, out: &mut [bool]) {
        match self {
            SliceContent::Mask(m) => m.read(first, out),
            SliceContent::Level(u) => u.sides().read(first, out),
        }
    }
}

/// Equally spaced output heights `start + k * step`, `k < count`, in the stack's unit.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct HeightGrid {
    /// First height.
    pub start: f64,
    /// Distance between heights, > 0.
    pub step: f64,
    /// Number of heights, >= 1.
    pub count: usize,
}

/// Placement in patient or world space, LPS (x to the left, y to the back, z up), as DICOM and ITK use it.
/// The point of pixel (i, j) at stack height z is `origin + i dx axes[0] + j dy axes[1] + z axes[2]`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// World position of pixel (0, 0) at stack height 0.
    pub origin: DVec3,
    /// Unit vectors of the row direction (x), the column direction (y) and the stacking direction (z).
    pub axes: [DVec3; 3],
    /// Axis of the input that each of them is: volumes are written in the input's order, whatever axis its slices lie across.
    pub order: [usize; 3],
    /// Space that the world's coordinates are of.
    #[serde(default, skip_serializing_if = "WorldSpace::is_scanner")]
    pub space: WorldSpace,
}

impl Default for Geometry {
    fn default() -> Self {
        Geometry { origin: DVec3::ZERO, axes: DVec3::AXES, order: [0, 1, 2], space: WorldSpace::default() }
    }
}

impl Geometry {
    /// A point of the stack (`x = i dx`, `y = j dy`, height) in the world.
    pub fn to_world(&self, p: DVec3) -> DVec3 {
        // The origin first: an affine map adds it last, and outputs would differ in their last bits.
        let [x, y, z] = self.axes;
        self.origin + p.x * x + p.y * y + p.z * z
    }

    /// The axes as columns: turns directions of the stack into those of the world.
    pub fn turn(&self) -> DMat3 {
        let [x, y, z] = self.axes;
        DMat3::from_cols(x, y, z)
    }

    /// Whether slices lie across the last axis of their input, so that its voxels run from slice to slice.
    pub fn is_layered(&self) -> bool {
        self.order == [0, 1, 2]
    }

    /// Checks that the origin is finite, that the axes are perpendicular unit vectors, and that the order has every axis.
    ///
    /// # Errors
    /// [`Error::Stack`] with what is wrong.
    pub fn validate(&self) -> Result<()> {
        if let Some(bad) = self.origin.to_array().into_iter().find(|v| !v.is_finite()) {
            return Err(Error::Stack(format!("the origin holds {bad}")));
        }
        axis::check_axes(&self.axes).map_err(Error::Stack)?;
        if (0..3).all(|axis| self.order.contains(&axis)) {
            return Ok(());
        }
        Err(Error::Stack(format!("the order of axes must have 0, 1 and 2; got {:?}", self.order)))
    }
}

impl ContourStack {
    /// Pixels of the larger of its first and last contour: on no more the body ends flat.
    pub fn lid(&self) -> usize {
        let ends = [self.slices.first(), self.slices.last()].into_iter().flatten();
        ends.map(|slice| slice.content.sides().iter().filter(|inside| **inside).count()).max().unwrap_or(0)
    }

    /// A pixel's longer side by its shorter one.
    fn aspect(&self) -> f64 {
        let [dx, dy] = self.spacing;
        (dx / dy).max(dy / dx)
    }

    /// Checks what every reader must guarantee: sizes, finite and strictly increasing heights, positive spacing, both with steps that single
    /// precision holds, at least two slices, at least one pixel inside somewhere.
    ///
    /// # Errors
    /// [`Error::Slice`] or [`Error::Stack`], naming slice, value and limit.
    pub fn validate(&self) -> Result<()> {
        if self.slices.len() < 2 {
            return Err(Error::Stack(format!("at least 2 slices are needed; got {}", self.slices.len())));
        }
        if self.dims.contains(&0) {
            return Err(Error::Stack(format!("slices have no pixels: {}x{}", self.dims[0], self.dims[1])));
        }
        for (axis, h) in ["dx", "dy"].iter().zip(self.spacing) {
            check_length(h).map_err(|m| Error::Stack(format!("pixel spacing {axis} {m}")))?;
        }
        if self.aspect() > MOST_ASPECT {
            let [dx, dy] = self.spacing;
            return Err(Error::Stack(format!(
                "pixels may be up to {MOST_ASPECT} times as long as wide; these are {dx} x {dy} (spacings come in the order x, y, z)"
            )));
        }
        self.geometry.validate()?;
        if let Some(Known { part, .. }) = self.known
            && (0..2).any(|a| part.dims[a] == 0 || part.dims[a] > self.dims[a].saturating_sub(part.origin[a]))
        {
            let ([i, j], [nx, ny]) = (part.origin, part.dims);
            let [most_x, most_y] = self.dims;
            return Err(Error::Stack(format!(
                "{nx}x{ny} px from pixel ({i}, {j}) are said to be known, but the stack is {most_x}x{most_y} px"
            )));
        }
        let mut below: Option<&Slice> = None;
        for (index, s) in self.slices.iter().enumerate() {
            let fail = |message| Err(Error::Slice { index, name: s.name.clone(), message });
            if s.content.len() != self.dims[0] * self.dims[1] {
                return fail(format!(
                    "{} pixels, but the stack is {}x{} px",
                    s.content.len(),
                    self.dims[0],
                    self.dims[1]
                ));
            }
            if !s.z.is_finite() {
                return fail(format!("height must be a finite number; got {}", s.z));
            }
            if let Some(b) = below {
                if s.z <= b.z {
                    let (z, name, before) = (s.z, &b.name, b.z);
                    return fail(format!("height {z} must lie above that of the slice before (`{name}`: {before})"));
                }
                if let Err(m) = check_length(s.z - b.z) {
                    return fail(format!("the height above the slice before (`{}`) {m}", b.name));
                }
            }
            if let SliceContent::Level(u) = &s.content
                && let Some((k, _)) = u.near().iter().find(|(_, v)| !v.is_finite())
            {
                return fail(format!("pixel ({}, {}) is not a finite number", k % self.dims[0], k / self.dims[0]));
            }
            below = Some(s);
        }
        if self.slices.iter().all(|s| s.content.is_empty()) {
            return Err(Error::Stack("all slices are empty: no pixel lies inside".into()));
        }
        if let Some(g) = self.z_out {
            g.validate()?;
        }
        Ok(())
    }
}

impl HeightGrid {
    /// Checks that the grid is finite and increasing.
    ///
    /// # Errors
    /// [`Error::Stack`] naming the field.
    pub fn validate(&self) -> Result<()> {
        let fail = |m: String| Err(Error::Stack(m));
        if !self.start.is_finite() {
            return fail(format!("z_out.start must be a finite number; got {}", self.start));
        }
        check_length(self.step).or_else(|m| fail(format!("z_out.step {m}")))?;
        if self.count == 0 {
            return fail("z_out.count must be at least 1; got 0".into());
        }
        Ok(())
    }

    /// The heights themselves.
    ///
    /// # Errors
    /// [`Error::Stack`] where they are more than [`MOST_HEIGHTS`].
    pub fn heights(&self) -> Result<Vec<f64>> {
        if self.count > MOST_HEIGHTS {
            let (step, count) = (self.step, self.count);
            return Err(Error::Stack(format!(
                "at most {MOST_HEIGHTS} output heights; a step of {step:?} makes {count}"
            )));
        }
        Ok((0..self.count).map(|k| self.start + k as f64 * self.step).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(dims: [usize; 2]) -> ContourStack {
        let content = || SliceContent::Mask((0..dims[0] * dims[1]).map(|_| true).collect());
        let slice = |z: f64| Slice { name: format!("at {z}"), z, extra: false, content: content() };
        ContourStack {
            dims,
            spacing: [1.0; 2],
            unit: "px".into(),
            slices: vec![slice(0.0), slice(1.0)],
            z_out: None,
            geometry: Geometry::default(),
            known: None,
        }
    }

    #[test]
    fn a_slice_has_at_least_one_pixel() {
        for dims in [[1, 1], [1, 9], [9, 1]] {
            assert!(stack(dims).validate().is_ok(), "{dims:?}");
        }
        for dims in [[0, 0], [0, 9], [9, 0]] {
            let message = stack(dims).validate().expect_err("there is no pixel").to_string();
            assert!(message.contains(&format!("no pixels: {}x{}", dims[0], dims[1])), "{message}");
        }
    }

    #[test]
    fn pixels_are_not_far_longer_than_wide() {
        for (spacing, good) in [([1.0, 100.0], true), ([0.02, 2.0], true), ([1.0, 101.0], false), ([9.0, 0.01], false)]
        {
            let stack = ContourStack { spacing, ..stack([3, 3]) };
            match stack.validate() {
                Ok(()) => assert!(good, "{spacing:?}"),
                Err(e) => assert!(!good && e.to_string().contains(&format!("{} x {}", spacing[0], spacing[1])), "{e}"),
            }
            assert_eq!(stack.doubts().len(), 1, "{spacing:?}");
        }
        for spacing in [[1.0, 8.0], [0.25, 0.03125]] {
            assert_eq!(ContourStack { spacing, ..stack([3, 3]) }.doubts(), Vec::<String>::new(), "{spacing:?}");
        }
    }

    #[test]
    fn lengths_are_those_that_single_precision_holds() {
        let sized = |h: f64| ContourStack { spacing: [h; 2], ..stack([3, 3]) };
        let high = |z: f64| {
            let mut stack = stack([3, 3]);
            stack.slices[1].z = z;
            stack
        };
        let stepped =
            |step: f64| ContourStack { z_out: Some(HeightGrid { start: 0.0, step, count: 2 }), ..stack([3, 3]) };
        for (make, words) in [
            (&sized as &dyn Fn(f64) -> ContourStack, "pixel spacing dx must lie between 1e-15 and 1e15; got "),
            (&high, "slice 1 (`at 1`): the height above the slice before (`at 0`) must lie between "),
            (&stepped, "z_out.step must lie between "),
        ] {
            [1e-15, 1e-3, 1e15].iter().for_each(|h| assert!(make(*h).validate().is_ok(), "{h:e}: {words}"));
            for h in [1e-200, 1e-16, 1e16, 1e300] {
                let message = make(h).validate().expect_err(words).to_string();
                assert!(message.contains(words) && message.contains(&format!("got {h:e}")), "{message}");
            }
        }
    }

    #[test]
    fn what_is_known_lies_in_the_stack() {
        let of = |origin, dims| ContourStack {
            known: Some(Known { part: Tile { origin, dims }, onward: 6 }),
            ..stack([4, 3])
        };
        assert!(of([0, 0], [4, 3]).validate().is_ok() && of([3, 2], [1, 1]).validate().is_ok());
        for (origin, dims) in
            [([0, 0], [5, 3]), ([2, 0], [3, 3]), ([0, 3], [1, 1]), ([0, 0], [4, 0]), ([usize::MAX, 0], [1, 1])]
        {
            let message = of(origin, dims).validate().expect_err("it lies beyond").to_string();
            assert!(message.contains("the stack is 4x3 px"), "{message}");
        }
    }

    #[test]
    fn axes_are_perpendicular_unit_vectors_at_a_finite_origin() {
        let of = |x: DVec3| Geometry { axes: [x, DVec3::Y, DVec3::Z], ..Geometry::default() };
        let off = |x: f64| Geometry { origin: DVec3::new(x, 0.0, 0.0), ..Geometry::default() };
        assert!(of(DVec3::NEG_X).validate().is_ok() && off(1e9).validate().is_ok());
        for (wrong, words) in [
            (of(2.0 * DVec3::X), "axis 0 is 2 long"),
            (of(DVec3::ZERO), "axis 0 is 0 long"),
            (of(DVec3::new(f64::NAN, 0.0, 0.0)), "axis 0 is NaN long"),
            (of(DVec3::Y), "axes 0 and 1 are not perpendicular"),
            (off(f64::INFINITY), "the origin holds inf"),
        ] {
            let message = wrong.validate().expect_err(words).to_string();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn slices_across_the_last_axis_are_layers() {
        let of = |order: [usize; 3]| Geometry { order, ..Geometry::default() };
        assert!(of([0, 1, 2]).is_layered() && !of([1, 0, 2]).is_layered() && !of([1, 2, 0]).is_layered());
    }
}
