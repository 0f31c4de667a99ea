//! Morph of a whole interval: both sweeps of each of its groups, and the layers that are composed of them.
//!
//! Layers are composed in the interval's mid frame, where the groups were swept: the smallest distance of all groups and of the parts that end. The
//! warp brings them to their places, and the field method's layers count where the particles did not arrive.

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::jobs::{SweepPair, Swept};
use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;
use crate::registration::particle_weight::Trust;

/// The image that layers show, and the padded image on which tiles lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayerImage {
    /// Pixels of the image.
    pub dims: [usize; 2],
    /// Padding of the padded image, pixels along either axis.
    pub pad: [usize; 2],
    /// Distances are clamped to this, px.
    pub limit: f64,
}

impl LayerImage {
    /// Pixels of the padded image.
    pub fn padded(&self) -> [usize; 2] {
        [0, 1].map(|a| self.dims[a] + 2 * self.pad[a])
    }
}

/// An interval to be morphed.
#[derive(Debug, Clone)]
pub struct IntervalMorph<'a> {
    /// Image of its layers.
    pub image: LayerImage,
    /// Times of its layers, increasing, in (0, 1).
    pub times: Vec<f64>,
    /// Sweeps of its groups, which have these times, and the tile of each.
    pub pairs: Vec<(Tile, SweepPair<'a>)>,
    /// Solid parts that end between its contours, and from which they come.
    pub solids: Cow<'a, [(Cap, Direction)]>,
    /// The frame in which the groups are; nothing where it is the image's own.
    pub frame: Option<FrameSource<'a>>,
}

impl IntervalMorph<'_> {
    /// A copy that holds its fields itself.
    ///
    /// # Errors
    /// The errors of its frame's source.
    pub fn owned(&self) -> Result<IntervalMorph<'static>> {
        Ok(IntervalMorph {
            image: self.image,
            times: self.times.clone(),
            pairs: self.pairs.iter().map(|(tile, pair)| (*tile, pair.owned())).collect(),
            solids: Cow::Owned(self.solids.to_vec()),
            frame: self.frame.as_ref().map(FrameSource::owned).transpose()?,
        })
    }
}

/// Source of a frame, which is read when its interval's turn comes: the frames of many intervals do not fit into memory together.
#[derive(Clone)]
pub struct FrameSource<'a> {
    read: Arc<dyn Fn() -> Result<MorphFrame> + Send + Sync + 'a>,
    /// Number of the lone parts.
    pub parts: usize,
    /// Pixels of their tiles.
    pub part_pixels: usize,
}

impl<'a> FrameSource<'a> {
    /// The source of a frame with these lone parts, of which the tiles count.
    pub fn new(lone: &LoneParts, read: impl Fn() -> Result<MorphFrame> + Send + Sync + 'a) -> Self {
        let parts = lone.low.len() + lone.high.len();
        let part_pixels = lone.low.iter().chain(&lone.high).map(|part| part.tile.len()).sum();
        FrameSource { read: Arc::new(read), parts, part_pixels }
    }

    /// The frame.
    ///
    /// # Errors
    /// What hinders reading it.
    pub fn read(&self) -> Result<MorphFrame> {
        (self.read)()
    }

    fn owned(&self) -> Result<FrameSource<'static>> {
        let frame = self.read()?;
        let &FrameSource { parts, part_pixels, .. } = self;
        Ok(FrameSource { read: Arc::new(move || Ok(frame.clone())), parts, part_pixels })
    }
}

impl fmt::Debug for FrameSource<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FrameSource").field("parts", &self.parts).finish_non_exhaustive()
    }
}

/// The mid frame of an interval, and what the field method says between its slices.
#[derive(Debug, Clone)]
pub struct MorphFrame {
    /// Fields of the interval's slices in their moving frame; the interval is number 0.
    pub moving: MotionField,
    /// Whether each slice is empty: its field is then not its own.
    pub empty: [bool; 2],
    /// Slopes of the slices' fields.
    pub slopes: [Arc<Field>; 2],
    /// Parts that meet nothing in the other slice.
    pub lone: Arc<LoneParts>,
    /// Weight of the morph beside the field method.
    pub trust: Arc<Trust>,
}

/// Result of a morph.
#[derive(Debug, Clone, Default)]
pub struct Morphed {
    /// Layers on the image, one per time: signed distance, px.
    pub layers: Vec<SparseImage<f32>>,
    /// Courses of the upward and the downward sweep of each pair.
    pub swept: Vec<[Swept; 2]>,
}

/// Intervals whose layers are made together, from the numbers of their layers: as many as make up to `at_once`, and at least one.
pub fn together(layers: impl IntoIterator<Item = usize>, at_once: usize) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    let mut sum = 0;
    for (i, more) in layers.into_iter().enumerate() {
        match out.last_mut() {
            Some(together) if sum + more <= at_once => together.end = i + 1,
            _ => {
                out.push(i..i + 1);
                sum = 0;
            }
        }
        sum += more;
    }
    out
}
