//! Settings from a TOML file, overruled by what the command line says.

use std::collections::BTreeSet;
use std::path::Path;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args};
use interslice::files::named::Named;
use interslice::preset::Preset;
use interslice::storage::regular::unmarked;
use interslice::{Error, Result, Settings};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The settings of a preset, but for what the command line gave itself.
pub fn preset(preset: Preset, parsed: Settings, matches: &ArgMatches) -> Result<Settings> {
    let fail = |message: String| Error::Setting { name: "preset".into(), message };
    let table = toml::Table::try_from(preset.settings()).map_err(|e| fail(e.to_string()))?;
    let given = |key: &str| matches.value_source(key) == Some(ValueSource::CommandLine);
    match Named::new(table).claim(parsed, given) {
        (claimed, wrong) if wrong.is_empty() => Ok(claimed),
        (_, wrong) => Err(fail(wrong.join("; "))),
    }
}

/// A settings file whose keys are still to be claimed.
pub struct File<'a> {
    path: &'a Path,
    left: Named,
    /// Keys whose values are those of the file.
    taken: BTreeSet<String>,
    /// Pairs of options that exclude each other.
    excluding: Vec<[String; 2]>,
}

impl<'a> File<'a> {
    /// Reads and parses the file.
    pub fn read(path: &'a Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let table = unmarked(&text).parse().map_err(|e: toml::de::Error| Error::Format {
            path: path.into(),
            message: e.to_string().trim_end().into(),
        })?;
        Ok(File { path, left: Named::new(table), taken: BTreeSet::new(), excluding: excluding() })
    }

    /// The preset that the file names, if it names one.
    pub fn preset(&mut self) -> Result<Option<Preset>> {
        self.left.preset().map_err(|message| Error::Format { path: self.path.into(), message })
    }

    /// `parsed` with every key of the file that the command line did not give itself, nor exclude by what it gave.
    pub fn overlay<T: Args + Serialize + DeserializeOwned>(&mut self, parsed: T, matches: &ArgMatches) -> Result<T> {
        let given = |key: &str| {
            matches.try_contains_id(key).is_ok() && matches.value_source(key) == Some(ValueSource::CommandLine)
        };
        let overruled = |key: &str| given(key) || self.excluding.iter().any(|[own, other]| own == key && given(other));
        self.taken.extend(self.left.unknown().filter(|key| !overruled(key)).map(String::from));
        match self.left.claim(parsed, overruled) {
            (claimed, wrong) if wrong.is_empty() => Ok(claimed),
            (_, wrong) => Err(Error::Format { path: self.path.into(), message: wrong.join("; ") }),
        }
    }

    /// What is wrong with a setting, with the file's name where it is from there.
    pub fn blamed(&self, error: Error) -> Error {
        match error {
            Error::Setting { name, message } if self.taken.contains(&name) => {
                Error::Format { path: self.path.into(), message: format!("`{name}` {message}") }
            }
            other => other,
        }
    }

    /// Refuses keys that nothing has claimed.
    pub fn finish(&self) -> Result<()> {
        match self.left.unknown().next() {
            Some(key) => {
                let own = key.replace('-', "_");
                let hint = if own != key && is_option(&own) { format!("; write `{own}`") } else { String::new() };
                Err(Error::Format { path: self.path.into(), message: format!("unknown key `{key}`{hint}") })
            }
            None => Ok(()),
        }
    }
}

/// Whether any command has an option of this name.
fn is_option(name: &str) -> bool {
    let command = super::command();
    command.get_subcommands().any(|command| command.get_arguments().any(|option| option.get_id() == name))
}

/// Pairs of options of any command that exclude each other, either way round.
fn excluding() -> Vec<[String; 2]> {
    let command = super::command();
    let mut pairs = Vec::new();
    for command in command.get_subcommands() {
        for option in command.get_arguments() {
            for other in command.get_arg_conflicts_with(option) {
                let [a, b] = [option, other].map(|option| option.get_id().to_string());
                pairs.extend([[a.clone(), b.clone()], [b, a]]);
            }
        }
    }
    pairs
}
