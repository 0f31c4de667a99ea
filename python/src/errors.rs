//! Errors as Python's own, with the words of the command line.

use std::io;

use interslice::Error;
use pyo3::create_exception;
use pyo3::exceptions::{
    PyFileNotFoundError, PyMemoryError, PyOSError, PyPermissionError, PyRuntimeError, PyTypeError, PyValueError,
};
use pyo3::prelude::*;

create_exception!(
    interslice,
    GpuError,
    PyRuntimeError,
    "The GPU cannot do the work: there is none, its limits are too small, it was lost, or its self-test has failed."
);

/// Python's error for one of ours.
pub fn raised(error: Error) -> PyErr {
    let words = error.to_string();
    match &error {
        Error::Read { source, .. } | Error::Write { source, .. } => of_system(source, words),
        Error::Disk { .. } | Error::Output { .. } => PyOSError::new_err(words),
        Error::Memory { .. } => PyMemoryError::new_err(words),
        Error::Gpu(_) | Error::GpuMemory(_) => GpuError::new_err(words),
        Error::Numerics { .. } | Error::Batch { .. } | Error::Interrupted => PyRuntimeError::new_err(words),
        _ => PyValueError::new_err(words),
    }
}

fn of_system(source: &io::Error, words: String) -> PyErr {
    match source.kind() {
        io::ErrorKind::NotFound => PyFileNotFoundError::new_err(words),
        io::ErrorKind::PermissionDenied => PyPermissionError::new_err(words),
        _ => PyOSError::new_err(words),
    }
}

/// The error of a wrong value of the argument `name`.
pub fn wrong(name: &str, message: String) -> PyErr {
    raised(Error::Setting { name: name.into(), message })
}

/// The error of an argument of the wrong kind.
pub fn unlike(message: String) -> PyErr {
    PyTypeError::new_err(message)
}
