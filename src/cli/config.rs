//! Settings from a TOML file, overruled by what the command line says.

use std::path::Path;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command};
use interslice::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Table;

/// A settings file whose keys are still to be claimed.
pub struct File<'a> {
    path: &'a Path,
    left: Table,
}

impl<'a> File<'a> {
    /// Reads and parses the file.
    pub fn read(path: &'a Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let left = text.parse().map_err(|e: toml::de::Error| Error::Format {
            path: path.into(),
            message: e.to_string().trim_end().into(),
        })?;
        Ok(File { path, left })
    }

    /// `parsed` with every key of the file that the command line did not give itself.
    pub fn overlay<T: Args + Serialize + DeserializeOwned>(&mut self, parsed: T, matches: &ArgMatches) -> Result<T> {
        let fail = |message: String| Error::Format { path: self.path.into(), message };
        let mut table = Table::try_from(&parsed).map_err(|e| fail(e.to_string()))?;
        for argument in T::augment_args(Command::new("settings")).get_arguments() {
            let key = argument.get_id().as_str();
            let Some(value) = self.left.remove(key) else { continue };
            if matches.value_source(key) != Some(ValueSource::CommandLine) {
                table.insert(key.into(), value.clone());
                // One key at a time, so that a wrong value is told by its name.
                table.clone().try_into::<T>().map_err(|e| fail(format!("`{key}` = {value}: {}", e.message())))?;
            }
        }
        table.try_into().map_err(|e| fail(e.to_string()))
    }

    /// Refuses keys that nothing has claimed.
    pub fn finish(self) -> Result<()> {
        match self.left.keys().next() {
            Some(key) => Err(Error::Format { path: self.path.into(), message: format!("unknown key `{key}`") }),
            None => Ok(()),
        }
    }
}
