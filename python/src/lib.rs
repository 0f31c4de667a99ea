//! interslice for Python: `interslice._native`, of which the package `interslice` is made.

mod array;
mod body;
mod device;
mod errors;
mod files;
mod fill;
mod running;
mod settings;
mod stack;
mod tell;
mod values;
mod volume;

use pyo3::prelude::*;

/// Large arrays on large pages, as in the program.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[global_allocator]
static ALLOCATOR: interslice::cli::OnLargePages = interslice::cli::OnLargePages;

/// What the package is made of.
#[pymodule(gil_used = false)]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("GpuError", module.py().get_type::<errors::GpuError>())?;
    module.add_class::<settings::PySettings>()?;
    module.add_class::<stack::PyStack>()?;
    module.add_class::<body::PyBody>()?;
    module.add_function(wrap_pyfunction!(settings::_settings, module)?)?;
    module.add_function(wrap_pyfunction!(settings::_names, module)?)?;
    module.add_function(wrap_pyfunction!(fill::fill, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_volume, module)?)?;
    module.add_function(wrap_pyfunction!(files::write_volume, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_rois, module)?)?;
    module.add_function(wrap_pyfunction!(stack::read, module)?)?;
    module.add_function(wrap_pyfunction!(stack::read_array, module)?)?;
    module.add_function(wrap_pyfunction!(stack::stack_of_arrays, module)?)?;
    module.add_function(wrap_pyfunction!(stack::stack_of_polygons, module)?)?;
    module.add_function(wrap_pyfunction!(body::reconstruct, module)?)?;
    module.add_function(wrap_pyfunction!(tell::inspect, module)?)?;
    module.add_function(wrap_pyfunction!(tell::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(tell::links, module)?)?;
    module.add_function(wrap_pyfunction!(tell::devices, module)?)?;
    module.add_function(wrap_pyfunction!(tell::doctor, module)?)?;
    module.add_function(wrap_pyfunction!(tell::command, module)?)?;
    Ok(())
}
