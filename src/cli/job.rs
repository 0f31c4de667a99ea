//! One reconstruction as the command line asks for it: input and options, with those of a settings file.

use std::path::PathBuf;

use clap::ArgMatches;
use interslice::files::JobOptions;
use interslice::files::options::OutputOptions;
use interslice::input;
use interslice::preset::Preset;
use interslice::stack::ReadOptions;
use interslice::stack::links::LinkOptions;
use interslice::{Result, Settings};

use super::config::{File, preset};
use super::devices::DeviceOptions;

#[derive(Debug, clap::Args)]
pub struct JobArguments {
    #[arg(help = input::format::help())]
    pub input: PathBuf,

    /// Read options from a TOML file (keys as the long options, with _ for -); the command line wins
    #[arg(long = "settings", value_name = "FILE")]
    settings_file: Option<PathBuf>,

    /// Settings under a name; a settings file and the command line win
    #[arg(long, value_enum, value_name = "NAME")]
    preset: Option<Preset>,

    #[command(flatten)]
    read: ReadOptions,

    #[command(flatten)]
    links: LinkOptions,

    #[command(flatten)]
    output: OutputOptions,

    #[command(flatten)]
    settings: Settings,
}

impl JobArguments {
    /// The options, checked; `device` takes those of the settings file too.
    pub fn options(self, device: &mut DeviceOptions, matches: &ArgMatches) -> Result<JobOptions> {
        let JobArguments { mut output, mut read, mut links, mut settings, settings_file, .. } = self;
        let mut file = settings_file.as_deref().map(File::read).transpose()?;
        let named = file.as_mut().map_or(Ok(None), File::preset)?;
        if let Some(named) = self.preset.or(named) {
            settings = preset(named, settings, matches)?;
        }
        if let Some(file) = &mut file {
            settings = file.overlay(settings, matches)?;
            read = file.overlay(read, matches)?;
            links = file.overlay(links, matches)?;
            output = file.overlay(output, matches)?;
            *device = file.overlay(std::mem::take(device), matches)?;
            file.finish()?;
        }
        let options = JobOptions { read, links, settings, output, settings_file: settings_file.clone() };
        options.check().map_err(|error| file.iter().fold(error, |error, file| file.blamed(error)))?;
        Ok(options)
    }
}
