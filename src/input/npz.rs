//! Label volumes as `numpy.savez` packs them (`.npz`): the array of three axes in a ZIP of arrays.

use std::io::{BufReader, Read, Seek};
use std::path::Path;

use flate2::read::DeflateDecoder;
use zip::{CompressionMethod, ZipArchive};

use crate::error::{Error, Result};
use crate::input::npy;
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::grid::Failure;
use crate::input::volume::{Volume, open};

/// Most arrays that are looked at.
const MOST: usize = 4096;

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

fn volume(path: &Path, mut input: BufReader<std::fs::File>) -> Failure<Volume> {
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
    for (name, start, length, coding) in places {
        input.seek(std::io::SeekFrom::Start(start)).map_err(|e| format!("array `{name}`: {e}"))?;
        let packed = input.by_ref().take(length);
        let header = match coding {
            Coding::Deflate => npy::header(&mut DeflateDecoder::new(packed)),
            _ => npy::header(&mut { packed }),
        };
        let header = header.map_err(|m| format!("array `{name}`: {m}"))?;
        match header.shape.len() {
            3 => volumes.push(Entry { name, header, start, length, coding }),
            _ => {
                let shape: Vec<String> = header.shape.iter().map(usize::to_string).collect();
                others.push(if shape.is_empty() {
                    format!("the number `{name}`")
                } else {
                    format!("`{name}` of {}", shape.join(" x "))
                });
            }
        }
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
            one.header.volume(path, "numpy arrays", data).map_err(|m| format!("array `{}`: {m}", one.name))
        }
        [] if others.is_empty() => Err("has no arrays".into()),
        [] => Err(format!("has no array of three axes (z, y, x), but {}", others.join(", "))),
        _ => Err(format!("has several volumes: {}; save the one that is meant by itself", names())),
    }
}
