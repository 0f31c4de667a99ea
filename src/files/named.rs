//! Options given by name, as a settings file or a line of a manifest has them: the names are those of the long options, with _ for -.

use clap::{Args, Command};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Table;

/// Named options that are still to be claimed.
#[derive(Debug, Clone, Default)]
pub struct Named(Table);

impl Named {
    /// All of `table`.
    pub fn new(table: Table) -> Self {
        Named(table)
    }

    /// `base` with every option of its kind that is named here, but for those that are `overruled`.
    ///
    /// # Errors
    /// One message per wrong value, with name and value.
    pub fn claim<T: Args + Serialize + DeserializeOwned>(
        &mut self,
        base: T,
        overruled: impl Fn(&str) -> bool,
    ) -> Result<T, Vec<String>> {
        let mut table = Table::try_from(&base).map_err(|e| vec![e.to_string()])?;
        let mut wrong = Vec::new();
        for key in names::<T>() {
            let Some(value) = self.0.remove(&key) else { continue };
            if overruled(&key) {
                continue;
            }
            // One key at a time, so that a wrong value is told by its name.
            let before = table.insert(key.clone(), value.clone());
            if let Err(e) = table.clone().try_into::<T>() {
                wrong.push(format!("`{key}` = {value}: {}", e.message().trim_end()));
                match before {
                    Some(before) => table.insert(key, before),
                    None => table.remove(&key),
                };
            }
        }
        match wrong[..] {
            [] => table.try_into().map_err(|e: toml::de::Error| vec![e.message().into()]),
            _ => Err(wrong),
        }
    }

    /// What nothing has claimed.
    pub fn unknown(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

/// Names of a kind of options.
pub fn names<T: Args>() -> Vec<String> {
    T::augment_args(Command::new("options")).get_arguments().map(|a| a.get_id().to_string()).collect()
}
