//! A folder of masks, one file per organ, as segmentation programs write it: each file is a label that has the file's name.

use std::io::{self, Read};
use std::path::Path;

use super::contents::Contents;
use super::format::InputFormat;
use super::volume::data::{Data, fill};
use super::volume::element::{Element, Voxels};
use super::volume::grid::Failure;
use super::volume::{Layers, Volume};
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;

/// Most masks, each of which is an open file.
const MOST: usize = 512;
/// Voxels of each mask that are decoded at a time.
const RUN: usize = 1 << 12;
/// Share of a voxel by which the grids of two masks may differ.
const SAME_PLACE: f64 = 1e-3;

/// Reads the headers of the masks in a folder; where they are painted does not matter, but for 0.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] naming the mask, its grid and that of the first.
pub(super) fn read(folder: &Path) -> Result<Volume> {
    let contents = Contents::of(folder).map_err(|source| Error::Read { path: folder.into(), source })?;
    let (files, notes) = contents.masks();
    if files.len() > MOST {
        let message = format!("has {} masks; at most {MOST}", files.len());
        return Err(Error::Format { path: folder.into(), message });
    }
    let mut volumes = Vec::with_capacity(files.len());
    let mut names = Vec::new();
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some((InputFormat { kind: super::format::Kind::Volume(header), .. }, at)) = InputFormat::of_name(&name)
        else {
            continue;
        };
        let volume = header(&path)?;
        alike(volumes.first(), &volume)?;
        names.push(name[..at].to_string());
        volumes.push(volume);
    }
    let Some(first) = volumes.first() else {
        return Err(Error::Format { path: folder.into(), message: "has no masks".into() });
    };
    let (grid, stored) = (first.grid.clone(), first.stored);
    let notes = notes.into_iter().chain(first.notes.clone()).collect();
    let segments = (1..).zip(names);
    let segments = segments.map(|(n, name)| (n, Appearance { name: Some(name), ..Appearance::label(n) })).collect();
    let layers = Layers { count: volumes.len(), segments: (0..volumes.len()).map(|k| (k, 1)).collect(), only: None };
    let element = (Element::Int { size: 1, signed: false }, false);
    let volume = Volume::new(folder, "folder of masks", grid, element, Data::Masks(volumes));
    Ok(Volume { stored, notes, segments, layers: Some(layers), ..volume })
}

/// Checks that a mask has the grid of the first.
fn alike(first: Option<&Volume>, mask: &Volume) -> Result<()> {
    let Some(first) = first else { return Ok(()) };
    let fail = |message: String| Err(Error::Format { path: mask.path.clone(), message });
    let name = first.path.file_name().unwrap_or_default().to_string_lossy();
    let (a, b) = (&first.grid, &mask.grid);
    if a.dims != b.dims {
        let [own, of_first] = [b, a].map(|grid| grid.dims.map(|n| n.to_string()).join(" x "));
        return fail(format!("has {own} voxels, but {name} has {of_first}; masks of a folder have one grid"));
    }
    let within = SAME_PLACE * a.spacing().into_iter().fold(f64::INFINITY, f64::min);
    let last = |k: usize| a.dims[k] as f64;
    let off =
        (0..3).map(|k| (a.steps[k] - b.steps[k]).length() * last(k)).fold((a.origin - b.origin).length(), f64::max);
    if off > within || first.stored != mask.stored {
        return fail(format!(
            "lies elsewhere than {name}, by up to {off:.4} {}; masks of a folder have one grid",
            a.unit
        ));
    }
    Ok(())
}

/// A mask that is being read.
struct Mask {
    volume: Volume,
    input: Box<dyn Read>,
    /// The value with which it is painted, where any has been seen.
    paint: Option<i64>,
}

/// The masks side by side: for every voxel a byte of each mask, 1 where it is painted.
pub(super) struct SideBySide {
    masks: Vec<Mask>,
    /// Voxels that were decoded, and all.
    done: usize,
    count: usize,
    /// Bytes of some voxels, and how many of them were given away.
    bytes: Vec<u8>,
    used: usize,
}

impl SideBySide {
    pub fn open(volumes: &[Volume]) -> Failure<Self> {
        let open = |volume: &Volume| Ok(Mask { volume: volume.clone(), input: volume.data.open()?, paint: None });
        let masks = volumes.iter().map(open).collect::<Failure<Vec<_>>>()?;
        let count = volumes.first().map_or(0, Volume::voxels);
        Ok(SideBySide { masks, done: 0, count, bytes: Vec::new(), used: 0 })
    }

    fn next(&mut self) -> Failure<()> {
        let n = RUN.min(self.count - self.done);
        let many = self.masks.len();
        self.bytes.clear();
        self.bytes.resize(n * many, 0);
        let (mut stored, mut values) = (Vec::new(), Vec::new());
        for (k, Mask { volume, input, paint }) in self.masks.iter_mut().enumerate() {
            let size = volume.element.size();
            let wrong = |m: String| format!("{}: {m}", volume.path.display());
            stored.resize(n * size, 0);
            fill(input, &mut stored, (self.done * size) as u64, volume.bytes()).map_err(wrong)?;
            values.clear();
            let Volume { big_endian, scale, .. } = *volume;
            let voxels = Voxels { bytes: &stored, big_endian, scale, first: self.done };
            volume.element.labels(&voxels, &mut values).map_err(|e| wrong(volume.told(&e, 1)))?;
            if let Some(other) = values.iter().find(|v| **v != 0 && **v != *paint.get_or_insert(**v)) {
                let paint = paint.unwrap_or_default();
                return Err(wrong(format!(
                    "has the values {paint} and {other}; a mask in a folder of masks has one besides 0, and several labels are an input by themselves"
                )));
            }
            for (byte, value) in self.bytes.iter_mut().skip(k).step_by(many).zip(&values) {
                *byte = u8::from(*value != 0);
            }
        }
        (self.done, self.used) = (self.done + n, 0);
        Ok(())
    }
}

impl Read for SideBySide {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.bytes.len() {
            if self.done == self.count {
                return Ok(0);
            }
            self.next().map_err(io::Error::other)?;
        }
        let n = out.len().min(self.bytes.len() - self.used);
        out[..n].copy_from_slice(&self.bytes[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}
