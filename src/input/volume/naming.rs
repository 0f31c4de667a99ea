//! Labels of a volume by the names that its file gives them.

use super::survey::Survey;
use super::{Volume, slices};
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::stack::options::{BACKGROUND, LabelName};

/// Names of labels that a message lists.
const NAMED: usize = 24;

impl Volume {
    /// The label that a user names for the option `option`: by number, else by name, be it in another case.
    ///
    /// # Errors
    /// [`Error::Setting`] with the names that there are.
    pub fn label(&self, wanted: &LabelName, option: &str) -> Result<i64> {
        let fail = |message: String| Err(self.wrong_label(option, &message));
        let background = || Err(Error::Setting { name: option.into(), message: BACKGROUND.into() });
        let name = match wanted {
            LabelName::Number(0) => return background(),
            LabelName::Number(n) if self.layers.is_some() && !self.segments.contains_key(n) => {
                return fail(format!("must name one of the file's labels; got {n}"));
            }
            LabelName::Number(n) => return Ok(*n),
            LabelName::Name(name) => name.trim(),
        };
        let named = |same: fn(&str, &str) -> bool| {
            let is = |a: &Appearance| a.name.as_deref().is_some_and(|own| same(own.trim(), name));
            self.segments.iter().filter(|(_, a)| is(a)).map(|(n, _)| *n).collect::<Vec<i64>>()
        };
        let mut found = named(|a, b| a == b);
        if found.is_empty() {
            found = named(|a, b| a.to_lowercase() == b.to_lowercase());
        }
        match (&found[..], name.parse()) {
            (&[0], _) | (&[], Ok(0)) => background(),
            (&[label], _) | (&[], Ok(label)) => Ok(label),
            (&[], Err(_)) => fail(format!("must name one of the file's labels; got `{name}`")),
            _ => fail(format!("`{name}` is the name of several labels: name it by its number")),
        }
    }

    /// What is wrong with a label that a user names for the option `option`, and the names that there are.
    pub(crate) fn wrong_label(&self, option: &str, message: &str) -> Error {
        let named = |(n, a): (&i64, &Appearance)| Some(format!("{n} `{}`", a.name.as_ref()?));
        let mut names: Vec<String> = self.segments.iter().filter_map(named).take(NAMED + 1).collect();
        let listed = match names.len() {
            0 => match Survey::of(self, None) {
                Ok(survey) if !survey.labels.is_empty() => {
                    format!("the file has no names; labels are {}", slices::listed(survey.labels.keys()))
                }
                // Whoever reads its voxels says what is wrong with them.
                _ => "the file has no names".into(),
            },
            n => {
                names.truncate(NAMED);
                format!("there are {}{}", names.join(", "), if n > NAMED { ", ..." } else { "" })
            }
        };
        Error::Setting { name: option.into(), message: format!("{message}; {listed}") }
    }
}
