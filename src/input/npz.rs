//! Label volumes as `numpy.savez` packs them (`.npz`): the array of three axes, or of more of length 1, in a ZIP of arrays. Where `spacing`, `origin` and
//! `directions` lie beside `volume`, as this program writes them, they say where it lies, each for itself.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use flate2::read::DeflateDecoder;
use glam::DVec3;
use zip::{CompressionMethod, ZipArchive};

use crate::error::{Error, Result};
use crate::input::npy;
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::grid::Failure;
use crate::input::volume::{Volume, open};
use crate::stack::axis::check_axes;
use crate::surface::npy::{PLACE, UNIT, VOLUME};

/// Most arrays that are looked at.
const MOST: usize = 4096;
/// Most letters of a unit.
const LONGEST: usize = 64;

/// Reads the headers of the arrays in a `.npz`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming array, field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let volume = volume(path, open(path)?).map_err(|message| Error::Format { path: path.into(), message })?;
    volume.check()?;
    Ok(volume)
}

/// An array in the archive.
struct Entry {
    name: String,
    header: npy::Header,
    /// Packed bytes: where they begin, and how many there are.
    start: u64,
    length: u64,
    coding: Coding,
}

/// The bytes of an array.
fn unpack(input: &mut BufReader<File>, start: u64, length: u64, coding: Coding) -> std::io::Result<Box<dyn Read + '_>> {
    input.seek(std::io::SeekFrom::Start(start))?;
    let packed = input.take(length);
    Ok(match coding {
        Coding::Deflate => Box::new(DeflateDecoder::new(packed)),
        _ => Box::new(packed),
    })
}

/// Gives a volume the place that the arrays beside it say, each for itself.
fn lay(volume: &mut Volume, place: [Option<Failure<Vec<f64>>>; 3], unit: Option<String>) -> Failure<()> {
    let [sides, origin, directions] = place.map(Option::transpose);
    let grid = &mut volume.grid;
    let (sides, mut axes) = (sides?, DVec3::AXES);
    if let Some(directions) = directions? {
        axes = [0, 3, 6].map(|row| DVec3::from_slice(&directions[row..]));
        check_axes(&axes).map_err(|m| format!("array `directions`: {m}"))?;
    }
    grid.steps = axes;
    if let Some(sides) = sides {
        if let Some(bad) = sides.iter().find(|side| **side <= 0.0) {
            return Err(format!("array `spacing` must hold three positive numbers; got {bad}"));
        }
        grid.steps = [0, 1, 2].map(|axis| sides[axis] * axes[axis]);
        (grid.unit, grid.spaced) = (unit.unwrap_or_else(|| "mm".into()), true);
    }
    if let Some(origin) = origin? {
        grid.origin = DVec3::from_slice(&origin);
    }
    Ok(())
}

fn volume(path: &Path, mut input: BufReader<File>) -> Failure<Volume> {
    let mut archive = ZipArchive::new(&mut input).map_err(|e| format!("is no ZIP of arrays: {e}"))?;
    if archive.len() > MOST {
        return Err(format!("has {} arrays; at most {MOST}", archive.len()));
    }
    let mut places = Vec::new();
    for k in 0..archive.len() {
        let file = archive.by_index_raw(k).map_err(|e| format!("entry {k}: {e}"))?;
        let name = file.name().map_err(|e| format!("entry {k}: {e}"))?.into_owned();
        let Some(name) = name.strip_suffix("npy").and_then(|name| name.strip_suffix('.')).map(String::from) else {
            continue;
        };
        let coding = match file.compression() {
            CompressionMethod::Stored => Coding::Raw,
            CompressionMethod::Deflated => Coding::Deflate,
            other => return Err(format!("array `{name}` is packed by {other}; expected deflate or none")),
        };
        if file.encrypted() {
            return Err(format!("array `{name}` is encrypted"));
        }
        let start = file.data_start().ok_or_else(|| format!("array `{name}` has no place in the file"))?;
        places.push((name, start, file.compressed_size(), coding));
    }
    drop(archive);
    let (mut volumes, mut others) = (Vec::new(), Vec::new());
    let (mut place, mut unit) = ([const { None }; 3], None);
    for (name, start, length, coding) in places {
        let unread = |e| format!("array `{name}`: {e}");
        if name == UNIT {
            unit = npy::words(&mut unpack(&mut input, start, length, coding).map_err(unread)?, LONGEST);
            if unit.is_some() {
                continue;
            }
        }
        let mut array = unpack(&mut input, start, length, coding).map_err(unread)?;
        let header = npy::header(&mut array).map_err(|m| format!("array `{name}`: {m}"))?;
        if let Some((numbers, (_, shape))) = place.iter_mut().zip(PLACE).find(|(_, (own, _))| name == *own) {
            *numbers = Some(npy::numbers(&header, shape, &mut array).map_err(|m| format!("array `{name}` {m}")));
        }
        match header.sizes() {
            Some(_) => volumes.push(Entry { name, header, start, length, coding }),
            None => {
                let shape: Vec<String> = header.shape.iter().map(usize::to_string).collect();
                others.push(if shape.is_empty() {
                    format!("the number `{name}`")
                } else {
                    format!("`{name}` of {}", shape.join(" x "))
                });
            }
        }
    }
    // One of three axes is meant before those that have more, of length 1.
    let plain = |entry: &Entry| entry.header.shape.len() == 3;
    if volumes.iter().any(plain) {
        volumes.retain(plain);
    }
    let names = || volumes.iter().map(|v| format!("`{}`", v.name)).collect::<Vec<_>>().join(", ");
    match &volumes[..] {
        [one] => {
            let needed = one.header.bytes().ok_or_else(|| format!("array `{}` is too large", one.name))?;
            if one.coding == Coding::Raw && one.length < needed {
                return Err(format!("array `{}`: data end after {} of {needed} bytes", one.name, one.length));
            }
            let data = Data::Stream {
                file: path.into(),
                offset: one.start,
                coding: one.coding,
                skip: one.header.length as u64,
            };
            let mut volume =
                one.header.volume(path, "numpy arrays", data).map_err(|m| format!("array `{}`: {m}", one.name))?;
            if one.name == VOLUME {
                lay(&mut volume, place, unit)?;
            } else {
                let there = place.iter().zip(PLACE).filter_map(|(numbers, (name, _))| numbers.as_ref().and(Some(name)));
                let there: Vec<String> = there.map(|name| format!("`{name}`")).collect();
                let note = format!(
                    "{} not used: only an array `{VOLUME}` lies where they say, this one is `{}`",
                    there.join(", "),
                    one.name
                );
                volume.notes.extend((!there.is_empty()).then_some(note));
            }
            Ok(volume)
        }
        [] if others.is_empty() => Err("has no arrays".into()),
        [] => Err(format!("has no array of three axes (z, y, x), but {}", others.join(", "))),
        _ => Err(format!("has several volumes: {}; save the one that is meant by itself", names())),
    }
}
