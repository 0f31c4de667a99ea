//! `interslice plan`, `run` and `merge`: one reconstruction in parts, on as many machines as one likes.

use std::path::PathBuf;
use std::str::FromStr;

use clap::ArgMatches;
use interslice::files::fingerprint::fingerprint;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::section_file::{SectionWriter, Sections};
use interslice::files::{JobOptions, Loaded};
use interslice::storage::room;
use interslice::{Error, Progress, Result};
use serde::Serialize;

use super::bar::Bars;
use super::devices::{DeviceOptions, choose};
use super::job::JobArguments;
use super::members::{Member, MemberOptions};
use super::say::{say, say_exactly};
use super::session::{set_threads, tell_kept};

#[derive(Debug, clap::Args)]
pub struct PlanArguments {
    /// Parts
    #[arg(long, value_name = "N")]
    parts: usize,

    /// Print JSON
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    job: JobArguments,

    #[command(flatten)]
    members: MemberOptions,

    /// Threads of each run, for its memory [default: one per core]
    #[arg(long, value_name = "N", help_heading = "Machine")]
    threads: Option<usize>,
}

/// Part K of N.
#[derive(Debug, Clone, Copy)]
struct SplitPart {
    number: usize,
    count: usize,
}

impl FromStr for SplitPart {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        let (number, count) = parsed.ok_or_else(|| format!("must be K/N, such as 2/5; got `{text}`"))?;
        Ok(SplitPart { number, count })
    }
}

#[derive(Debug, clap::Args)]
pub struct RunArguments {
    /// File for the part, *.section, which `merge` takes
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Part K of N
    #[arg(long, value_name = "K/N")]
    part: SplitPart,

    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,

    #[command(flatten)]
    job: JobArguments,

    #[command(flatten)]
    device: DeviceOptions,

    /// Threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", help_heading = "Machine")]
    threads: Option<usize>,
}

#[derive(Debug, clap::Args)]
pub struct MergeArguments {
    /// The files of all parts, in any order
    #[arg(required = true)]
    parts: Vec<PathBuf>,

    /// Output file, as of `reconstruct`; repeatable
    #[arg(short, long = "output", value_name = "FILE", required = true)]
    outputs: Vec<PathBuf>,

    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,

    /// Volumes hold 8-bit masks of 0 and 1, as if `run` had been told
    #[arg(long, help_heading = "Output")]
    mask: bool,

    /// Volumes hold signed distances, as if `run` had been told
    #[arg(long, conflicts_with = "mask", help_heading = "Output")]
    distance: bool,

    /// Draw the input contours into pictures, as if `run` had been told
    #[arg(long, help_heading = "Output")]
    contours: bool,

    /// Meshes with fewer triangles, no farther than this from the full one
    #[arg(long, value_name = "ERROR", help_heading = "Output")]
    simplify: Option<f64>,
}

/// A part of a plan.
#[derive(Debug, Serialize)]
struct Planned {
    part: String,
    /// Intervals that it makes, from 0: first, and behind the last.
    intervals: [usize; 2],
    /// Their heights.
    z: [f64; 2],
    /// Slices that it reads.
    slices: [usize; 2],
    /// Memory that it needs at most, MiB.
    memory_mib: u64,
}

/// Parts of one of several bodies.
#[derive(Debug, Serialize)]
struct PlannedMember {
    /// "label 5 (`liver`)".
    name: String,
    /// The option that chooses it.
    option: String,
    parts: Vec<Planned>,
}

pub fn plan(arguments: PlanArguments, matches: &ArgMatches) -> Result<()> {
    let PlanArguments { job, parts, threads, json, members } = arguments;
    set_threads(threads)?;
    let input = job.input.clone();
    let options = job.options(&mut DeviceOptions::default(), matches)?;
    let to_json = |planned: serde_json::Result<String>| {
        planned
            .map_err(|e| Error::Stack(format!("the plan cannot be told: {e}")))
            .and_then(|text| say_exactly(&(text + "\n")))
    };
    let Some(members) = members.of(&input, &options.read, &|message: &str| tell!("warning: {message}"))? else {
        let loaded = Loaded::read(&input, options)?;
        let planned = planned(&loaded, parts)?;
        if json {
            return to_json(serde_json::to_string_pretty(&planned));
        }
        return say(&told(&planned, loaded.stack.slices.len(), &input.display().to_string()));
    };
    let mut all = Vec::new();
    for Member { name, option, read } in members {
        let loaded = Loaded::read(&input, JobOptions { read, ..options.clone() })?;
        let parts = planned(&loaded, parts)?;
        if !json {
            let run = format!("{} {option}", input.display());
            say(&format!("{name}\n{}\n", told(&parts, loaded.stack.slices.len(), &run)))?;
        }
        all.push(PlannedMember { name, option, parts });
    }
    if json { to_json(serde_json::to_string_pretty(&all)) } else { Ok(()) }
}

/// The parts of a body.
fn planned(loaded: &Loaded, parts: usize) -> Result<Vec<Planned>> {
    let slices = &loaded.stack.slices;
    let planned = |number: usize| -> Result<Planned> {
        let section = loaded.section(number, parts)?;
        Ok(Planned {
            part: format!("{number}/{parts}"),
            intervals: [section.kept.start, section.kept.end],
            z: [slices[section.kept.start].z, slices[section.kept.end].z],
            slices: [section.slices.start, section.slices.end],
            memory_mib: loaded.needs_of(&section).all.div_ceil(1 << 20),
        })
    };
    (1..=parts.max(1)).map(planned).collect()
}

/// A plan in words; `run` is the input with the option that chooses the body.
fn told(planned: &[Planned], slices: usize, run: &str) -> String {
    let line = |p: &Planned| {
        format!(
            "part {}: intervals {} to {} (heights {} to {}), reads slices {} to {} of {}, {} MiB\n",
            p.part,
            p.intervals[0],
            p.intervals[1] - 1,
            p.z[0],
            p.z[1],
            p.slices[0],
            p.slices[1] - 1,
            slices,
            p.memory_mib
        )
    };
    format!(
        "{}each: interslice run {run} --part K/{} -o K.section [the same options]\n\
         then: interslice merge *.section -o FILE\n",
        planned.iter().map(line).collect::<String>(),
        planned.len()
    )
}

pub fn run(mut arguments: RunArguments, matches: &ArgMatches) -> Result<()> {
    set_threads(arguments.threads)?;
    let SplitPart { number, count } = arguments.part;
    let input = arguments.job.input.clone();
    let options = arguments.job.options(&mut arguments.device, matches)?;
    let name = fingerprint(&input, &options, &["section"])?;
    let mut places = Places::of(&input, &options)?;
    let loaded = Loaded::read(&input, options)?;
    let section = loaded.section(number, count)?;
    let mut writer = SectionWriter::open(&arguments.output, [number, count], name, &loaded, &mut places)?;
    let notice = |message: &str| tell!("warning: {message}");
    let mut chosen = choose(&arguments.device, &notice)?;
    let budget = chosen.budget(&loaded.needs_of(&section), 0, arguments.device.memory())?;
    if !arguments.quiet {
        tell!("running on: {} ({})", chosen.backend().name(), chosen.reason);
        tell_kept(&budget);
    }
    let bars = Bars::default();
    let progress: &dyn Progress = if arguments.quiet { &interslice::progress::Silent } else { &bars };
    let means = interslice::Means { backend: chosen.backend(), progress, budget: &budget };
    let mut body = loaded.compute_section(&section, &means, &mut writer)?;
    chosen.complete(&mut body.report.profile);
    body.report.provenance = loaded.provenance()?;
    chosen.tell(&body.report.profile);
    let written = writer.finish(&body.report)?;
    if !arguments.quiet {
        body.report.warnings.iter().for_each(|w| tell!("warning: {w}"));
        tell!("wrote {}", written.display());
    }
    Ok(())
}

pub fn merge(arguments: MergeArguments) -> Result<()> {
    let sections = Sections::open(&arguments.parts)?;
    let told = sections.output();
    let options = OutputOptions {
        mask: arguments.mask || told.mask && !arguments.distance,
        distance: arguments.distance || told.distance && !arguments.mask,
        contours: arguments.contours || told.contours,
        simplify: arguments.simplify.or(told.simplify),
        ..told
    };
    options.check_ranges()?;
    let mut outputs =
        Outputs::open(&arguments.outputs, None, Temporary::Random, &mut Places::reading(&arguments.parts))?;
    outputs.check(&options)?;
    options.idle(None, &arguments.outputs).iter().for_each(|idle| tell!("warning: {idle}"));
    // What was drawn is not known here: as if a third of the image were.
    let lid = sections.dims().iter().product::<usize>() / 3;
    room::check(outputs.bytes(sections.dims(), sections.geometry(), lid), None)?;
    let mut body = sections.replay(&mut outputs.sink(&options))?;
    outputs.complete(&mut body.report)?;
    let written = outputs.rename()?;
    if !arguments.quiet {
        body.report.warnings.iter().for_each(|w| tell!("warning: {w}"));
        written.iter().for_each(|path| tell!("wrote {}", path.display()));
    }
    Ok(())
}
