//! The front door for files: which reader a path gets.

mod contents;
pub mod folder;
pub mod format;
mod gathered;
mod grey_image;
mod grey_rule;
mod images;
pub mod labels;
mod masks;
pub mod mha;
pub mod nifti;
pub mod npy;
pub mod npz;
pub mod nrrd;
mod numbers;
mod ome;
#[cfg(feature = "zarr")]
mod ome_zarr;
mod palette;
mod segments;
mod slice_names;
mod sniff;
pub mod tiff;
pub mod volume;
mod wanted;

use std::path::{Path, PathBuf};

use self::format::Kind;
pub use self::format::expected;
pub(crate) use self::gathered::Gathered;
use self::volume::survey::Survey;
use self::volume::{Lacking, Volume, axis, slices};
use crate::error::{Error, Result};
use crate::labels::given::{Completeness, Given, hole};
use crate::stack::ContourStack;
use crate::stack::appearance::Appearance;
use crate::stack::axis::Axis;
use crate::stack::members::{InterpolatedMember, Member, drawn_on_slices_of_others};
use crate::stack::options::{LabelName, ReadOptions};
use crate::surface::content::Paint;

impl Kind {
    /// The kind. A folder of images without `stack.json` is a volume where `labels` are told apart, and where its images are no grey slices.
    fn of_input(path: &Path, labels: bool) -> Result<Self> {
        let kind = Kind::of(path)?;
        let images = matches!(kind, Kind::Folder) && folder::is_of_images(path);
        let volume = images && (labels || images::are_of_other_numbers(path));
        Ok(if volume { Kind::Volume(images::read) } else { kind })
    }

    /// The kind, if the options are for it.
    fn for_options(path: &Path, options: &ReadOptions) -> Result<Self> {
        Kind::of_input(path, options.label.is_some())?.check(options, path)
    }

    /// This kind, if the options are for it.
    fn check(self, options: &ReadOptions, path: &Path) -> Result<Self> {
        let kind = self;
        let chooses = "a folder of slices; it chooses from a label volume";
        let folder = matches!(kind, Kind::Folder);
        let volume = matches!(kind, Kind::Volume(_));
        let structures = matches!(kind, Kind::StructureSet);
        let map = matches!(kind, Kind::Map);
        let lines = "a contour map";
        let wrong = [
            (map && options.label.is_some(), "label", lines),
            (map && options.keep.is_some(), "keep", lines),
            (map && options.slices.is_some(), "slices", lines),
            (!map && options.layer.is_some(), "layer", "anything but a GeoPackage"),
            (!map && options.elevation.is_some(), "elevation", "anything but contour maps"),
            (!map && options.border.is_some(), "border", "anything but contour maps"),
            (!map && options.below.is_some(), "below", "anything but contour maps"),
            (!map && options.z_unit.is_some(), "z_unit", "anything but contour maps"),
            (!map && options.crs_out.is_some(), "crs_out", "anything but contour maps"),
            (!map && options.crs.is_some(), "crs", "anything but contour maps"),
            (structures && options.label.is_some(), "label", "an RTSTRUCT; `roi` chooses there"),
            (!structures && !options.roi.is_empty(), "roi", "anything but an RTSTRUCT"),
            (!structures && options.series.is_some(), "series", "anything but a folder of DICOM files"),
            (volume && options.pixel.is_some(), "pixel", "volumes; it is the pixel size for polygons"),
            (folder && options.keep.is_some(), "keep", chooses),
            (folder && options.slices.is_some(), "slices", chooses),
            (!volume && options.axis != Axis::Auto, "axis", "anything but a label volume"),
            (
                !volume && options.spacing.is_some() && !(folder && folder::is_bare(path)),
                "spacing",
                "anything but a label volume whose file has none, and a folder of images",
            ),
            (!folder && !volume && options.level.is_some(), "level", "this input; it cuts grey slices and volumes"),
            (
                !folder && !volume && options.invert,
                "invert",
                "this input; it is for grey slices and volumes, and images",
            ),
            (options.invert && options.label.is_some(), "invert", "a run with `label`"),
            (options.complete_slices, "complete_slices", "one body; it is for many, with `labels`"),
            (options.label.is_some() && options.level.is_some(), "label", "grey values, which `level` cuts"),
            (options.keep.is_some() && options.slices.is_some(), "keep", "a volume whose `slices` are named"),
        ];
        if let Some(px) = options.pixel.filter(|px| !(px.is_finite() && *px > 0.0)) {
            return Err(Error::Setting {
                name: "pixel".into(),
                message: format!("must be a positive number; got {px}"),
            });
        }
        options.spacing.as_deref().map(volume::grid::sides).transpose()?;
        match wrong.into_iter().find(|(wrong, ..)| *wrong) {
            Some((_, option, what)) => {
                Err(Error::Setting { name: option.into(), message: format!("is not for {what}") })
            }
            None => Ok(kind),
        }
    }
}

/// Checks that an input is there, and that the options are for its kind; its content is not looked at.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`] or [`Error::Setting`].
pub fn check(path: &Path, options: &ReadOptions) -> Result<()> {
    Kind::for_options(path, options).map(drop)
}

/// The files whose content makes up an input.
///
/// # Errors
/// [`Error::Read`] or [`Error::Format`].
pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
    match Kind::of(path)? {
        Kind::Folder => folder::files(path),
        #[cfg(feature = "terrain")]
        Kind::Map => Ok(crate::terrain::files(path)),
        Kind::Volume(header) => Ok(header(path)?.files()),
        #[cfg(not(feature = "terrain"))]
        Kind::Map => Ok(vec![path.into()]),
        #[cfg(feature = "dicom")]
        Kind::StructureSet if path.is_dir() => crate::rtstruct::structure_sets(path),
        Kind::StructureSet => Ok(vec![path.into()]),
    }
}

/// Whether an input is an RTSTRUCT, or a folder of DICOM files.
pub fn is_structure_set(path: &Path) -> bool {
    matches!(Kind::of(path), Ok(Kind::StructureSet))
}

/// Whether an input is a contour map.
pub fn is_map(path: &Path) -> bool {
    matches!(Kind::of(path), Ok(Kind::Map))
}

/// The labels of a label volume, and which of its slices have any.
///
/// # Errors
/// The errors of [`read`]; [`Error::Format`] for a folder of slices.
pub fn survey(path: &Path) -> Result<Survey> {
    surveyed(path).map(|(_, survey)| survey)
}

fn surveyed(path: &Path) -> Result<(Volume, Survey)> {
    let volume = open_volume(path)?;
    let survey = Survey::of(&volume, None)?;
    match survey.grey() {
        Some(message) => Err(Error::Format { path: path.into(), message }),
        None => Ok((volume, survey)),
    }
}

/// The volume in a file or folder: its header is read, and none of its voxels.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] for what is no volume, or a damaged one.
pub fn open_volume(path: &Path) -> Result<Volume> {
    match Kind::of(path)? {
        Kind::Volume(header) => header(path),
        Kind::Folder | Kind::StructureSet | Kind::Map => {
            Err(Error::Format { path: path.into(), message: "is not a label volume".into() })
        }
    }
}

/// The labels of a label volume that are on two slices or more, and so can be reconstructed, and those that are on one.
///
/// # Errors
/// The errors of [`survey`]; [`Error::Format`] for a volume that has more labels than are told apart.
pub fn labels(path: &Path) -> Result<[Vec<i64>; 2]> {
    let (volume, survey) = surveyed(path)?;
    if survey.more {
        return Err(Error::Format { path: path.into(), message: "has too many labels for a line each".into() });
    }
    let axis = axis::choose(Axis::Auto, &volume.grid, &survey).axis;
    let (several, one): (Vec<_>, Vec<_>) =
        survey.extents.into_iter().partition(|(_, extent)| extent[axis][0] < extent[axis][1]);
    Ok([several, one].map(|of| of.into_iter().map(|(label, _)| label).collect()))
}

/// A stack that was read.
#[derive(Debug, Clone)]
pub struct Input {
    /// The checked stack.
    pub stack: ContourStack,
    /// Findings, if it is a volume.
    pub surveyed: Option<Surveyed>,
    /// Notes on the file for a person.
    pub notes: Vec<String>,
    /// What has been chosen where nobody has said it, for `inspect`: the pixels of polygons, and why.
    pub chosen: Option<String>,
}

impl Input {
    /// A stack of which there is nothing to say.
    fn of(stack: ContourStack) -> Self {
        Input { stack, surveyed: None, notes: Vec::new(), chosen: None }
    }

    /// Reads a stack.
    ///
    /// # Errors
    /// The errors of [`read`].
    pub fn read(path: &Path, options: &ReadOptions) -> Result<Self> {
        Self::of_kind(Kind::for_options(path, options)?, path, options)
    }

    /// Reads what labels are chosen from: all that is painted.
    ///
    /// # Errors
    /// The errors of [`read`]; [`Error::Setting`] for what is no volume.
    pub fn of_labels(path: &Path, options: &ReadOptions) -> Result<Self> {
        let kind = Kind::of_input(path, true)?.check(options, path)?;
        let fail = |what: &str| Err(Error::Setting { name: "labels".into(), message: format!("is not for {what}") });
        match kind {
            Kind::Volume(_) => Self::of_kind(kind, path, options),
            Kind::Folder => fail(
                "a folder of slices with stack.json; it chooses from a label volume, or from images whose `spacing` is named",
            ),
            Kind::StructureSet | Kind::Map => fail("this input; it chooses from a label volume"),
        }
    }

    fn of_kind(kind: Kind, path: &Path, options: &ReadOptions) -> Result<Self> {
        let input = unchecked(kind, path, options).map_err(|e| e.in_file(path))?;
        input.stack.validate().map_err(|e| e.in_file(path))?;
        Ok(input)
    }

    /// Slices of a volume whose header was read.
    ///
    /// # Errors
    /// The errors of [`read`].
    pub fn of_volume(volume: Volume, options: &ReadOptions) -> Result<Self> {
        let path = volume.path.clone();
        let input = cut(volume, options).map_err(|e| e.in_file(&path))?;
        input.stack.validate().map_err(|e| e.in_file(&path))?;
        Ok(input)
    }

    /// Doubts that a person should know before the stack becomes one body.
    pub fn doubts(&self, options: &ReadOptions) -> Vec<String> {
        let mut doubts = self.notes.clone();
        doubts.extend(self.united(options));
        let chosen = options.keep.is_some() || options.slices.is_some() || options.level.is_some();
        let hole = self.surveyed.as_ref().filter(|_| !chosen).and_then(|surveyed| {
            let painted = &surveyed.survey.painted[surveyed.axis.axis];
            let numbers: Vec<usize> = (0..painted.len()).filter(|&k| painted[k]).collect();
            let given = Given::new(&vec![true; numbers.len()], &numbers, Completeness::Own);
            hole("the body", &given.holes)
        });
        let undrawn = hole.as_ref().and_then(|_| self.stack.undrawn());
        let of_stack = self.stack.doubts_of_union(self.interpolates(options)).into_iter();
        doubts.extend(of_stack.filter(|doubt| Some(doubt) != undrawn.as_ref()));
        doubts.extend(hole);
        doubts.extend(self.surveyed.as_ref().zip(options.keep).and_then(|(surveyed, keep)| surveyed.missed(keep)));
        doubts
    }

    /// Whether labels are interpolated to slices of others.
    fn interpolates(&self, options: &ReadOptions) -> bool {
        let Some(surveyed) = self.surveyed.as_ref().filter(|_| are_united_whole(options)) else { return false };
        let (numbers, members) = surveyed.members(options);
        let z = surveyed.heights(&numbers);
        members.iter().any(|(_, member)| !member.between(&z).is_empty())
    }

    /// Labels that are interpolated to slices of others before they become one with them; none where slices are chosen, which are complete.
    ///
    /// # Errors
    /// The errors of [`read`].
    pub fn interpolated(&self, options: &ReadOptions) -> Result<Vec<InterpolatedMember>> {
        let Some(surveyed) = self.surveyed.as_ref().filter(|_| are_united_whole(options)) else {
            return Ok(Vec::new());
        };
        let (numbers, members) = surveyed.members(options);
        let z = surveyed.heights(&numbers);
        let mut interpolated = Vec::new();
        for (label, member) in members {
            let slices = member.between(&z);
            if slices.is_empty() {
                continue;
            }
            let own = member.places().into_iter().map(|k| numbers[k]).collect();
            let options = ReadOptions {
                label: Some(LabelName::Number(label)),
                slices: Some(own),
                axis: [Axis::X, Axis::Y, Axis::Z][surveyed.axis.axis],
                ..options.clone()
            };
            let stack = Input::of_volume(surveyed.volume.clone(), &options)?.stack;
            interpolated.push(InterpolatedMember { name: member.name, stack, slices });
        }
        Ok(interpolated)
    }

    /// Words about labels that become one body although nobody has chosen them.
    fn united(&self, options: &ReadOptions) -> Option<String> {
        let labels = &self.surveyed.as_ref()?.survey.labels;
        let several = labels.len() > 1 && options.label.is_none() && options.level.is_none();
        several.then(|| {
            let unlike = self.surveyed.as_ref().and_then(|surveyed| surveyed.unlike(options));
            let unlike = unlike.map_or(String::new(), |unlike| format!("; {unlike}"));
            format!(
                "its {} labels become one body, their union; `labels` = all keeps them apart, `label` = NUMBER takes one{unlike}",
                labels.len()
            )
        })
    }
}

/// Whether all labels become one body, each on the slices on which it is painted: chosen slices are complete.
fn are_united_whole(options: &ReadOptions) -> bool {
    let chosen = options.keep.is_some() || options.slices.is_some();
    !chosen && options.label.is_none() && options.level.is_none()
}

/// A label volume as it was read.
#[derive(Debug, Clone)]
pub struct Surveyed {
    /// The volume.
    pub volume: Volume,
    /// Survey of its content.
    pub survey: Survey,
    /// Across which axis it was cut.
    pub axis: axis::Choice,
    /// The label that was wanted.
    pub label: Option<i64>,
}

impl Surveyed {
    /// Distance of neighbouring slices.
    pub fn thickness(&self) -> f64 {
        self.volume.grid.spacing()[self.axis.axis]
    }

    /// Words where labels that become one body are painted on unlike slices of those that `options` take.
    fn unlike(&self, options: &ReadOptions) -> Option<String> {
        let (numbers, members) = self.members(options);
        let members: Vec<Member> = members.into_iter().map(|(_, member)| member).collect();
        let is_complete = options.keep.is_some() || options.slices.is_some();
        let words = ["slices", "`labels` = all interpolates each by itself"];
        drawn_on_slices_of_others(&members, &self.heights(&numbers), !is_complete, words)
    }

    /// Numbers of the painted slices that `options` take, and which label is on which of them.
    fn members(&self, options: &ReadOptions) -> (Vec<usize>, Vec<(i64, Member)>) {
        let painted = &self.survey.painted[self.axis.axis];
        let asked = |k: &usize| options.slices.as_ref().is_none_or(|list| list.contains(k));
        let kept = |k: &usize| options.keep.is_none_or(|keep| keep == 0 || k.is_multiple_of(keep));
        let taken: Vec<usize> = (0..painted.len()).filter(|k| painted[*k] && asked(k) && kept(k)).collect();
        let member = |(label, slices): (&i64, &[Vec<bool>; 3])| {
            let drawn = taken.iter().map(|k| slices[self.axis.axis][*k]).collect();
            (*label, Member { name: format!("label {label}"), drawn })
        };
        let members = self.survey.slices.iter().map(member).collect();
        (taken, members)
    }

    /// Heights of the slices with these numbers.
    fn heights(&self, numbers: &[usize]) -> Vec<f64> {
        numbers.iter().map(|&k| k as f64 * self.thickness()).collect()
    }

    /// Words where painted slices stand alone and every `keep`-th slice is no choice among these: it takes empty ones between them.
    fn missed(&self, keep: usize) -> Option<String> {
        let painted = &self.survey.painted[self.axis.axis];
        let numbers: Vec<usize> = (0..painted.len()).filter(|&k| painted[k]).collect();
        let (&first, &last) = (numbers.first()?, numbers.last()?);
        let apart = numbers.windows(2).filter(|pair| pair[1] - pair[0] > 1).count();
        let left = numbers.iter().filter(|number| *number % keep > 0).count();
        let empty = (first..last).filter(|k| k % keep == 0 && !painted[*k]).count();
        (2 * apart > numbers.len() && left > 0 && empty > 0).then(|| {
            format!(
                "`keep` takes every slice whose number is a multiple of {keep}, painted or not: {empty} of them between the first and the last painted \
                 one are empty, so that the body is not there, and {left} of {} painted ones are left out; without `keep` the painted ones are found",
                numbers.len()
            )
        })
    }

    /// Voxels of a mask as the volume's are: of its type, with the label that is wanted, the only one there is, or 1. None of grey values.
    pub fn paint(&self) -> Option<Paint> {
        let mut labels = self.survey.labels.keys();
        let only = labels.next().filter(|_| labels.next().is_none() && !self.survey.more);
        let label = self.label.or(only.copied()).unwrap_or(1);
        self.survey.greys.is_none().then(|| Paint::holding(self.volume.element.scalar(), label))
    }

    /// Name and colour of the body: of the label that is wanted, or of the only one, where the file says them.
    pub fn appearance(&self) -> Option<Appearance> {
        let mut labels = self.survey.labels.keys();
        let only = labels.next().filter(|_| labels.next().is_none());
        self.volume.segments.get(&self.label.or(only.copied())?).cloned()
    }
}

/// Reads a stack, and says what was found if it is a volume.
///
/// # Errors
/// The errors of [`read`].
pub fn read_surveyed(path: &Path, options: &ReadOptions) -> Result<(ContourStack, Option<Surveyed>)> {
    Input::read(path, options).map(|input| (input.stack, input.surveyed))
}

/// Note on a file without spacing.
const UNSPACED: &str =
    "nothing says how large voxels are: they count as cubes of 1 px; --spacing DX,DY,DZ says their sides (mm)";

/// Input as the readers give it, unchecked.
fn unchecked(kind: Kind, path: &Path, options: &ReadOptions) -> Result<Input> {
    Ok(match kind {
        Kind::Folder => {
            let mut input = folder::read(path, options)?;
            input.notes.extend(input.stack.inside_out(options.invert));
            input
        }
        Kind::Volume(header) => {
            let mut volume = header(path)?;
            if let Some(sides) = &options.spacing {
                volume = volume.with_spacing(sides)?;
            }
            match volume.lacks.clone() {
                Some(Lacking::Needed(message)) => return Err(Error::Format { path: path.into(), message }),
                Some(Lacking::Assumed(message)) => volume.notes.push(message),
                None if volume.grid.is_assumed() => volume.notes.push(UNSPACED.into()),
                None => {}
            }
            cut(volume, options)?
        }
        #[cfg(feature = "dicom")]
        Kind::StructureSet => Input::of(crate::rtstruct::read(path, options)?),
        #[cfg(not(feature = "dicom"))]
        Kind::StructureSet => {
            let message = "is DICOM, which this program was built without (feature `dicom`)".into();
            return Err(Error::Format { path: path.into(), message });
        }
        #[cfg(feature = "terrain")]
        Kind::Map => Input::of(crate::terrain::Terrain::read(path, options)?.stack),
        #[cfg(not(feature = "terrain"))]
        Kind::Map => {
            let message = "is a contour map, which this program was built without (feature `terrain`)".into();
            return Err(Error::Format { path: path.into(), message });
        }
    })
}

/// The slices of a volume, unchecked.
fn cut(mut volume: Volume, options: &ReadOptions) -> Result<Input> {
    if options.invert && options.level.is_none() {
        let message = "is not for labels; with `level` it is for grey values".into();
        return Err(Error::Setting { name: "invert".into(), message });
    }
    let label = options.label.as_ref().map(|name| volume.label(name, "label")).transpose()?;
    if let Some(label) = label {
        volume.take_only(&[label]);
    }
    let survey = match options.cut() {
        Some(cut) => Survey::inside(&volume, cut)?,
        None => Survey::of(&volume, label)?,
    };
    let chosen = options.keep.is_some() || options.slices.is_some();
    let wrong = match label {
        None => survey.grey(),
        Some(_) => None,
    };
    if let Some(message) = wrong.or_else(|| survey.sheets.crossing().filter(|_| !chosen)) {
        return Err(Error::Format { path: volume.path.clone(), message });
    }
    let axis = axis::choose(options.axis, &volume.grid, &survey);
    let stack = slices::stack(&volume, &survey, &axis, options, label)?;
    let doubts = stack.inside_out(options.invert).into_iter().chain(axis.doubt.clone());
    let notes = volume.notes.iter().cloned().chain(doubts).collect();
    Ok(Input { notes, surveyed: Some(Surveyed { volume, survey, axis, label }), ..Input::of(stack) })
}

/// Reads a stack from any input that `docs/formats.md` lists: folders, volumes, RTSTRUCT, polygons, contour maps.
///
/// # Errors
/// [`Error::Read`], [`Error::Format`], [`Error::Slice`] or [`Error::Setting`], naming file, slice and value.
pub fn read(path: &Path, options: &ReadOptions) -> Result<ContourStack> {
    read_surveyed(path, options).map(|(stack, _)| stack)
}
