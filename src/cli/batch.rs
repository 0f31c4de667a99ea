//! `interslice batch`.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use interslice::batch::template::{Template, Templated, template};
use interslice::batch::{Job, Manifest, Options, Outcome, finished, index, line, run as run_all};
use interslice::storage::room;
use interslice::{Error, Result};

use super::devices::{DeviceOptions, share};
use super::interrupt;
use super::say::{say, say_exactly};
use super::session::set_threads;
use super::tally::Tally;

/// Share of the free memory that jobs in flight may take.
const SHARE: f64 = 0.8;

/// The manifest's lines, for `--help`.
const MANIFEST: &str = r#"A manifest is JSON Lines (.jsonl), one job a line:

  {"id": "a", "input": "cases/a", "outputs": ["out/a.nrrd", "out/a.stl", "out/a.json"],
   "options": {"end_top": "extrapolate", "fair": 0.5}}          (all on one line)

or CSV (.csv) with the columns id, input, outputs (separated by ;) and options (JSON, or
name=value;name=value). Cells may be separated by ; too, as spreadsheets do; then lists stand in
quotes. Paths are relative to the manifest's folder; folders of outputs are made. Options are
those of `reconstruct` under Input, Output, Method and Ends, with _ for -. A line with
all_rois = true, or with labels and keep_overlaps = true, is a job for each ROI or label, with
its name or number in the id and before the extension of each output.

Run the same command again and finished jobs are skipped: those whose input, options, names of
outputs, --backend, --adapter and program version are the same, by content, and whose outputs are
as they were written. What is missing or was changed since is made again.

Exit codes: 0 all done, 1 some failed or were not run (listed last), 2 the manifest is wrong
(every wrong line is listed, nothing is run)."#;

#[derive(Debug, clap::Args)]
#[command(after_long_help = MANIFEST)]
pub struct BatchArguments {
    /// Manifest: .jsonl or .csv; with --template the file to write, which must not exist [default with --template: standard output]
    #[arg(required_unless_present = "template")]
    manifest: Option<PathBuf>,

    /// Results, a line per job that has ended [default: results.jsonl beside the manifest]
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,

    /// Jobs computed at once (on a GPU they take turns by the stage, and calls that wait are computed together); as many are read ahead and written behind [default: one per core]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,

    /// Write a page over all jobs: status, volume, warnings and a picture each, to be sorted in a browser. Jobs that write no mesh make one for it
    #[arg(long, value_name = "FILE.html", conflicts_with_all = ["dry_run", "template"])]
    index: Option<PathBuf>,

    /// Begin no job after one has failed
    #[arg(long)]
    fail_fast: bool,

    /// Say what would run and what is finished; run nothing
    #[arg(long)]
    dry_run: bool,

    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,

    /// Make a manifest from a folder of cases: sub-folders with stack.json, and every file that is an input
    #[arg(long, value_name = "FOLDER", conflicts_with = "dry_run", help_heading = "Template")]
    template: Option<PathBuf>,

    /// Outputs of the template's jobs, by extension
    #[arg(
        long,
        value_name = "EXT,..",
        value_delimiter = ',',
        default_value = "nrrd,stl",
        requires = "template",
        help_heading = "Template"
    )]
    ext: Vec<String>,

    /// Folder of the template's outputs
    #[arg(long, value_name = "FOLDER", default_value = "out", requires = "template", help_heading = "Template")]
    out: String,

    /// A job for each label of a label volume in the template; an RTSTRUCT has one for each ROI in any case
    #[arg(long, requires = "template", help_heading = "Template")]
    each_label: bool,

    #[command(flatten)]
    device: DeviceOptions,

    /// Threads [default: one per core]; the results do not depend on it
    #[arg(long, value_name = "N", help_heading = "Machine")]
    threads: Option<usize>,
}

pub fn run(arguments: &BatchArguments) -> Result<()> {
    if let Some(folder) = &arguments.template {
        return write_template(folder, arguments);
    }
    let Some(path) = &arguments.manifest else { return Ok(()) };
    let jobs = match arguments.jobs {
        Some(n) if !(1..=1024).contains(&n) => {
            return Err(Error::Setting { name: "jobs".into(), message: format!("must lie in [1, 1024]; got {n}") });
        }
        Some(n) => n,
        None => std::thread::available_parallelism().map_or(1, |n| n.get()),
    };
    set_threads(arguments.threads)?;
    let mut manifest = Manifest::read(path)?;
    if !arguments.quiet {
        manifest.left_out.iter().for_each(|why| tell!("warning: {why}"));
    }
    let results = arguments.results.clone().unwrap_or_else(|| manifest.folder.join("results.jsonl"));
    manifest.writes(&results)?;
    let index = arguments.index.as_deref().map(|path| Ok::<_, Error>((path, manifest.page(path)?))).transpose()?;
    let machine = arguments.device.wish();
    if arguments.dry_run {
        let finished = finished(&manifest, &results, &machine)?;
        let line =
            |(job, finished): (&Job, bool)| format!("{} {}\n", if finished { "finished" } else { "to run  " }, job.id);
        return say(&manifest.jobs.iter().zip(finished).map(line).collect::<String>());
    }
    let tally = Tally::new(manifest.jobs.len(), arguments.quiet);
    let notice = |message: &str| tally.say(&format!("warning: {message}"));
    let shared = share(&arguments.device, &notice)?;
    if !arguments.quiet {
        tally.say(&format!("running on: {} ({})", shared.name(), shared.reason));
    }
    let memory = arguments.device.memory().or_else(|| room::available().map(|free| (free as f64 * SHARE) as u64));
    let memory = shared.leaves(memory.unwrap_or(u64::MAX))?;
    let options = Options { jobs, memory, fail_fast: arguments.fail_fast, pictures: index.is_some(), machine };
    let outcomes = run_all(&manifest, &results, shared.machine(), &options, &tally, &interrupt::stop())?;
    tally.finish();
    if let Some((path, pending)) = index {
        index::write(path, pending, &manifest, &results, &outcomes)?;
        if !arguments.quiet {
            tell!("wrote {}", path.display());
        }
    }
    shared.tell_profile();
    conclude(&manifest, &outcomes, arguments.quiet)
}

/// Tells how many jobs ended how; failures last, as an error.
fn conclude(manifest: &Manifest, outcomes: &[Outcome], quiet: bool) -> Result<()> {
    let count = |what: &Outcome| outcomes.iter().filter(|o| *o == what).count();
    let (done, skipped, not_run) = (count(&Outcome::Done), count(&Outcome::Skipped), count(&Outcome::NotRun));
    if !quiet {
        tell!("{done} done, {skipped} finished before");
    }
    let failed: Vec<(String, String)> = manifest
        .jobs
        .iter()
        .zip(outcomes)
        .filter_map(|(job, outcome)| match outcome {
            Outcome::Failed(why) => Some((job.id.clone(), why.clone())),
            _ => None,
        })
        .collect();
    if failed.is_empty() && not_run == 0 {
        return Ok(());
    }
    Err(Error::Batch { failed, not_run, of: outcomes.len() })
}

fn write_template(folder: &Path, arguments: &BatchArguments) -> Result<()> {
    let wanted = Template {
        extensions: arguments.ext.iter().map(|e| e.trim_start_matches('.').to_string()).collect(),
        output: arguments.out.trim_end_matches('/').to_string(),
        each_label: arguments.each_label,
    };
    let target = arguments.manifest.as_deref();
    let base = target.and_then(Path::parent).filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Templated { lines, left_out } = template(folder, base, &wanted)?;
    left_out.iter().for_each(|why| tell!("warning: {why}"));
    let text = line::text(&lines, target.unwrap_or(Path::new("manifest.jsonl")))?;
    let Some(path) = target else { return say_exactly(&text) };
    let fail = |e: std::io::Error| Error::Output { path: path.into(), message: e.to_string() };
    let mut file = OpenOptions::new().write(true).create_new(true).open(path).map_err(fail)?;
    if let Err(source) = file.write_all(text.as_bytes()).and_then(|()| file.sync_all()) {
        let _ = fs::remove_file(path);
        return Err(Error::Write { path: path.into(), source });
    }
    tell!("wrote {} jobs to {}", lines.len(), path.display());
    Ok(())
}
