//! Pages of a TIFF file, decoded one at a time.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingSampleType, Limits};
use tiff::{ColorType, TiffError};

use super::element::Element;
use super::grid::Failure;
use crate::storage::regular;

/// Longest description, e.g. OME-XML with an entry per plane.
const LONGEST_DESCRIPTION: usize = 1 << 26;

pub(crate) type TiffDecoder = Decoder<BufReader<File>>;

pub(crate) fn decoder(path: &Path) -> Failure<TiffDecoder> {
    let unreadable = |e: io::Error| format!("cannot read: {e}");
    let file = regular::open(path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    let mut limits = Limits::default();
    limits.ifd_value_size = LONGEST_DESCRIPTION.min(usize::try_from(length).unwrap_or(usize::MAX));
    Ok(Decoder::new(BufReader::new(file)).map_err(told)?.with_limits(limits))
}

pub(crate) fn told(e: TiffError) -> String {
    format!("TIFF: {e}")
}

/// Size and type of the decoder's page.
pub(crate) fn page(decoder: &mut TiffDecoder) -> Failure<([usize; 2], Element)> {
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

/// The voxels of all pages, one page in memory.
pub(crate) struct Pages {
    decoder: TiffDecoder,
    /// Pages that were decoded, and all.
    done: usize,
    count: usize,
    /// The page, and how much of it was given away.
    page: Vec<u8>,
    used: usize,
}

impl Pages {
    /// `count` pages of `bytes` each.
    pub(crate) fn open(path: &Path, count: usize, bytes: usize) -> Failure<Self> {
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
