//! Values between Python and the options and reports of the program.

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};

use crate::errors::{unlike, wrong};

/// A Python value as options have it; `None` says nothing.
pub fn value(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Option<toml::Value>> {
    if given.is_none() {
        return Ok(None);
    }
    if let Ok(text) = given.cast::<PyString>() {
        return Ok(Some(toml::Value::String(text.extract()?)));
    }
    if let Ok(answer) = given.extract::<bool>() {
        return Ok(Some(toml::Value::Boolean(answer)));
    }
    if given.cast::<PyFloat>().is_err() && given.hasattr("__index__")? && !given.hasattr("__len__")? {
        let number = given.extract().map_err(|_| wrong(name, format!("is a number beyond 64 bits; got {given}")))?;
        return Ok(Some(toml::Value::Integer(number)));
    }
    if let Ok(number) = given.extract::<f64>() {
        return Ok(Some(toml::Value::Float(number)));
    }
    if given.hasattr("__fspath__")? {
        return Ok(Some(toml::Value::String(given.call_method0("__fspath__")?.extract()?)));
    }
    if let Ok(dict) = given.cast::<PyDict>() {
        let mut table = toml::Table::new();
        for (key, of_key) in dict {
            if let Some(value) = value(name, &of_key)? {
                table.insert(key.extract()?, value);
            }
        }
        return Ok(Some(toml::Value::Table(table)));
    }
    if let Ok(items) = given.try_iter() {
        let mut all = Vec::new();
        for item in items {
            all.extend(value(name, &item?)?);
        }
        return Ok(Some(toml::Value::Array(all)));
    }
    let kind = given.get_type().name()?;
    Err(unlike(format!("`{name}` must be a number, a text, True, False or a list; got {kind}")))
}

/// JSON as Python's own values.
pub fn python<'py>(py: Python<'py>, json: &serde_json::Value) -> PyResult<Bound<'py, PyAny>> {
    use serde_json::Value;
    match json {
        Value::Null => Ok(py.None().into_bound(py)),
        Value::Bool(answer) => Ok(PyBool::new(py, *answer).to_owned().into_any()),
        Value::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => Ok(PyInt::new(py, whole).into_any()),
            (_, Some(whole)) => Ok(PyInt::new(py, whole).into_any()),
            _ => number.as_f64().into_bound_py_any(py),
        },
        Value::String(text) => Ok(PyString::new(py, text).into_any()),
        Value::Array(items) => {
            let items = items.iter().map(|item| python(py, item)).collect::<PyResult<Vec<_>>>()?;
            Ok(PyList::new(py, items)?.into_any())
        }
        Value::Object(fields) => {
            let dict = PyDict::new(py);
            for (key, of_key) in fields {
                dict.set_item(key, python(py, of_key)?)?;
            }
            Ok(dict.into_any())
        }
    }
}

/// Something that can be written as JSON, as Python's own values.
pub fn report<'py>(py: Python<'py>, of: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let json = serde_json::to_value(of).map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))?;
    python(py, &json)
}
