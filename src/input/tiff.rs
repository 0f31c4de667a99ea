//! Multi-page TIFF label volumes: a page is a slice across z. Spacing as OME-TIFF or ImageJ write it.

use std::path::Path;

use glam::DVec3;
use tiff::tags::Tag;

use crate::error::{Error, Result};
use crate::input::ome::{Described, describe};
use crate::input::volume::Volume;
use crate::input::volume::data::Data;
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, VolumeGrid};
use crate::input::volume::tiff_pages::{decoder, page, told};
use crate::storage::room;

/// Reads what a `.tif`, `.tiff` says of its pages.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming page, field and value.
pub fn read(path: &Path) -> Result<Volume> {
    std::fs::metadata(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let volume = volume(path).map_err(|message| Error::Format { path: path.into(), message })?;
    volume.check()?;
    Ok(volume)
}

/// Number of pages; nothing where they cannot be counted.
pub(super) fn pages(path: &Path) -> Option<usize> {
    let mut decoder = decoder(path).ok()?;
    let mut count = 1;
    while decoder.more_images() {
        decoder.next_image().ok()?;
        count += 1;
    }
    Some(count)
}

fn volume(path: &Path) -> Failure<Volume> {
    let mut decoder = decoder(path)?;
    let first = page(&mut decoder).map_err(|m| format!("page 0: {m}"))?;
    let description = match decoder.find_tag(Tag::ImageDescription).map_err(told)? {
        Some(value) => value.into_string().map_err(told)?,
        None => String::new(),
    };
    let per_unit = [Tag::XResolution, Tag::YResolution].map(|tag| {
        let value = decoder.find_tag(tag).ok().flatten()?;
        match value {
            tiff::decoder::ifd::Value::Rational(n, d) => Some(f64::from(n) / f64::from(d)),
            _ => None,
        }
    });
    let mut count = 1;
    while decoder.more_images() {
        decoder.next_image().map_err(|e| format!("page {count}: {}", told(e)))?;
        let next = page(&mut decoder).map_err(|m| format!("page {count}: {m}"))?;
        if next != first {
            let name = |([w, h], e): ([usize; 2], Element)| format!("{w}x{h} px of {}", e.name());
            return Err(format!("page {count} is {}, but page 0 is {}", name(next), name(first)));
        }
        count += 1;
    }
    let ([nx, ny], element) = first;
    let mut grid = VolumeGrid::unspaced([nx, ny, count]);
    let Described { format, spacing, lacks } = describe(&description, [nx, ny, count], per_unit)?;
    if let Some((sides, unit)) = spacing {
        grid.steps = [sides[0] * DVec3::X, sides[1] * DVec3::Y, sides[2] * DVec3::Z];
        (grid.unit, grid.spaced) = (unit, true);
    }
    let bytes = nx.checked_mul(ny).and_then(|n| n.checked_mul(element.size()));
    let bytes = bytes.ok_or_else(|| format!("page 0: {nx}x{ny} px are too many"))?;
    room::check_room(bytes as f64).map_err(|m| format!("page 0: {nx}x{ny} px {m}"))?;
    let data = Data::Pages { file: path.into(), count, bytes };
    // The decoder gives the machine's own byte order.
    let big_endian = cfg!(target_endian = "big");
    Ok(Volume { lacks, ..Volume::new(path, format, grid, (element, big_endian), data) })
}
