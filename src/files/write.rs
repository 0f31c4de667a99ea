//! A body that is in memory, into files.

use std::path::{Path, PathBuf};

use super::format::Format;
use super::options::OutputOptions;
use super::outputs::Outputs;
use super::pending::Temporary;
use super::places::Places;
use crate::error::{Error, Result};
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
    check_heights(body, &paths)?;
    let mut sink = outputs.sink(options);
    sink.begin(&body.header())?;
    body.layers.iter().try_for_each(|layer| sink.layer(layer.clone()))?;
    drop(sink);
    outputs.complete(&mut body.report.clone())?;
    outputs.rename()
}

/// Distances of layers this near to each other, relatively, are the same.
const SAME: f64 = 1e-6;

/// Refuses volumes of layers that lie unevenly: a volume has one distance of its layers. An array in a `.npy` says nothing of heights.
fn check_heights(body: &Reconstruction, paths: &[PathBuf]) -> Result<()> {
    let z: Vec<f64> = body.layers.iter().filter(|layer| layer.output).map(|layer| layer.z).collect();
    let [Some(first), Some(last)] = [z.first(), z.last()] else { return Ok(()) };
    let step = (last - first) / (z.len().max(2) - 1) as f64;
    // Far from zero heights have no more digits.
    let same = SAME * step + 4.0 * f64::EPSILON * first.abs().max(last.abs());
    let Some(k) = (1..z.len()).find(|k| (z[*k] - z[k - 1] - step).abs() > same) else { return Ok(()) };
    let placed = |path: &&PathBuf| {
        let is_volume = Format::of(path).is_ok_and(Format::is_volume);
        is_volume && path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("npy"))
    };
    paths.iter().find(placed).map_or(Ok(()), |path| {
        let message = format!(
            "is a volume, whose layers must lie evenly; got heights {} and {}, {} apart, where all together are {step} apart: ask for even heights, or \
             write contours (.contours.json) or an array (.npy)",
            z[k - 1],
            z[k],
            z[k] - z[k - 1]
        );
        Err(Error::Output { path: path.clone(), message })
    })
}
