//! Options of the command line under their names: the very structs that clap and serde read.

use clap::{Args, Command, ValueEnum};
use interslice::Settings;
use interslice::cli::devices::DeviceOptions;
use interslice::files::named::{Named, names};
use interslice::files::options::OutputOptions;
use interslice::preset::Preset;
use interslice::settings::Link;
use interslice::stack::ReadOptions;
use interslice::storage::json::parse;
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::errors::{raised, unlike, wrong};
use crate::values::{python, report, value};

/// Options by name that are still to be claimed.
pub struct Options {
    named: Named,
    known: Vec<String>,
    /// Links, which the command line has from a file.
    links: Option<Vec<Link>>,
}

/// The setting that is no option of the command line.
const LINKS: &str = "links";

impl Options {
    /// All keyword arguments.
    pub fn new(given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let (mut table, mut links) = (toml::Table::new(), None);
        for (key, of_key) in given.into_iter().flatten() {
            let key: String = key.extract()?;
            if key == LINKS {
                links = if of_key.is_none() { None } else { Some(linked(&of_key)?) };
            } else if let Some(value) = value(&key, &of_key)? {
                table.insert(key, value);
            }
        }
        Ok(Options { named: Named::new(table), known: Vec::new(), links })
    }

    /// The settings, links among them.
    pub fn settings(&mut self, base: Settings) -> PyResult<Settings> {
        let mut settings = self.claim(base)?;
        self.known.push(LINKS.into());
        settings.links = self.links.take().unwrap_or(settings.links);
        Ok(settings)
    }

    /// Those of one kind; `base` has the rest.
    pub fn claim<T: Args + Serialize + DeserializeOwned>(&mut self, base: T) -> PyResult<T> {
        self.known.extend(names::<T>());
        match self.named.claim(base, |_| false) {
            (claimed, wrong) if wrong.is_empty() => Ok(claimed),
            (_, wrong) => Err(pyo3::exceptions::PyValueError::new_err(wrong.join("; "))),
        }
    }

    /// Refuses the names that nothing has claimed.
    pub fn finish(self) -> PyResult<()> {
        match self.named.unknown().next().or(self.links.as_ref().map(|_| LINKS)) {
            Some(key) => Err(unlike(format!("unknown option `{key}`; there are {}", self.known.join(", ")))),
            None => Ok(()),
        }
    }
}

/// Settings of a reconstruction: names, ranges and defaults are those of the command line.
#[pyclass(name = "Settings", module = "interslice", frozen, eq, from_py_object)]
#[derive(Debug, Clone, PartialEq)]
pub struct PySettings(pub Settings);

#[pymethods]
impl PySettings {
    #[new]
    #[pyo3(signature = (preset=None, **settings))]
    fn new(preset: Option<&str>, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let base = match preset {
            None => Settings::default(),
            Some(name) => {
                let there = Preset::value_variants().iter().filter_map(|p| p.to_possible_value());
                let there: Vec<String> = there.map(|p| p.get_name().to_string()).collect();
                let unknown = |_| wrong("preset", format!("must be one of {}; got `{name}`", there.join(", ")));
                Preset::from_str(name, false).map_err(unknown)?.settings()
            }
        };
        PySettings(base).replace(settings)
    }

    /// These settings with some others.
    #[pyo3(signature = (**settings))]
    fn replace(&self, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut options = Options::new(settings)?;
        let own = options.settings(self.0.clone())?;
        options.finish()?;
        own.validate().map_err(raised)?;
        Ok(PySettings(own))
    }

    /// Names and values.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let dict = report(py, &self.0)?;
        // A setting that says nothing is not written.
        for name in all_names() {
            if !dict.contains(&name)? {
                match name.as_str() {
                    LINKS => dict.set_item(name, PyList::empty(py))?,
                    _ => dict.set_item(name, py.None())?,
                }
            }
        }
        Ok(dict)
    }

    /// What there is to set: name, help (with range and unit), default and choices, as `--help` has them.
    #[staticmethod]
    fn options(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
        told::<Settings>(py)
    }

    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        if !all_names().iter().any(|known| known == name) {
            return Err(PyAttributeError::new_err(format!("there is no setting `{name}`")));
        }
        self.to_dict(py)?.get_item(name)
    }

    fn __dir__(&self) -> Vec<String> {
        let methods = ["options", "replace", "to_dict"].map(String::from);
        all_names().into_iter().chain(methods).collect()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let own = serde_json::to_value(&self.0).unwrap_or_default();
        let default = serde_json::to_value(Settings::default()).unwrap_or_default();
        let mut parts = Vec::new();
        for (name, value) in own.as_object().into_iter().flatten().filter(|(name, v)| default.get(name) != Some(v)) {
            parts.push(format!("{name}={}", python(py, value)?.repr()?));
        }
        Ok(format!("Settings({})", parts.join(", ")))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        let py = slf.py();
        let build = py.import("interslice._native")?.getattr("_settings")?;
        Ok((build, (slf.get().to_dict(py)?,)))
    }
}

/// Settings from what `to_dict` gives.
#[pyfunction]
pub fn _settings(settings: &Bound<'_, PyDict>) -> PyResult<PySettings> {
    PySettings(Settings::default()).replace(Some(settings))
}

fn all_names() -> Vec<String> {
    names::<Settings>().into_iter().chain([LINKS.into()]).collect()
}

fn linked(links: &Bound<'_, PyAny>) -> PyResult<Vec<Link>> {
    let json = links.py().import("json")?.call_method1("dumps", (links,))?.extract::<String>()?;
    parse(&json).map_err(|e| wrong(LINKS, format!("{e}; got {json}")))
}

/// Settings, the machine, and what is left: `settings` is a base for those that are named.
pub fn settings_of(
    base: Option<PySettings>,
    preset: Option<&str>,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<(Settings, DeviceOptions, OutputOptions)> {
    let base = match (base, preset) {
        (Some(_), Some(_)) => return Err(wrong("preset", "is not for a call with `settings`".into())),
        (Some(base), None) => base,
        (None, preset) => PySettings::new(preset, None)?,
    };
    let mut options = Options::new(given)?;
    let settings = options.settings(base.0)?;
    let device = options.claim(DeviceOptions::default())?;
    let output = options.claim(OutputOptions::default())?;
    options.finish()?;
    settings.validate().map_err(raised)?;
    output.check_ranges().map_err(raised)?;
    Ok((settings, device, output))
}

/// Refuses options of outputs in a call that has none.
pub fn no_outputs(output: &OutputOptions, why: &str) -> PyResult<()> {
    let [given, default] = [output, &OutputOptions::default()].map(serde_json::to_value);
    match (given, default) {
        (Ok(given), Ok(default)) if given == default => Ok(()),
        _ => Err(wrong("options", format!("of outputs are not for {why}"))),
    }
}

/// Options of reading a file.
pub fn read_options(given: Option<&Bound<'_, PyDict>>) -> PyResult<ReadOptions> {
    let mut options = Options::new(given)?;
    let read = options.claim(ReadOptions::default())?;
    options.finish()?;
    Ok(read)
}

/// Options of one kind as clap knows them.
fn told<T: Args>(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let list = PyList::empty(py);
    let command = T::augment_args(Command::new("options"));
    for argument in command.get_arguments() {
        let entry = PyDict::new(py);
        entry.set_item("name", argument.get_id().as_str())?;
        let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
        entry.set_item("help", argument.get_long_help().map_or(help, ToString::to_string))?;
        let default = argument.get_default_values().first().map(|v| v.to_string_lossy().into_owned());
        entry.set_item("default", default)?;
        let choices = argument.get_possible_values();
        let choices: Vec<String> = choices.iter().map(|choice| choice.get_name().to_string()).collect();
        entry.set_item("choices", choices)?;
        list.append(entry)?;
    }
    Ok(list)
}

/// Names of the options that `read` takes, of the machine's, and of the outputs'.
#[pyfunction]
pub fn _names(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("settings", all_names())?;
    dict.set_item("read", names::<ReadOptions>())?;
    dict.set_item("machine", names::<DeviceOptions>())?;
    dict.set_item("output", names::<OutputOptions>())?;
    Ok(dict)
}
