//! Jobs from files to files: one reconstruction, as the command line or a line of a manifest asks for it.
//!
//! ```text
//! Loaded::read -> Loaded::compute (into Outputs::sink) -> Outputs::complete -> Outputs::rename
//! ```

pub mod fingerprint;
pub mod format;
pub mod labels;
pub mod like;
mod lock;
pub mod member_names;
pub mod named;
pub mod options;
pub mod outputs;
pub mod pending;
pub mod places;
pub mod preview;
pub mod provenance;
pub mod scenes;
pub mod section_file;
mod union;
pub mod write;
mod writers;

use std::path::{Path, PathBuf};
#[cfg(feature = "dicom")]
use std::sync::Arc;

use serde::Serialize;

use crate::backend::Means;
use crate::error::{Error, Result};
use crate::estimate::memory::MemoryNeeds;
use crate::input;
use crate::pipeline::section::Section;
use crate::reconstruct::{reconstruct_into, reconstruct_section};
use crate::report::Provenance;
#[cfg(feature = "dicom")]
use crate::rtstruct::{ReferencedSet, StructureSet};
use crate::settings::Settings;
use crate::stack::heights::{Heights, passed_over};
use crate::stack::links::LinkOptions;
use crate::stack::members::InterpolatedMember;
use crate::stack::{ContourStack, HeightGrid, ReadOptions};
use crate::surface::Reconstruction;
#[cfg(feature = "terrain")]
use crate::surface::crs::Crs;
use crate::surface::header::Header;
use crate::surface::stream::LayerSink;
use options::OutputOptions;
use outputs::Outputs;
use provenance::Source;

/// Largest height of an extrapolated end of a contour map, gaps, where none is asked for: where the next level was not drawn, the terrain does not get there.
#[cfg(feature = "terrain")]
const MAP_CAP_GAPS: f64 = 1.0;

/// All that decides a result besides its input.
#[derive(Debug, Clone, Default, Serialize)]
pub struct JobOptions {
    /// Options of reading.
    pub read: ReadOptions,
    /// Links between its parts; the file's content counts, not its name.
    #[serde(skip)]
    pub links: LinkOptions,
    /// Settings of the reconstruction.
    pub settings: Settings,
    /// Options of the outputs.
    pub output: OutputOptions,
    /// The file that some of this was read from.
    #[serde(skip)]
    pub settings_file: Option<PathBuf>,
}

impl JobOptions {
    /// The files whose content decides the result: those of the input, as its reader says them, and the links file.
    ///
    /// # Errors
    /// [`Error::Read`](crate::Error::Read) or [`Error::Format`](crate::Error::Format) where the input does not say what it consists of.
    pub fn files(&self, input: &Path) -> Result<Vec<PathBuf>> {
        let like = self.output.like.as_deref().map(like::Like::files).transpose()?.unwrap_or_default();
        let own = match self.structure_sets(input) {
            Some(sets) => sets?,
            None => input::files(input)?,
        };
        Ok(own.into_iter().chain(self.links.links.clone()).chain(like).collect())
    }

    /// The structure sets of an input that is a folder of them.
    #[cfg(feature = "dicom")]
    fn structure_sets(&self, input: &Path) -> Option<Result<Vec<PathBuf>>> {
        let is_folder = input.is_dir() && input::is_structure_set(input);
        is_folder.then(|| crate::rtstruct::read_of(input, self.read.series.as_deref()))
    }

    #[cfg(not(feature = "dicom"))]
    fn structure_sets(&self, _: &Path) -> Option<Result<Vec<PathBuf>>> {
        None
    }

    /// Checks every range.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) with name, range and value.
    pub fn check(&self) -> Result<()> {
        self.settings.validate()?;
        self.output.check_ranges()
    }
}

/// A stack that was read, and how it is to be reconstructed.
#[derive(Debug)]
pub struct Loaded {
    /// The checked stack.
    pub stack: ContourStack,
    /// Members of it that are interpolated to slices of others, see [`Loaded::completed`].
    pub interpolated: Vec<InterpolatedMember>,
    /// Output heights.
    pub heights: Vec<f64>,
    /// Options of the job.
    pub options: JobOptions,
    /// Notes on the input for a person; the report's first warnings.
    pub notes: Vec<String>,
    /// Input and options as they were given; none of a stack that no file holds.
    pub source: Option<Source>,
}

impl Loaded {
    /// Checks the options and reads the input.
    ///
    /// # Errors
    /// The errors of [`JobOptions::check`], [`input::read`] and [`LinkOptions::read`].
    pub fn read(input: &Path, mut options: JobOptions) -> Result<Self> {
        options.check()?;
        let source = Source::of(input, &options)?;
        options.output.look()?;
        #[cfg(feature = "terrain")]
        if input::is_map(input) {
            return Ok(Loaded { source: Some(source), ..Self::map(input, options)? });
        }
        #[cfg(feature = "dicom")]
        if input::is_structure_set(input) {
            input::check(input, &options.read)?;
            let set = Arc::new(StructureSet::choose_file(input, options.read.series.as_deref())?);
            return Self::of_structures(&set, options);
        }
        let input = input::Input::read(input, &options.read)?;
        let notes = input.doubts(&options.read);
        let interpolated = input.interpolated(&options.read)?;
        let input::Input { stack, surveyed, .. } = input;
        options.output.paint = surveyed.as_ref().and_then(input::Surveyed::paint);
        options.output.bodies = surveyed.iter().filter_map(|s| s.appearance()).collect();
        options.settings.links = options.links.read(&stack)?;
        options.settings.validate()?;
        Ok(Loaded { source: Some(source), ..Self::new(stack, options)?.noted(notes).with(interpolated)? })
    }

    /// What a report says of its making; nothing of a stack that no file holds.
    ///
    /// # Errors
    /// The errors of [`Source::provenance`].
    pub fn provenance(&self) -> Result<Option<Provenance>> {
        self.source.as_ref().map(|source| source.provenance(&self.options.output.bodies)).transpose()
    }

    /// Loads ROIs of an RTSTRUCT that was read; it is kept for the completed file.
    ///
    /// # Errors
    /// The errors of [`Loaded::read`].
    #[cfg(feature = "dicom")]
    pub fn of_structures(set: &Arc<StructureSet>, mut options: JobOptions) -> Result<Self> {
        options.check()?;
        let given = Source::of(&set.path, &options)?;
        options.output.look()?;
        let mut source = ReferencedSet::new(set, &options.read)?;
        let stack = source.stack()?;
        options.settings.links = options.links.read(&stack)?;
        options.settings.validate()?;
        let (steps, notes) = source.about(&stack)?;
        let interpolated = source.interpolated(&stack)?;
        if let Some(images) = options.output.target.as_ref().and_then(|like| like.series.as_ref()) {
            source.refer_to(images)?;
        } else if options.output.dz.is_none() && !options.output.isotropic && options.output.target.is_none() {
            options.output.dz = steps.map(|s| s.heights);
            source.every = steps.map(|s| s.planes);
        }
        options.output.bodies = vec![source.appearance()?];
        options.output.source = Some(Arc::new(source));
        Ok(Loaded { source: Some(given), ..Self::new(stack, options)?.noted(notes).with(interpolated)? })
    }

    /// Why the completed RTSTRUCT gets no contours; nothing where it gets some, or no RTSTRUCT was read.
    ///
    /// # Errors
    /// The errors of [`StructureSet::choose`].
    #[cfg(feature = "dicom")]
    pub fn adds_nothing(&self) -> Result<Option<String>> {
        let source = self.options.output.source.as_ref();
        Ok(source.map(|source| source.adds_nothing(&self.heights, self.grid().step)).transpose()?.flatten())
    }

    /// Loads a contour map.
    #[cfg(feature = "terrain")]
    fn map(input: &Path, mut options: JobOptions) -> Result<Self> {
        input::check(input, &options.read)?;
        let terrain = crate::terrain::Terrain::read(input, &options.read)?;
        options.settings.links = options.links.read(&terrain.stack)?;
        options.settings.validate()?;
        options.output.dz = options.output.dz.or(terrain.step());
        let like = options.output.target.as_ref().map(|like| &like.crs);
        if let Some(crs) = like.filter(|crs| **crs != Crs::Unknown && **crs != terrain.map.crs) {
            let name = |crs: &Crs| match crs {
                Crs::Epsg(code) => format!("EPSG:{code}"),
                _ => "another system".into(),
            };
            let [its, own] = [crs, &terrain.map.crs].map(name);
            let what =
                if crs.is_geographic() { "warp the raster to a metric system" } else { "`crs_out` reprojects the map" };
            let message = format!("is a raster in {its}, but the map is in {own}; {what}");
            return Err(Error::Setting { name: "like".into(), message });
        }
        options.settings.cap_gaps.get_or_insert(MAP_CAP_GAPS);
        options.output.map = Some(std::sync::Arc::new(terrain.map));
        Ok(Self::new(terrain.stack, options)?.noted(terrain.notes))
    }

    /// Loads a stack that no file holds.
    ///
    /// # Errors
    /// [`Error::Stack`](crate::Error::Stack) for too many output heights; those of [`heights::check`](crate::stack::heights::check).
    pub fn new(stack: ContourStack, options: JobOptions) -> Result<Self> {
        options.output.check_unit(&stack.unit)?;
        let heights = options.output.heights(&stack, &options.settings)?;
        crate::stack::heights::check(&stack, &heights, &options.settings)?;
        let mut notes = options.output.doubts(&stack);
        notes.extend(passed_over(&stack, &options.settings));
        Ok(Loaded { stack, interpolated: Vec::new(), heights, options, notes, source: None })
    }

    /// With notes on the input before its own.
    fn noted(mut self, notes: Vec<String>) -> Self {
        self.notes.splice(0..0, notes);
        self
    }

    /// With members that are interpolated to slices of others.
    ///
    /// # Errors
    /// [`Error::Setting`] for links: they number the parts of slices as they are drawn.
    pub fn with(self, interpolated: Vec<InterpolatedMember>) -> Result<Self> {
        let completed = Loaded { interpolated, ..self };
        completed.check_links(&completed.options.settings.links)?;
        Ok(completed)
    }

    /// The grid of the output layers, of which some are contours' own.
    pub fn grid(&self) -> HeightGrid {
        let z: Vec<f64> = self.stack.slices.iter().map(|s| s.z).collect();
        let [dx, dy] = self.stack.spacing;
        let all = Heights::merged(&z, &self.heights, [z[0], z[z.len() - 1]], dx.min(dy));
        Header::grid(&all.output(), self.stack.spacing)
    }

    /// Voxels of a volume as it is written: of the grid that outputs are like where one is named, along the axes of the file, the first runs fastest.
    ///
    /// # Errors
    /// [`Error::Setting`] where slices do not lie along that grid.
    pub fn voxels(&self) -> Result<[usize; 3]> {
        let ContourStack { dims, spacing, unit, geometry, .. } = &self.stack;
        let slices = &self.stack.slices;
        let own = Header {
            dims: *dims,
            spacing: *spacing,
            unit: unit.clone(),
            geometry: *geometry,
            extent: [slices[0].z, slices[slices.len() - 1].z],
            grid: self.grid(),
        };
        let Some(like) = &self.options.output.target else { return Ok(own.voxels()) };
        let frame = like.grid.frame(geometry).map_err(|message| Error::Setting { name: "like".into(), message })?;
        Ok(frame.header(&own).voxels())
    }

    /// Needs of the reconstruction, memory and disk, without its outputs.
    pub fn needs(&self) -> MemoryNeeds {
        MemoryNeeds::of(&self.stack, &self.heights, &self.options.settings, rayon::current_num_threads())
    }

    /// Bytes of memory that making meshes simpler needs, where that is asked for; nothing where no output is a mesh.
    pub fn needs_to_simplify(&self, has_mesh: bool) -> u64 {
        if has_mesh { self.options.output.bytes_to_simplify(&self.stack, &self.heights) } else { 0 }
    }

    /// Needs of a section of it, with all slices, which have been read.
    pub fn needs_of(&self, section: &Section) -> MemoryNeeds {
        let heights = section.heights(&self.stack, &self.heights);
        let needs = MemoryNeeds::of(
            &section.stack(&self.stack),
            &heights,
            &self.options.settings,
            rayon::current_num_threads(),
        );
        needs.within(&self.stack)
    }

    /// Section `number` (from 1) of `count`.
    ///
    /// # Errors
    /// The errors of [`Section::part`].
    pub fn section(&self, number: usize, count: usize) -> Result<Section> {
        Section::part(&self.stack, &self.options.settings, number, count)
    }

    /// Reconstructs a section and hands its layers to `sink`.
    ///
    /// # Errors
    /// The errors of [`reconstruct_section`].
    pub fn compute_section(
        &self,
        section: &Section,
        means: &Means<'_>,
        sink: &mut dyn LayerSink,
    ) -> Result<Reconstruction> {
        let (stack, notes) = self.completed(&self.options.settings, means)?;
        let mut body = reconstruct_section(&stack, section, &self.heights, &self.options.settings, means, sink)?;
        body.report.warnings.splice(0..0, self.notes.iter().cloned().chain(notes));
        Ok(body)
    }

    /// Reconstructs the body and writes it into `outputs` layer by layer; the result has no layers.
    ///
    /// # Errors
    /// The errors of [`Loaded::compute_into`].
    pub fn compute(&self, means: &Means<'_>, outputs: &mut Outputs) -> Result<Reconstruction> {
        self.compute_into(means, &mut outputs.sink(&self.options.output))
    }

    /// Reconstructs the body and gives its layers to `sink`; the result has none.
    ///
    /// # Errors
    /// The errors of [`reconstruct_into`]; those of `sink`.
    pub fn compute_into(&self, means: &Means<'_>, sink: &mut dyn LayerSink) -> Result<Reconstruction> {
        let (stack, notes) = self.completed(&self.options.settings, means)?;
        let mut body = reconstruct_into(&stack, &self.heights, &self.options.settings, means, sink)?;
        body.report.warnings.splice(0..0, self.notes.iter().cloned().chain(notes));
        Ok(body)
    }
}
