//! `interslice reconstruct`.

use std::path::PathBuf;

use clap::ArgMatches;
use interslice::files::labels::LabelOptions;
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{Loaded, format};
use interslice::{Error, Result};

#[cfg(feature = "dicom")]
use super::all_rois::{self, All};
use super::devices::DeviceOptions;
use super::job::JobArguments;
use super::labels;
use super::session::{Telling, reconstruct, set_threads};

#[derive(Debug, clap::Args)]
pub struct ReconstructArguments {
    #[arg(short, long = "output", value_name = "FILE", help = format::help())]
    outputs: Vec<PathBuf>,

    /// Write what was done and how well each contour is met, as JSON, or as a page to look at (.html)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,

    /// Say what would be read, made and written, how much memory and how long it would take; compute and write nothing
    #[arg(long, conflicts_with = "quiet")]
    dry_run: bool,

    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    quiet: bool,

    /// Say how long each stage took and how well each contour is met
    #[arg(short, long)]
    verbose: bool,

    #[command(flatten)]
    job: JobArguments,

    /// RTSTRUCT: every closed ROI, each to files with its name before the extension; a .dcm gets all
    #[cfg(feature = "dicom")]
    #[arg(long, conflicts_with_all = ["roi", "slices"], help_heading = "Input")]
    all_rois: bool,

    #[command(flatten)]
    labels: LabelOptions,

    #[command(flatten)]
    device: DeviceOptions,

    /// Threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", help_heading = "Machine")]
    threads: Option<usize>,
}

pub fn run(mut arguments: ReconstructArguments, matches: &ArgMatches) -> Result<()> {
    let input = arguments.job.input.clone();
    let options = arguments.job.options(&mut arguments.device, matches)?;
    if arguments.outputs.is_empty() && arguments.report.is_none() {
        return Err(Error::Setting { name: "--output".into(), message: "is missing: nothing would be written".into() });
    }
    set_threads(arguments.threads)?;
    let telling = match (arguments.quiet, arguments.verbose) {
        _ if arguments.dry_run => Telling::DryRun,
        (true, _) => Telling::Quiet,
        (_, true) => Telling::Verbose,
        _ => Telling::Normal,
    };
    if telling != Telling::Quiet {
        let ends = OutputOptions::ends_before(&arguments.outputs, &options.settings);
        let of_outputs = options.output.idle(options.read.below, &arguments.outputs);
        let idle = options.settings.idle().into_iter().chain(of_outputs).chain(arguments.device.idle());
        idle.chain(ends).for_each(|idle| tell!("warning: {idle}"));
    }
    #[cfg(feature = "dicom")]
    if arguments.all_rois {
        let (outputs, report) = (&arguments.outputs, arguments.report.as_deref());
        let all = All { input: &input, outputs, report, options, device: &arguments.device, telling };
        return all_rois::run(&all);
    }
    if let Some(wanted) = &arguments.labels.labels {
        let asked = labels::Asked {
            input: &input,
            wanted,
            keep_overlaps: arguments.labels.keep_overlaps,
            outputs: &arguments.outputs,
            report: arguments.report.as_deref(),
        };
        return labels::reconstruct(&asked, options, &arguments.device, telling);
    }
    let loaded = Loaded::read(&input, options)?;
    let mut places = Places::of(&input, &loaded.options)?;
    let outputs = Outputs::open(&arguments.outputs, arguments.report.as_deref(), Temporary::Random, &mut places)?;
    outputs.check(&loaded.options.output)?;
    reconstruct(&loaded, outputs, &arguments.device, telling)
}
