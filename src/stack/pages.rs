//! Multi-page TIFF label volumes: a page is a slice across z. Spacing as OME-TIFF or ImageJ write it.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingSampleType, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

use super::ome::{Described, describe};
use super::volume::data::Data;
use super::volume::element::Element;
use super::volume::{Failure, Grid, Volume};
use crate::error::{Error, Result};
use crate::memory;

/// Longest description, e.g. OME-XML with an entry per plane.
const LONGEST_DESCRIPTION: usize = 1 << 26;

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

type Source = Decoder<BufReader<File>>;

fn decoder(path: &Path) -> Failure<Source> {
    let unreadable = |e: io::Error| format!("cannot read: {e}");
    let file = File::open(path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    let mut limits = Limits::default();
    limits.ifd_value_size = LONGEST_DESCRIPTION.min(usize::try_from(length).unwrap_or(usize::MAX));
    Ok(Decoder::new(BufReader::new(file)).map_err(told)?.with_limits(limits))
}

fn told(e: TiffError) -> String {
    format!("TIFF: {e}")
}

/// Size and type of the decoder's page.
fn page(decoder: &mut Source) -> Failure<([usize; 2], Element)> {
    let (width, height) = decoder.dimensions().map_err(told)?;
    let color = decoder.colortype().map_err(told)?;
    let ColorType::Gray(bits @ (8 | 16 | 32 | 64)) = color else {
        return Err(format!("is {color:?}; a label volume has grey pages of 8, 16, 32 or 64 bits"));
    };
    let layout = decoder.image_buffer_layout().map_err(told)?;
    let size = usize::from(bits) / 8;
    let element = match layout.sample_type {
        Some(DecodingSampleType::F32) => Element::Float,
        Some(DecodingSampleType::F64) => Element::Double,
        Some(DecodingSampleType::I8 | DecodingSampleType::I16 | DecodingSampleType::I32 | DecodingSampleType::I64) => {
            Element::Int { size, signed: true }
        }
        Some(DecodingSampleType::F16) | None => return Err("has voxels of 16-bit floats or of no known type".into()),
        Some(_) => Element::Int { size, signed: false },
    };
    Ok(([width as usize, height as usize], element))
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
    let mut grid = Grid::unspaced([nx, ny, count]);
    let Described { format, spacing } = describe(&description, [nx, ny, count], per_unit)?;
    if let Some((sides, unit)) = spacing {
        grid.steps = [[sides[0], 0.0, 0.0], [0.0, sides[1], 0.0], [0.0, 0.0, sides[2]]];
        (grid.unit, grid.spaced) = (unit, true);
    }
    let bytes = nx.checked_mul(ny).and_then(|n| n.checked_mul(element.size()));
    let bytes = bytes.ok_or_else(|| format!("page 0: {nx}x{ny} px are too many"))?;
    memory::check_room(bytes as f64).map_err(|m| format!("page 0: {nx}x{ny} px {m}"))?;
    let data = Data::Pages { file: path.into(), count, bytes };
    // The decoder gives the machine's own byte order.
    let big_endian = cfg!(target_endian = "big");
    Ok(Volume {
        path: path.into(),
        format,
        grid,
        element,
        big_endian,
        stored: [0, 1, 2],
        notes: Vec::new(),
        scale: None,
        segments: Default::default(),
        data,
    })
}

/// The voxels of all pages, one page in memory.
pub(super) struct Pages {
    decoder: Source,
    /// Pages that were decoded, and all.
    done: usize,
    count: usize,
    /// The page, and how much of it was given away.
    page: Vec<u8>,
    used: usize,
}

impl Pages {
    /// `count` pages of `bytes` each.
    pub(super) fn open(path: &Path, count: usize, bytes: usize) -> Failure<Self> {
        Ok(Pages { decoder: decoder(path)?, done: 0, count, page: vec![0; bytes], used: bytes })
    }

    fn next(&mut self) -> Failure<()> {
        if self.done > 0 {
            self.decoder.next_image().map_err(told)?;
        }
        let layout = self.decoder.image_buffer_layout().map_err(told)?;
        if layout.complete_len != self.page.len() {
            return Err(format!("{} bytes, but page 0 has {}", layout.complete_len, self.page.len()));
        }
        self.decoder.read_image_bytes(&mut self.page).map_err(told)?;
        (self.done, self.used) = (self.done + 1, 0);
        Ok(())
    }
}

impl Read for Pages {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.page.len() {
            if self.done == self.count {
                return Ok(0);
            }
            let page = self.done;
            self.next().map_err(|m| io::Error::other(format!("page {page}: {m}")))?;
        }
        let n = out.len().min(self.page.len() - self.used);
        out[..n].copy_from_slice(&self.page[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}
