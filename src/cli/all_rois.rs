//! `--all-rois`: every ROI of an RTSTRUCT that can be reconstructed, each to files of its own, and all to one `.glb` and one completed RTSTRUCT.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use interslice::files::member_names::{with_word, words};
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::scenes::Scenes;
use interslice::files::{JobOptions, Loaded};
use interslice::input::check;
use interslice::rtstruct::{Gather, StructureSet};
use interslice::stack::options::RoiName;
use interslice::{Error, Result};

use super::devices::DeviceOptions;
use super::forecast::{forecast, would_write};
use super::members::usable_rois;
use super::say::say;
use super::session::{Telling, chosen, complete, compute, tell_notes, tell_nothing_added, tell_start};

/// Work to be done with a structure set.
pub struct All<'a> {
    pub input: &'a Path,
    pub outputs: &'a [PathBuf],
    pub report: Option<&'a Path>,
    pub options: JobOptions,
    pub device: &'a DeviceOptions,
    pub telling: Telling,
}

/// Reconstructs one ROI after the other. Nothing gets its name before everything is complete.
pub fn run(all: &All<'_>) -> Result<()> {
    check(all.input, &all.options.read)?;
    let set = Arc::new(StructureSet::choose_file(all.input, all.options.read.series.as_deref())?);
    let mut all_options = all.options.clone();
    all_options.output.look()?;
    let rois = usable_rois(&set, all.input, &all.options.read, &|message: &str| tell(all, message))?;
    let is_set = |path: &&PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"));
    let completed: Vec<PathBuf> = all.outputs.iter().filter(is_set).cloned().collect();
    let (scenes, each): (Vec<PathBuf>, Vec<PathBuf>) =
        all.outputs.iter().filter(|p| !is_set(p)).cloned().partition(|path| Scenes::has(path));
    let mut places = Places::of(all.input, &all.options)?;
    let completed = Outputs::open(&completed, None, Temporary::Random, &mut places)?;
    let mut scenes = Scenes::open(&scenes, &mut places)?;
    let mut files = Vec::new();
    for word in words(rois.iter().map(|roi| (roi.name.as_str(), roi.number))) {
        let outputs: Vec<PathBuf> = each.iter().map(|path| with_word(path, &word)).collect();
        let report = all.report.map(|path| with_word(path, &word));
        let outputs = Outputs::open(&outputs, report.as_deref(), Temporary::Random, &mut places)?;
        files.push(outputs.with_scene(scenes.as_ref()));
    }
    let mut chosen = chosen(all.device)?;
    let mut said = None;
    let mut added = Vec::new();
    for (roi, outputs) in rois.iter().zip(&mut files) {
        let mut options = all_options.clone();
        options.read.roi = vec![RoiName::Number(roi.number)];
        let loaded = Loaded::of_structures(&set, options)?;
        completed.check(&loaded.options.output)?;
        let (dims, geometry, lid) = (loaded.stack.dims, &loaded.stack.geometry, loaded.stack.lid());
        let simplifying = loaded.needs_to_simplify(outputs.has_mesh());
        let writing = outputs.bytes(dims, geometry, lid) + completed.bytes(dims, geometry, lid) + simplifying;
        let budget = chosen.budget(&loaded.needs(), writing, all.device.memory())?;
        if all.telling != Telling::DryRun {
            tell(all, &roi.label());
        }
        if said.as_ref() != Some(&chosen.reason) {
            tell_start(&chosen, &budget, all.telling);
            said = Some(chosen.reason.clone());
        }
        tell_notes(&loaded, all.telling);
        let source = loaded.options.output.source.as_ref().ok_or_else(|| {
            let message = "an RTSTRUCT is needed for --all-rois".into();
            Error::Format { path: all.input.into(), message }
        })?;
        let is_whole = completed.has_structures() && source.is_on_every_image()?;
        if is_whole {
            let why =
                "it is drawn on all the planes that others of the file have, and on those between; --dz adds more";
            tell(all, &format!("no plane is added to {}: {why}", roi.label()));
        } else if completed.has_structures() {
            tell_nothing_added(&loaded, all.telling)?;
        }
        if all.telling == Telling::DryRun {
            let forecast = forecast(&loaded, outputs, chosen.beside(writing))?;
            say(&format!("{}:\n{forecast}\n", roi.label()))?;
            continue;
        }
        let mut gather = Gather::new(source, outputs.sink(&loaded.options.output));
        let mut body = compute(&loaded, &mut gather, &chosen, &budget, all.telling)?;
        added.extend(gather.added().filter(|_| !is_whole));
        complete(outputs, &mut body, &loaded, all.telling)?;
        chosen.tell(&body.report.profile);
    }
    if all.telling == Telling::DryRun {
        let of_all = completed.targets().chain(scenes.iter().flat_map(Scenes::targets));
        return of_all.map(would_write).try_for_each(|line| say(&(line + ", with all of them\n")));
    }
    completed.complete_structures(&set, &added)?;
    if let Some(scenes) = &mut scenes {
        scenes.complete()?;
    }
    let mut written = Vec::new();
    for outputs in files.into_iter().chain([completed]) {
        written.extend(outputs.rename()?);
    }
    if let Some(scenes) = scenes {
        written.extend(scenes.rename()?);
    }
    written.iter().for_each(|path| tell(all, &format!("wrote {}", path.display())));
    Ok(())
}

fn tell(all: &All<'_>, message: &str) {
    if all.telling != Telling::Quiet {
        tell!("{message}");
    }
}
