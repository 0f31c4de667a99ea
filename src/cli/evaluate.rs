//! `interslice evaluate`.

use std::path::PathBuf;

use interslice::backend::Backend;
use interslice::evaluate::holdout::{HoldOut, SliceScore, hold_out};
use interslice::files::format::{Kind, kind};
use interslice::files::pending::{Pending, Temporary};
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::input;
use interslice::stack::ReadOptions;
use interslice::stack::links::LinkOptions;
use interslice::{Budget, Error, Means, Result, Settings};
use serde::Serialize;

use super::bar::Bars;
use super::devices::{DeviceOptions, choose};
use super::members::MemberOptions;
use super::say::{say, say_exactly};
use super::session::set_threads;

#[derive(Debug, clap::Args)]
pub struct EvaluateArguments {
    /// Write the scores as JSON, too; repeatable
    #[arg(short, long = "output", value_name = "FILE.json")]
    outputs: Vec<PathBuf>,

    #[arg(help = input::format::help())]
    input: PathBuf,

    /// Leave out every N-th slice
    #[arg(long, value_name = "N", default_value_t = 2)]
    leave: usize,

    /// Print JSON
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    read: ReadOptions,

    #[command(flatten)]
    links: LinkOptions,

    #[command(flatten)]
    members: MemberOptions,

    #[command(flatten)]
    settings: Settings,

    #[command(flatten)]
    device: DeviceOptions,

    /// Threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", help_heading = "Machine")]
    threads: Option<usize>,
}

/// Scores of one of several bodies, or why there are none.
#[derive(Debug, Serialize)]
struct MemberScore {
    /// "label 5 (`liver`)".
    name: String,
    #[serde(flatten)]
    scores: Option<HoldOut>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

pub fn run(arguments: &EvaluateArguments) -> Result<()> {
    arguments.settings.validate()?;
    set_threads(arguments.threads)?;
    let notice = |message: &str| tell!("warning: {message}");
    let members = arguments.members.of(&arguments.input, &arguments.read, &notice)?;
    if members.is_some() && arguments.links.links.is_some() {
        let message = "are not for several bodies: parts are numbered in each by itself".into();
        return Err(Error::Setting { name: "links".into(), message });
    }
    let Some(members) = members else {
        let loaded = Loaded::read(&arguments.input, job(arguments))?;
        let outputs = open(arguments)?;
        let chosen = choose(&arguments.device, &notice)?;
        tell!("running on: {} ({})", chosen.backend().name(), chosen.reason);
        let score = score(arguments, &loaded, chosen.backend())?;
        chosen.tell_kernels();
        write(outputs, &score)?;
        return if arguments.json { say_exactly(&json(&score)) } else { say(&describe(&score, &loaded.stack.unit)) };
    };
    let outputs = open(arguments)?;
    let chosen = choose(&arguments.device, &notice)?;
    tell!("running on: {} ({})", chosen.backend().name(), chosen.reason);
    let mut scores = Vec::new();
    for member in members {
        tell!("{}", member.name);
        let options = JobOptions { read: member.read, ..job(arguments) };
        let loaded = Loaded::read(&arguments.input, options)?;
        // What one body lacks does not stop the others.
        let (scores_of, error) = match score(arguments, &loaded, chosen.backend()) {
            Ok(score) => (Some(score), None),
            Err(e) if e.exit_code() == 2 => (None, Some(e.to_string())),
            Err(e) => return Err(e),
        };
        if !arguments.json {
            let text = scores_of.as_ref().map(|score| describe(score, &loaded.stack.unit));
            say(&format!("{}\n{}\n", member.name, text.or(error.clone()).unwrap_or_default()))?;
        }
        scores.push(MemberScore { name: member.name, scores: scores_of, error });
    }
    chosen.tell_kernels();
    write(outputs, &scores)?;
    if arguments.json { say_exactly(&json(&scores)) } else { Ok(()) }
}

/// What is asked for of the input.
fn job(arguments: &EvaluateArguments) -> JobOptions {
    let (read, links, settings) = (arguments.read.clone(), arguments.links.clone(), arguments.settings.clone());
    JobOptions { read, links, settings, ..JobOptions::default() }
}

/// Scores of one body.
fn score(arguments: &EvaluateArguments, loaded: &Loaded, backend: &dyn Backend) -> Result<HoldOut> {
    loaded.notes.iter().for_each(|note| tell!("warning: {note}"));
    let (settings, map) = (&loaded.options.settings, loaded.options.output.map.as_deref());
    let means = Means { backend, progress: &Bars::default(), budget: &Budget::unlimited() };
    let (stack, notes) = loaded.completed(settings, &means)?;
    notes.iter().for_each(|note| tell!("warning: {note}"));
    let score = hold_out(&stack, map, settings, arguments.leave, backend, &Bars::default())?;
    let (all, used) = (settings.links.len(), score.links);
    if used < all {
        tell!("warning: {} of {all} links name a slice that is left out, and count for nothing", all - used);
    }
    Ok(score)
}

fn json(scores: &impl Serialize) -> String {
    serde_json::to_string_pretty(scores).unwrap_or_default() + "\n"
}

fn write(outputs: Vec<(&PathBuf, Pending)>, scores: &impl Serialize) -> Result<()> {
    for (path, pending) in outputs {
        let written = pending.write_json(scores).and_then(|()| pending.rename());
        written.map_err(|source| Error::Write { path: path.clone(), source })?;
        tell!("wrote {}", path.display());
    }
    Ok(())
}

/// The outputs under temporary names, before the work.
fn open<'a>(arguments: &'a EvaluateArguments) -> Result<Vec<(&'a PathBuf, Pending)>> {
    let mut places = Places::of(&arguments.input, &job(arguments))?;
    let mut open = |path: &'a PathBuf| match kind(path) {
        Ok(Kind::Report) => Ok((path, Pending::open(path, false, Temporary::Random, &mut places)?)),
        _ => Err(Error::Output { path: path.clone(), message: "scores are written as JSON".into() }),
    };
    arguments.outputs.iter().map(&mut open).collect()
}

fn describe(score: &HoldOut, unit: &str) -> String {
    let mut lines = vec![format!(
        "{:>24} {:>12} {:>8} {:>14} {:>8} {:>8}",
        "slice left out", "height", "Dice", "distance", "area", "linear"
    )];
    let or_dash = |v: Option<String>| v.unwrap_or_else(|| "-".into());
    let line = |s: &SliceScore| {
        format!(
            "{:>24} {:>12.4} {:>8} {:>14} {:>8} {:>8}",
            s.name,
            s.z,
            or_dash(s.dice.map(|d| format!("{d:.4}"))),
            or_dash(s.surface_distance.map(|d| format!("{d:.4} {unit}"))),
            or_dash(s.area_error_percent.map(|e| format!("{e:+.1} %"))),
            or_dash(s.linear_dice.map(|d| format!("{d:.4}")))
        )
    };
    let scores = |dice: Option<f64>, distance: Option<f64>, volume: Option<f64>| {
        let dice = or_dash(dice.map(|d| format!("{d:.4}")));
        let distance = or_dash(distance.map(|d| format!("{d:.4} {unit}")));
        format!(
            "Dice {dice}, mean contour distance {distance}, volume {}",
            or_dash(volume.map(|e| format!("{e:+.2} %")))
        )
    };
    lines.extend(score.slices.iter().map(line));
    lines.push(format!(
        "{} slices left out, one in {}: {}",
        score.slices.len(),
        score.leave,
        scores(score.dice, score.surface_distance, score.volume_error_percent)
    ));
    if score.dice.is_none() {
        lines.push("Nothing is on the slices that were left out: there is nothing to compare with.".into());
    }
    let linear = &score.linear;
    lines.push(format!(
        "linear interpolation of distances: {}",
        scores(linear.dice, linear.surface_distance, linear.volume_error_percent)
    ));
    if let Some(own) = score.height_error {
        let of = |error: Option<f64>| or_dash(error.map(|e| format!("{e:.4} {unit}")));
        let each = score.slices.iter().map(|s| of(s.height_error)).collect::<Vec<_>>().join(", ");
        lines.push(format!(
            "heights along the lines left out are {} off (root of the mean square; linear: {}): {each}",
            of(Some(own)),
            of(linear.height_error)
        ));
    }
    if !score.ends.is_empty() {
        lines.push("the first and the last slice left out, found by the end rules (linear: continued):".into());
        lines.extend(score.ends.iter().map(line));
    }
    lines.push("With all slices given, gaps are smaller and what lies between them is found better than this.".into());
    lines.join("\n") + "\n"
}
