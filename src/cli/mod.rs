//! The command line: arguments to settings to `reconstruct` to files. No numerics. Subcommands, one a file.

#[macro_use]
mod say;

#[cfg(feature = "dicom")]
mod all_rois;
mod allocator;
mod bar;
mod batch;
mod completions;
mod config;
mod demo;
pub mod devices;
mod evaluate;
mod forecast;
pub mod inspect;
mod interrupt;
mod job;
mod labels;
mod links;
mod man;
mod members;
mod reconstruct;
mod sections;
mod session;
mod tally;
mod values;
mod volume;

use std::ffi::OsString;

#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub use allocator::OnLargePages;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use interslice::Result;
use interslice::storage::room;

/// Smooth closed surfaces from stacks of parallel contours.
#[derive(Debug, Parser)]
#[command(name = "interslice", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Turn a stack of contours into a closed surface
    Reconstruct(Box<reconstruct::ReconstructArguments>),
    /// Run the reconstructions that a manifest lists; run again, it goes on where it was interrupted
    Batch(Box<batch::BatchArguments>),
    /// Say how a reconstruction can be split into parts, and what each needs
    Plan(Box<sections::PlanArguments>),
    /// Compute one part of a reconstruction
    Run(Box<sections::RunArguments>),
    /// Join the parts of a reconstruction into its outputs
    Merge(sections::MergeArguments),
    /// Say what is in a stack, before any work
    Inspect(Box<inspect::InspectArguments>),
    /// Leave slices out, reconstruct them, and say how well they are found
    Evaluate(Box<evaluate::EvaluateArguments>),
    /// Write the paper's synthetic stacks and reconstruct them
    Demo(demo::DemoArguments),
    /// List the GPUs of this machine and which one would be used
    Devices,
    /// Test whether a GPU and its driver compute rightly
    Doctor(devices::DeviceOptions),
    /// Print completions for a shell
    Completions(completions::CompletionsArguments),
    /// Print the man page of the program or of a command
    Man(man::ManArguments),
}

/// The command line as clap knows it: what `--help`, completions and man pages are made of.
fn command() -> clap::Command {
    let together = "Memory that all jobs in flight may take together, by estimate, e.g. 512M or 4G [default: 80 % of what is free]";
    let command = Cli::command().mut_subcommands(|c| c.mut_args(values::told));
    command.mut_subcommand("batch", |c| c.mut_arg("memory", |a| a.help(together)))
}

/// Threads that a run computes on.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Runs the command line `arguments`, the program's name first; errors go to stderr. Returns the exit code.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    match run(arguments) {
        Ok(()) => 0,
        Err(error) => {
            tell!("error: {error}");
            error.exit_code()
        }
    }
}

/// Parses the command line and runs it.
fn run(arguments: impl IntoIterator<Item = OsString>) -> Result<()> {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let mut command = command();
    if let Some(error) = values::swallowed(&mut command, arguments.iter().cloned()) {
        error.exit();
    }
    let matches = command.get_matches_from(arguments);
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|e| e.exit());
    let bounded = |(_, matches): (&str, &clap::ArgMatches)| matches!(matches.try_get_one::<u64>("memory"), Ok(Some(_)));
    if matches.subcommand().is_some_and(bounded) || room::is_bounded() {
        allocator::give_back_at_once();
    }
    interrupt::let_large_files_fail();
    // A batch stops between its jobs.
    if !matches!(cli.command, Command::Batch(_)) {
        interrupt::end();
    }
    match (cli.command, matches.subcommand()) {
        (Command::Reconstruct(arguments), Some((_, matches))) => reconstruct::run(*arguments, matches),
        (Command::Plan(arguments), Some((_, matches))) => sections::plan(*arguments, matches),
        (Command::Run(arguments), Some((_, matches))) => sections::run(*arguments, matches),
        (Command::Merge(arguments), _) => sections::merge(arguments),
        (Command::Batch(arguments), _) => batch::run(&arguments),
        (Command::Inspect(arguments), _) => inspect::run(&arguments),
        (Command::Evaluate(arguments), _) => evaluate::run(&arguments),
        (Command::Demo(arguments), _) => demo::run(&arguments),
        (Command::Devices, _) => devices::list(),
        (Command::Doctor(options), _) => devices::examine(&options),
        (Command::Completions(arguments), _) => completions::run(&arguments),
        (Command::Man(arguments), _) => man::run(&arguments),
        (Command::Reconstruct(_) | Command::Plan(_) | Command::Run(_), None) => Ok(()),
    }
}
