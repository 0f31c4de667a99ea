//! A body that is in memory, into files.

use std::path::{Path, PathBuf};

use super::options::OutputOptions;
use super::outputs::Outputs;
use super::pending::Temporary;
use super::places::Places;
use crate::error::Result;
use crate::progress::Stop;
use crate::surface::Reconstruction;
use crate::surface::stream::LayerSink;

/// Writes a body into files whose formats their extensions say (`docs/formats.md`): volumes, meshes, pictures, contours, reports. The files
/// have temporary names until all are complete.
///
/// # Errors
/// [`Error::Output`](crate::Error::Output) for a name that no format has or that cannot be written, before anything is;
/// [`Error::Write`](crate::Error::Write).
pub fn write(body: &Reconstruction, paths: &[impl AsRef<Path>]) -> Result<Vec<PathBuf>> {
    write_with(body, paths, &OutputOptions::default(), &mut Places::default(), Stop::default())
}

/// The same with options, into none of the `places` that are read. Where `stop` is asked for, all files stay as they were.
///
/// # Errors
/// The errors of [`write()`]; [`Error::Interrupted`](crate::Error::Interrupted).
pub fn write_with(
    body: &Reconstruction,
    paths: &[impl AsRef<Path>],
    options: &OutputOptions,
    places: &mut Places,
    stop: Stop,
) -> Result<Vec<PathBuf>> {
    options.check_ranges()?;
    options.check_unit(&body.unit)?;
    let paths: Vec<PathBuf> = paths.iter().map(|path| path.as_ref().into()).collect();
    let mut outputs = Outputs::open(&paths, None, Temporary::Random, places)?.until(stop);
    outputs.check(options)?;
    let mut sink = outputs.sink(options);
    sink.begin(&body.header())?;
    body.layers.iter().try_for_each(|layer| sink.layer(layer.clone()))?;
    drop(sink);
    outputs.complete(&mut body.report.clone())?;
    outputs.rename()
}
