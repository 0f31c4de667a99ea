//! DICOM RT structure sets: contours drawn plane by plane, in, and completed by what lies between, out.
//!
//! ```text
//! guard -> parse -> StructureSet -> choose -> planes, drawings -> polygons::stack
//!                        \-> complete (with the contour lines of a result) -> file
//! ```

mod added;
mod choose;
mod complete;
pub mod describe;
mod escapes;
mod find;
mod guard;
mod parse;
mod series;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dicom_object::DefaultDicomObject;
use glam::DVec3;

pub use added::{Added, Gather, StructuresWriter};
use added::{Adding, Between, decimal};
pub use choose::{ChosenRois, Steps};
pub use find::{read_of, structure_sets};
use parse::Parsed;
pub use series::ImageSeries;

use crate::error::{Error, Result};
use crate::polygons::grid::too_large;
use crate::stack::appearance::Appearance;
use crate::stack::members::InterpolatedMember;
use crate::stack::options::RoiName;
use crate::stack::{ContourStack, ReadOptions};
use crate::storage::regular;
use crate::surface::header::Header;

/// An RTSTRUCT file.
#[derive(Debug)]
pub struct StructureSet {
    /// The file.
    pub path: PathBuf,
    /// Its regions of interest, in its order.
    pub rois: Vec<Roi>,
    /// Words on contours that are left out because they are no ROI's.
    pub left_out: Vec<String>,
    /// All of it, for the completed file.
    object: DefaultDicomObject,
    /// Hash of its bytes.
    digest: blake3::Hash,
}

/// A region of interest.
#[derive(Debug, Clone)]
pub struct Roi {
    /// ROI Number.
    pub number: i64,
    /// ROI Name.
    pub name: String,
    /// ROI Display Color, sRGB.
    pub colour: Option<[u8; 3]>,
    /// Its contours, in their order; none where one of them cannot be read.
    pub contours: Vec<Contour>,
    /// Why they cannot be read: ROI, contour, field and value.
    pub fault: Option<String>,
    /// Words on contours that are left out because others are there.
    pub notes: Vec<String>,
}

/// One contour of a ROI.
#[derive(Debug, Clone)]
pub struct Contour {
    /// Contour Geometric Type.
    pub kind: String,
    /// Points in mm, LPS.
    pub points: Vec<DVec3>,
}

impl Contour {
    /// Whether it is a closed line on a plane.
    fn is_closed(&self) -> bool {
        self.kind == CLOSED || self.is_xor()
    }

    /// Whether its ROI says outright that its contours are combined by even-odd.
    fn is_xor(&self) -> bool {
        self.kind == CLOSED_XOR
    }
}

const CLOSED: &str = "CLOSED_PLANAR";
const CLOSED_XOR: &str = "CLOSEDPLANAR_XOR";

impl Roi {
    /// Label for messages.
    pub fn label(&self) -> String {
        format!("ROI {} (`{}`)", self.number, self.name)
    }

    /// Whether it has contours, be they ones that cannot be read.
    pub fn is_drawn(&self) -> bool {
        self.fault.is_some() || !self.contours.is_empty()
    }

    /// Name, number and colour.
    fn appearance(&self) -> Appearance {
        let name = Some(self.name.trim()).filter(|name| !name.is_empty());
        Appearance { name: name.map(String::from), number: Some(self.number), colour: self.colour, segment: None }
    }
}

impl StructureSet {
    /// Reads an RTSTRUCT.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Format`] naming field, ROI, contour and value.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = regular::read(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let fail = |message: String| Error::Format { path: path.into(), message };
        let Parsed { object, rois, left_out } = parse::parse(&bytes).map_err(fail)?;
        Ok(StructureSet { path: path.into(), rois, left_out, object, digest: blake3::hash(&bytes) })
    }

    /// The ROI of a name or number.
    ///
    /// # Errors
    /// [`Error::Setting`] with all ROIs there are, where none or several could be meant.
    pub fn find(&self, wanted: &RoiName) -> Result<&Roi> {
        let fail = |message: String| {
            Err(Error::Setting { name: "roi".into(), message: format!("{message}; there are {}", self.listed()) })
        };
        let numbered = |number: i64| self.rois.iter().find(|r| r.number == number);
        let text = match wanted {
            RoiName::Number(number) => {
                let none = || fail(format!("must name one of the file's ROIs; got {number}"));
                return numbered(*number).map_or_else(none, Ok);
            }
            RoiName::Text(text) => text.trim(),
        };
        let mut meant: Vec<&Roi> = self.rois.iter().filter(|r| r.name.trim() == text).collect();
        let by_number = text.parse().ok().and_then(numbered);
        meant.extend(by_number.filter(|roi| meant.iter().all(|named| named.number != roi.number)));
        match meant[..] {
            [roi] => Ok(roi),
            [] => fail(format!("must name one of the file's ROIs; got `{text}`")),
            _ => {
                let ways: Vec<String> = meant.iter().map(|roi| format!("`number={}`", roi.number)).collect();
                fail(format!("`{text}` may be any of {} ROIs: say {}", ways.len(), ways.join(" or ")))
            }
        }
    }

    /// Numbers and names of all ROIs.
    fn listed(&self) -> String {
        self.rois.iter().map(|r| format!("{} `{}`", r.number, r.name)).collect::<Vec<_>>().join(", ")
    }
}

/// A structure set that a stack was read from, and what was chosen of it.
#[derive(Debug)]
pub struct ReferencedSet {
    /// The file.
    pub set: Arc<StructureSet>,
    /// Options of the choice.
    pub options: ReadOptions,
    /// Step of the planes on which contours are added; else all output heights are such planes.
    pub every: Option<f64>,
    /// Images on whose planes, and no others, contours are added.
    pub images: Option<Arc<ImageSeries>>,
}

impl ReferencedSet {
    /// The set with the ROIs that `options` choose, checked.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    pub fn new(set: &Arc<StructureSet>, options: &ReadOptions) -> Result<Self> {
        set.choose(options)?;
        Ok(ReferencedSet { set: set.clone(), options: options.clone(), every: None, images: None })
    }

    /// The stack of what was chosen.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`] and [`ChosenRois::stack`].
    pub fn stack(&self) -> Result<ContourStack> {
        self.set.choose(&self.options)?.stack(&self.options)
    }

    /// ROIs of it that are interpolated to planes of others before they become one with them, on the pixels of their `union`.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`] and [`ChosenRois::interpolated`].
    pub fn interpolated(&self, union: &ContourStack) -> Result<Vec<InterpolatedMember>> {
        self.set.choose(&self.options)?.interpolated(&self.options, union)
    }

    /// Name and colour of what was chosen.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    pub fn appearance(&self) -> Result<Appearance> {
        let chosen = self.set.choose(&self.options)?;
        let all: Vec<Appearance> = chosen.rois.iter().map(|roi| roi.appearance()).collect();
        Ok(Appearance::merged(all.iter()))
    }

    /// Steps of output heights where none are asked for, and what a person should know of the contours on `stack`.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    pub fn about(&self, stack: &ContourStack) -> Result<(Option<Steps>, Vec<String>)> {
        let chosen = self.set.choose(&self.options)?;
        let steps = chosen.steps(stack);
        let drawings = chosen.drawings(&self.options)?;
        let large = too_large(&drawings, self.options.pixel.map(|px| [px; 2]), stack.spacing);
        let crossing = chosen.crossing(&drawings);
        let unlike = chosen.on_planes_of_others(&self.options)?;
        let mut notes = self.set.left_out.clone();
        notes.extend(chosen.notes.iter().cloned());
        notes.extend(unlike);
        notes.extend(large.into_iter().chain(crossing));
        let lost = stack.slices.iter().filter(|s| s.content.is_empty());
        let px = stack.spacing[0];
        notes.extend(lost.map(|s| {
            format!(
                "plane {} at {}: no pixel of {px} mm lies inside its contours; a smaller --pixel finds them",
                s.name, s.z
            )
        }));
        notes.extend(chosen.doubts(stack, &self.options)?);
        Ok((steps, notes))
    }

    /// Refuses to write a completed file where none can be made.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn check_output(&self, path: &Path) -> Result<()> {
        let fail = |message: &str| Err(Error::Output { path: path.into(), message: message.into() });
        if self.options.roi.len() > 1 {
            return fail("merged ROIs are none of the file's own; a completed RTSTRUCT takes one --roi, or --all-rois");
        }
        Ok(())
    }

    /// From now on contours are added on the planes of these images.
    ///
    /// # Errors
    /// [`Error::Setting`] for images in another frame of reference than that of the ROIs; those of [`StructureSet::choose`].
    pub fn refer_to(&mut self, images: &Arc<ImageSeries>) -> Result<()> {
        let chosen: Vec<i64> = self.set.choose(&self.options)?.rois.iter().map(|roi| roi.number).collect();
        let own = self.set.frames(&chosen);
        if !images.frame.is_empty() && !own.is_empty() && !own.contains(&images.frame) {
            let message =
                format!("must be images in the ROI's frame of reference, {}; got {}", own.join(" or "), images.frame);
            return Err(Error::Setting { name: "like".into(), message });
        }
        (self.every, self.images) = (None, Some(images.clone()));
        Ok(())
    }

    /// Whether what was chosen is drawn on every image, so that a completed file needs none between unless heights are asked for.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    pub fn is_on_every_image(&self) -> Result<bool> {
        Ok(self.every.is_some() && self.set.choose(&self.options)?.is_on_every_image())
    }

    /// Why a completed file gets no contours on any of the output heights, which lie `step` apart; nothing where it gets some.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    pub fn adds_nothing(&self, heights: &[f64], step: f64) -> Result<Option<String>> {
        let chosen = self.set.choose(&self.options)?;
        let between = Between::new(&chosen, self, step)?;
        if heights.iter().any(|z| between.wants(*z)) {
            return Ok(None);
        }
        let why = match (&self.images, self.every.map(decimal)) {
            (Some(_), _) => "no image lies between its planes but those that it was drawn on".into(),
            (None, Some(every)) => {
                format!("those of every {every} mm from the lowest contour on were drawn; --dz says another step")
            }
            (None, None) => {
                let step = decimal(step);
                format!(
                    "the heights of the layers, {step} mm apart, lie at planes that were drawn; a smaller --dz has others"
                )
            }
        };
        Ok(Some(format!("no plane is added to {}: {why}", chosen.rois[0].label())))
    }

    /// Takes the layers of the body that is made of what was chosen.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    fn adding(&self, header: &Header) -> Result<Adding> {
        let chosen = self.set.choose(&self.options)?;
        Adding::new(&chosen, self, header)
    }
}

/// The stack of the ROIs that `options` name, on the planes they name.
///
/// # Errors
/// The errors of [`StructureSet::choose_file`] and [`StructureSet::choose`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<ContourStack> {
    StructureSet::choose_file(path, options.series.as_deref())?.choose(options)?.stack(options)
}
