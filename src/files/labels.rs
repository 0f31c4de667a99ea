//! Jobs with many labels: a label volume becomes the label volume between its slices, and a mesh per label.
//!
//! Files that hold one label have its number before the extension: `out.stl` becomes `out.5.stl`, `out.nii.gz` `out.5.nii.gz`. A `.glb` holds all.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::JobOptions;
use super::format::{Format, Kind, kind, of_report};
use super::member_names::with_word;
use super::options::OutputOptions;
use super::outputs::Outputs;
use super::pending::{Pending, Temporary};
use super::places::Places;
use super::provenance::Source;
use super::scenes::Scenes;
use crate::backend::Means;
use crate::error::{Error, Result};
use crate::estimate::memory::MemoryNeeds;
use crate::estimate::runtime::Effort;
use crate::input::labels::{Wanted, read_labels, read_whole_labels};
use crate::labels::report::{LabelReport, LabelsReport};
use crate::labels::{DecidedLabels, KeptBody, LabelStack, Plan, decide, reconstruct, requirements};
use crate::report::Report;
use crate::settings::Settings;
use crate::stack::heights::missed;
use crate::storage::room::check_temporary;
use crate::surface::content::{Paint, Scalar};

/// Options for many labels.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Input")]
pub struct LabelOptions {
    /// Label volumes, and folders of label images: reconstruct these labels, by number or name, or all, into one label volume and a mesh per label (out.stl
    /// becomes out.N.stl)
    #[arg(long, value_name = "all|N,NAME,..", allow_hyphen_values = true, conflicts_with = "label")]
    pub labels: Option<Wanted>,

    /// Each label into volumes and meshes of its own, as it is alone, overlaps and all
    // One label conflicts with what is required here, and clap then requires nothing.
    #[arg(long, requires = "labels", conflicts_with = "label", help_heading = "Output")]
    pub keep_overlaps: bool,
}

/// A label volume that was read, and how it is to be reconstructed.
#[derive(Debug)]
pub struct LoadedLabels {
    /// The drawn slices.
    pub stack: LabelStack,
    heights: Vec<f64>,
    options: JobOptions,
    keep_overlaps: bool,
    numbers: Scalar,
    source: Source,
}

impl LoadedLabels {
    /// Checks the options and reads the input.
    ///
    /// # Errors
    /// The errors of [`JobOptions::check`] and [`read_labels`]; [`Error::Setting`] for options that are not for many labels.
    pub fn read(input: &Path, wanted: &Wanted, keep_overlaps: bool, options: JobOptions) -> Result<Self> {
        options.check()?;
        let mut options = options;
        let source =
            Source::of(input, &options)?.with("labels", wanted.to_string()).with("keep_overlaps", keep_overlaps);
        options.output.look()?;
        let fail = |name: &str, message: String| Err(Error::Setting { name: name.into(), message });
        if options.links != crate::stack::links::LinkOptions::default() {
            return fail("links", "are not for many labels: parts are numbered in each by itself".into());
        }
        if options.output.mask && !keep_overlaps {
            return fail("mask", "is not for many labels: their volume has the labels' numbers".into());
        }
        let read = if keep_overlaps { read_whole_labels } else { read_labels };
        let mut stack = read(input, &options.read, wanted)?;
        stack.notes.extend(options.output.doubts(&stack.stack));
        let [least, most] = stack.range();
        if options.output.distance && !keep_overlaps {
            return fail("distance", "is not for many labels: their volume has the labels' numbers".into());
        }
        let limit = Scalar::MOST_LABEL;
        if least < -limit || most > limit {
            return fail("labels", format!("must lie within {limit} either side of 0; got {least} to {most}"));
        }
        let numbers = stack.scalar.or_wider(least.min(0), most.max(0));
        options.output.check_unit(&stack.stack.unit)?;
        let heights = options.output.heights(&stack.stack, &options.settings)?;
        stack.tell_singles(&heights);
        let missed = |stack: &LabelStack, a: usize| {
            let (z, has_ended) = stack.slices_of(a);
            missed(&heights, &z, has_ended, &options.settings)
        };
        match wanted {
            Wanted::All => {
                stack.leave_out(missed);
                stack.some_are_left().map_err(|message| Error::Format { path: input.into(), message })?;
            }
            Wanted::These(_) | Wanted::Text(_) => {
                let first = stack.labels.iter().enumerate().find_map(|(a, label)| Some((label, missed(&stack, a)?)));
                if let Some((label, message)) = first {
                    return Err(Error::Stack(format!("label {label}: {message}")));
                }
            }
        }
        Ok(LoadedLabels { stack, heights, options, keep_overlaps, numbers, source })
    }

    /// Heights of the output layers.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// What their reconstructions take.
    pub fn requirements(&self) -> (MemoryNeeds, Effort) {
        requirements(&self.stack, !self.keep_overlaps, &self.heights, &self.options.settings)
    }

    /// Bytes of memory beside the reconstructions: of their outputs, and of a backend.
    pub fn beside(&self, outputs: &LabelOutputs, backend: u64) -> u64 {
        let has_mesh = outputs.labels.iter().any(Outputs::has_mesh);
        let simplifying =
            if has_mesh { self.options.output.bytes_to_simplify(&self.stack.stack, &self.heights) } else { 0 };
        outputs.bytes(&self.stack) + simplifying + backend
    }

    /// Reconstructs all labels and writes them into `outputs`, under temporary names.
    ///
    /// # Errors
    /// The errors of [`reconstruct`] and [`decide`]; [`Error::Write`].
    pub fn compute(&self, means: &Means<'_>, memory: Option<u64>, outputs: &mut LabelOutputs) -> Result<LabelsReport> {
        let start = Instant::now();
        let folder = std::env::temp_dir();
        check_temporary(&folder)?;
        let plan = Plan {
            heights: &self.heights,
            settings: &self.options.settings,
            folder: &folder,
            beside: self.beside(outputs, means.backend.host_bytes()),
            memory,
        };
        let bodies = reconstruct(&self.stack, !self.keep_overlaps, &plan, means)?;
        let count = self.stack.labels.len();
        let mut warnings = Vec::new();
        let (decided, borders) = if self.keep_overlaps {
            let decided = DecidedLabels { bodies: bodies.alone, ..DecidedLabels::none(count) };
            (decided, None)
        } else {
            let mut volume = outputs.volume.label_sink(self.numbers, &self.stack.shown(), &self.options.output);
            let decided = decide(&self.stack, bodies, &plan, &mut volume)?;
            drop(volume);
            let mut report = Report::default();
            outputs.volume.complete(&mut report)?;
            warnings = report.warnings;
            let borders = decided.borders.clone();
            (decided, Some(borders))
        };
        let decides = borders.is_some();
        let mut labels = Vec::new();
        for (a, mut body) in decided.bodies.into_iter().enumerate() {
            let mut run = std::mem::take(&mut body.report);
            self.write(a, &mut body, &mut run, &mut outputs.labels[a])?;
            let differing: usize = run.contours.iter().map(|c| c.differing_pixels).sum();
            let mut report = LabelReport {
                label: self.stack.labels[a],
                changed: decided.changed[a],
                voxels: decides.then_some(decided.voxels[a]),
                differing_pixels: differing as u64 + decided.differing[a],
                volume: run.volume.take(),
                area: run.area.take(),
                areas: run.areas.take(),
                run,
            };
            report.run.warnings.extend(decides.then(|| report.overruled()).flatten());
            labels.push(report);
        }
        if let Some(scenes) = &mut outputs.scenes {
            scenes.complete()?;
        }
        let version = env!("CARGO_PKG_VERSION").into();
        let seconds = start.elapsed().as_secs_f64();
        let LabelStack { left_out, reading, notes, .. } = &self.stack;
        let (left_out, reading) = (left_out.clone(), reading.clone());
        let warnings = notes.iter().cloned().chain(warnings).collect();
        let backend = means.backend.name();
        let provenance = match outputs.reports.is_empty() {
            true => None,
            false => Some(self.source.provenance(&self.stack.appearances)?),
        };
        Ok(LabelsReport { version, provenance, backend, labels, left_out, reading, warnings, borders, seconds })
    }

    /// Label `a` into its own files and the scene; its volume and area into the report.
    fn write(&self, a: usize, body: &mut KeptBody, report: &mut Report, outputs: &mut Outputs) -> Result<()> {
        let bodies = vec![self.stack.appearances[a].clone()];
        let paint = Some(Paint::holding(self.stack.scalar, self.stack.labels[a]));
        body.replay(&mut outputs.sink(&OutputOptions { bodies, paint, ..self.options.output.clone() }))?;
        outputs.complete(report)?;
        if report.volume.is_none() { body.measure(report) } else { Ok(()) }
    }
}

/// Fills a label volume and writes files: labels drawn on some slices become a label volume on all, meshes one per label, a report; formats by extension.
///
/// # Errors
/// [`Error::Setting`] for a setting out of its range, [`Error::Read`] or [`Error::Format`] for the input, [`Error::Output`] for a name that
/// cannot be written, before anything is computed; then as [`reconstruct_into`](crate::reconstruct_into), and [`Error::Write`].
pub fn fill_labels(
    input: &Path,
    outputs: &[PathBuf],
    wanted: &Wanted,
    settings: &Settings,
    means: &Means<'_>,
) -> Result<LabelsReport> {
    let options = JobOptions { settings: settings.clone(), ..JobOptions::default() };
    let mut places = Places::of(input, &options)?;
    let loaded = LoadedLabels::read(input, wanted, false, options)?;
    let mut outputs = LabelOutputs::open(outputs, None, &loaded, &mut places)?;
    let report = loaded.compute(means, None, &mut outputs)?;
    outputs.finish(&report)?;
    Ok(report)
}

/// Open outputs of many labels.
pub struct LabelOutputs {
    /// Label volumes.
    volume: Outputs,
    /// The files of each label.
    labels: Vec<Outputs>,
    /// All labels in one file.
    scenes: Option<Scenes>,
    reports: Vec<(PathBuf, Pending)>,
}

impl LabelOutputs {
    /// Opens all outputs under temporary names.
    ///
    /// # Errors
    /// [`Error::Output`] for a name that cannot be written, or is that of an input or another output.
    pub fn open(paths: &[PathBuf], report: Option<&Path>, loaded: &LoadedLabels, places: &mut Places) -> Result<Self> {
        let (mut volumes, mut own, mut scenes, mut reports) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let of_one = |path: &Path| {
            let message =
                "pictures, pages, height maps, contours, origin and confidence are of one body; `--label N` makes one";
            Err(Error::Output { path: path.into(), message: message.into() })
        };
        for path in paths {
            match kind(path)? {
                Kind::Volume if !loaded.keep_overlaps => volumes.push(path.clone()),
                Kind::Mesh if Scenes::has(path) => scenes.push(path.clone()),
                Kind::Volume | Kind::Mesh => own.push(path.as_path()),
                Kind::Report => reports.push(path.clone()),
                Kind::View => return of_one(path),
            }
        }
        if let Some((page, Format::Html)) = report.map(|path| Ok((path, of_report(path)?))).transpose()? {
            return of_one(page);
        }
        reports.extend(report.map(Path::to_path_buf));
        let of_label = |label: &i64| own.iter().map(|path| with_word(path, &label.to_string())).collect::<Vec<_>>();
        let labels: Vec<Vec<PathBuf>> = loaded.stack.labels.iter().map(of_label).collect();
        let scenes = Scenes::open(&scenes, places)?;
        let mut open = |paths: &[PathBuf]| Outputs::open(paths, None, Temporary::Random, places);
        let volume = open(&volumes)?;
        let labels = labels.iter().map(|paths| Ok(open(paths)?.with_scene(scenes.as_ref()))).collect::<Result<_>>()?;
        let reports = reports.into_iter().map(|path| {
            let pending = Pending::open(&path, false, Temporary::Random, places)?;
            Ok((path, pending))
        });
        let reports = reports.collect::<Result<_>>()?;
        Ok(LabelOutputs { volume, labels, scenes, reports })
    }

    /// The outputs, by their names.
    pub fn targets(&self) -> impl Iterator<Item = &Path> {
        let each = self.labels.iter().flat_map(Outputs::targets);
        let scenes = self.scenes.iter().flat_map(Scenes::targets);
        self.volume.targets().chain(each).chain(scenes).chain(self.reports.iter().map(|(path, _)| path.as_path()))
    }

    /// Bytes of memory that writing needs at most: labels are written one by one.
    fn bytes(&self, stack: &LabelStack) -> u64 {
        let (dims, geometry, lid) = (stack.stack.dims, &stack.stack.geometry, stack.stack.lid());
        let labels = self.labels.iter().map(|o| o.bytes(dims, geometry, lid)).max();
        self.volume.bytes(dims, geometry, lid) + labels.unwrap_or(0)
    }

    /// Writes the report and gives everything its name.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn finish(self, report: &LabelsReport) -> Result<Vec<PathBuf>> {
        for (path, pending) in &self.reports {
            pending.write_json(report).map_err(|source| Error::Write { path: path.clone(), source })?;
        }
        let mut written = self.volume.rename()?;
        for label in self.labels {
            written.extend(label.rename()?);
        }
        if let Some(scenes) = self.scenes {
            written.extend(scenes.rename()?);
        }
        for (path, pending) in self.reports {
            pending.rename().map_err(|source| Error::Write { path: path.clone(), source })?;
            written.push(path);
        }
        Ok(written)
    }
}
