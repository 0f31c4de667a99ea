//! Pages of a TIFF file, decoded one at a time.

use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingSampleType, Limits};
use tiff::tags::{PhotometricInterpretation, Tag};
use tiff::{ColorType, TiffError};

use super::element::Element;
use super::grid::Failure;
use super::tiff_lzw::unpacked;
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

/// Pages of a bit a pixel, which are masks: read as 0 where they are black, 1 where they are white.
const BILEVEL: ColorType = ColorType::Gray(1);

/// Size and type of the decoder's page.
pub(crate) fn page(decoder: &mut TiffDecoder) -> Failure<([usize; 2], Element)> {
    let (width, height) = decoder.dimensions().map_err(told)?;
    let color = decoder.colortype().map_err(told)?;
    let size = [width, height].map(|n| n as usize);
    if color == BILEVEL {
        return Ok((size, Element::Int { size: 1, signed: false }));
    }
    let ColorType::Gray(bits @ (8 | 16 | 32 | 64)) = color else {
        return Err(format!("is {color:?}; a label volume has grey pages of 1, 8, 16, 32 or 64 bits"));
    };
    let layout = decoder.image_buffer_layout().map_err(told)?;
    let bytes = usize::from(bits) / 8;
    let element = match layout.sample_type {
        Some(DecodingSampleType::F32) => Element::Float,
        Some(DecodingSampleType::F64) => Element::Double,
        Some(DecodingSampleType::I8 | DecodingSampleType::I16 | DecodingSampleType::I32 | DecodingSampleType::I64) => {
            Element::Int { size: bytes, signed: true }
        }
        Some(DecodingSampleType::F16) | None => return Err("has voxels of 16-bit floats or of no known type".into()),
        Some(_) => Element::Int { size: bytes, signed: false },
    };
    Ok((size, element))
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
        match unpacked(&mut self.decoder)? {
            Some(file) => {
                // What it holds was checked when it was unpacked.
                let decoder = Decoder::new(Cursor::new(file)).map_err(told)?;
                decode(&mut decoder.with_limits(Limits::unlimited()), &mut self.page)?;
            }
            None => decode(&mut self.decoder, &mut self.page)?,
        }
        (self.done, self.used) = (self.done + 1, 0);
        Ok(())
    }
}

/// Decodes a page of as many bytes as `page` has.
fn decode<R: Read + Seek>(decoder: &mut Decoder<R>, page: &mut [u8]) -> Failure<()> {
    if decoder.colortype().map_err(told)? == BILEVEL {
        return decode_bits(decoder, page);
    }
    let layout = decoder.image_buffer_layout().map_err(told)?;
    if layout.complete_len != page.len() {
        return Err(format!("{} bytes, but page 0 has {}", layout.complete_len, page.len()));
    }
    decoder.read_image_bytes(page).map_err(told)?;
    let photometric = decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).map_err(told)?;
    if photometric == Some(PhotometricInterpretation::WhiteIsZero.to_u16()) {
        as_stored(page, layout.sample_type);
    }
    Ok(())
}

/// Decodes a page of a bit a pixel: rows begin at whole bytes, the first pixel in the highest bit.
fn decode_bits<R: Read + Seek>(decoder: &mut Decoder<R>, page: &mut [u8]) -> Failure<()> {
    let (width, height) = decoder.dimensions().map_err(told)?;
    let [width, height] = [width, height].map(|n| n as usize);
    let row = width.div_ceil(8);
    let length = decoder.image_buffer_layout().map_err(told)?.complete_len;
    if width == 0 || width * height != page.len() || length != row * height {
        return Err(format!("{width}x{height} px of a bit in {length} bytes, but page 0 has {} px", page.len()));
    }
    let mut packed = vec![0; length];
    decoder.read_image_bytes(&mut packed).map_err(told)?;
    for (pixels, bytes) in page.chunks_exact_mut(width).zip(packed.chunks_exact(row)) {
        pixels.iter_mut().enumerate().for_each(|(i, pixel)| *pixel = bytes[i / 8] >> (7 - i % 8) & 1);
    }
    Ok(())
}

/// Undoes what the decoder does to pages that are shown with white as 0: a label is the number in the file, however it is shown.
fn as_stored(page: &mut [u8], samples: Option<DecodingSampleType>) {
    match samples {
        Some(DecodingSampleType::F32) => page.as_chunks_mut().0.iter_mut().for_each(|v| {
            *v = (1.0 - f32::from_ne_bytes(*v)).to_ne_bytes();
        }),
        Some(DecodingSampleType::F64) => page.as_chunks_mut().0.iter_mut().for_each(|v| {
            *v = (1.0 - f64::from_ne_bytes(*v)).to_ne_bytes();
        }),
        _ => page.iter_mut().for_each(|v| *v = !*v),
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

#[cfg(test)]
mod tests {
    use tiff::encoder::TiffEncoder;
    use tiff::encoder::colortype::{Gray8, Gray32Float};

    use super::*;

    #[test]
    fn pages_of_bits_are_one_where_they_are_white() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mask.tif");
        let mut encoder = TiffEncoder::new(File::create(&path).expect("a file")).expect("it begins");
        let mut pages = [[true; 33]; 2];
        pages[0] = std::array::from_fn(|k| k % 3 == 0 || k == 10);
        pages[1] = std::array::from_fn(|k| k > 4 && k < 29);
        for page in &pages {
            let row = |row: &[bool]| -> Vec<u8> {
                row.chunks(8)
                    .map(|eight| eight.iter().enumerate().fold(0, |b, (i, p)| b | u8::from(*p) << (7 - i)))
                    .collect()
            };
            let packed: Vec<u8> = page.chunks(11).flat_map(row).collect();
            let mut directory = encoder.image_directory().expect("a page");
            let data = directory.write_data(&packed[..]).expect("its pixels");
            let shorts = [
                (Tag::ImageWidth, 11),
                (Tag::ImageLength, 3),
                (Tag::BitsPerSample, 1),
                (Tag::SamplesPerPixel, 1),
                (Tag::RowsPerStrip, 3),
                (Tag::PhotometricInterpretation, PhotometricInterpretation::BlackIsZero.to_u16()),
            ];
            shorts.into_iter().for_each(|(tag, value): (Tag, u16)| directory.write_tag(tag, value).expect("a tag"));
            directory.write_tag(Tag::StripOffsets, data as u32).expect("a tag");
            directory.write_tag(Tag::StripByteCounts, packed.len() as u32).expect("a tag");
            directory.finish().expect("a page");
        }
        let mut opened = decoder(&path).expect("it opens");
        assert_eq!(page(&mut opened), Ok(([11, 3], Element::Int { size: 1, signed: false })));
        let mut bytes = Vec::new();
        Pages::open(&path, 2, 33).and_then(|mut p| p.read_to_end(&mut bytes).map_err(|e| e.to_string())).expect("read");
        assert_eq!(bytes, pages.as_flattened().iter().map(|p| u8::from(*p)).collect::<Vec<_>>());
    }

    #[test]
    fn labels_that_are_shown_with_white_as_zero_are_the_numbers_in_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("labels.tif");
        let mut file = Vec::new();
        let mut encoder = TiffEncoder::new(std::io::Cursor::new(&mut file)).expect("it begins");
        encoder.write_image::<Gray8>(3, 1, &[0, 5, 255]).expect("a page");
        encoder.write_image::<Gray32Float>(2, 1, &[0.25, -1.0]).expect("a page");
        // The entry of tag 262, a short: black is 0 becomes white is 0.
        let (black, white) = ([6, 1, 3, 0, 1, 0, 0, 0, 1, 0], [6, 1, 3, 0, 1, 0, 0, 0, 0, 0]);
        let places: Vec<usize> = (0..file.len() - 10).filter(|k| file[*k..*k + 10] == black).collect();
        assert_eq!(places.len(), 2);
        places.into_iter().for_each(|k| file[k..k + 10].copy_from_slice(&white));
        std::fs::write(&path, &file).expect("it is written");
        let mut bytes = Vec::new();
        Pages::open(&path, 1, 3).and_then(|mut p| p.read_to_end(&mut bytes).map_err(|e| e.to_string())).expect("read");
        assert_eq!(bytes, [0, 5, 255]);
        let mut pages = Pages::open(&path, 1, 8).expect("it opens");
        pages.decoder.next_image().expect("there is a second page");
        bytes.clear();
        pages.read_to_end(&mut bytes).expect("read");
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&bytes), [0.25, -1.0]);
    }
}
