//! Options given by name, as a settings file or a line of a manifest has them: the names are those of the long options, with _ for -.

use clap::builder::PossibleValue;
use clap::{Args, Command, ValueEnum};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Table;

use crate::preset::Preset;
use crate::storage::kinds::in_words;

/// Name by which settings are asked for under theirs.
pub const PRESET: &str = "preset";

/// Named options that are still to be claimed.
#[derive(Debug, Clone, Default)]
pub struct Named(Table);

impl Named {
    /// All of `table`.
    pub fn new(table: Table) -> Self {
        Named(table)
    }

    /// `base` with every option of its kind that is named here, but for those that are `overruled`; and a message per wrong value, which
    /// is left out.
    pub fn claim<T: Args + Serialize + DeserializeOwned>(
        &mut self,
        base: T,
        overruled: impl Fn(&str) -> bool,
    ) -> (T, Vec<String>) {
        let (mut claimed, mut wrong) = (base, Vec::new());
        let command = T::augment_args(Command::new("options"));
        for argument in command.get_arguments() {
            let key = argument.get_id().to_string();
            let Some(value) = self.0.remove(&key).filter(|_| !overruled(&key)) else { continue };
            // One key at a time, so that a wrong value is told by its name.
            let with = Table::try_from(&claimed).map_err(|e| e.to_string()).and_then(|mut table| {
                table.insert(key.clone(), value.clone());
                table.try_into::<T>().map_err(|e| in_words(e.message().trim_end()))
            });
            match with {
                Ok(with) => claimed = with,
                // Of the kinds that a choice may be written in, only its names are told.
                Err(e) => match argument.get_possible_values() {
                    choices if choices.is_empty() => wrong.push(format!("`{key}` = {value}: {e}")),
                    choices => wrong.push(format!("`{key}` = {value}: expected {}", one_of(&choices))),
                },
            }
        }
        (claimed, wrong)
    }

    /// The preset that is named here, if one is.
    ///
    /// # Errors
    /// What is wrong with its name.
    pub fn preset(&mut self) -> Result<Option<Preset>, String> {
        let Some(value) = self.0.remove(PRESET) else { return Ok(None) };
        let known = value.as_str().and_then(|name| Preset::from_str(name, false).ok());
        let choices: Vec<_> = Preset::value_variants().iter().filter_map(ValueEnum::to_possible_value).collect();
        known.map(Some).ok_or_else(|| format!("`{PRESET}` = {value}: expected {}", one_of(&choices)))
    }

    /// Names that nothing has claimed.
    pub fn unknown(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

/// Names to choose one of.
fn one_of(choices: &[PossibleValue]) -> String {
    choices.iter().map(PossibleValue::get_name).collect::<Vec<_>>().join(" or ")
}

/// Names of a kind of options.
pub fn names<T: Args>() -> Vec<String> {
    T::augment_args(Command::new("options")).get_arguments().map(|a| a.get_id().to_string()).collect()
}
