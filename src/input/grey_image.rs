//! One grey image, 8 or 16 bit PNG or TIFF, that takes no more memory than its pixels do, whatever its file says or holds beside them.

use std::io::{BufRead, Cursor, Seek};
use std::path::Path;

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

use super::volume::tiff_lzw::unpacked;
use super::volume::tiff_pages::decoder;
use crate::storage::regular;
use crate::storage::room::check_room;

/// Bytes that colour profiles and texts of an image may take, unpacked: a profile of 1 MB can unpack to 1 GB.
const BESIDE: u64 = 16 << 20;
/// Bytes of a decoded pixel at most: four channels of 16 bits.
const PIXEL: u64 = 8;

/// A grey image.
pub struct Grey {
    /// Columns and rows.
    pub dims: [usize; 2],
    /// Bits of a value as the file has it.
    pub bits: u8,
    /// Values, row by row.
    pub values: Vec<u16>,
}

impl Grey {
    /// Reads an image.
    ///
    /// # Errors
    /// What is wrong with the file, without its name.
    pub fn read(path: &Path) -> Result<Self, String> {
        regular::check(path).map_err(|e| format!("cannot read: {e}"))?;
        let unreadable = |e: image::ImageError| match e {
            image::ImageError::IoError(e) => format!("cannot read: {e}"),
            e => e.to_string(),
        };
        let open = |bytes: u64| {
            let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
            reader.map(|reader| within(reader, bytes)).map_err(|e| format!("cannot read: {e}"))
        };
        let reader = open(BESIDE)?;
        let is_tiff = reader.format() == Some(ImageFormat::Tiff);
        let (columns, rows) = reader.into_dimensions().map_err(unreadable)?;
        let pixels = u64::from(columns) * u64::from(rows);
        let bytes = PIXEL.saturating_mul(pixels);
        check_room(bytes as f64).map_err(|more| format!("{columns}x{rows} px {more}"))?;
        let bytes = bytes.saturating_add(BESIDE);
        let unpacked = if is_tiff { unpacked(&mut decoder(path)?)? } else { None };
        let image = match unpacked {
            Some(file) => within(ImageReader::with_format(Cursor::new(file), ImageFormat::Tiff), bytes).decode(),
            None => open(bytes)?.decode(),
        };
        let image = image.map_err(unreadable)?;
        Self::of(image)
    }

    fn of(image: DynamicImage) -> Result<Self, String> {
        let dims = [image.width() as usize, image.height() as usize];
        match image {
            DynamicImage::ImageLuma8(i) => {
                Ok(Grey { dims, bits: 8, values: i.into_raw().into_iter().map(u16::from).collect() })
            }
            DynamicImage::ImageLuma16(i) => Ok(Grey { dims, bits: 16, values: i.into_raw() }),
            // Colour images whose channels agree are grey images that some program saved as colour.
            DynamicImage::ImageRgb8(_) | DynamicImage::ImageRgba8(_) | DynamicImage::ImageLumaA8(_) => {
                let rgba = image.to_rgba8();
                if let Some((x, y, p)) =
                    rgba.enumerate_pixels().find(|(_, _, p)| p[0] != p[1] || p[1] != p[2] || p[3] != 255)
                {
                    let [r, g, b, a] = p.0;
                    return Err(format!(
                        "pixel ({x}, {y}) is coloured or transparent ({r}, {g}, {b}, {a}); a slice must be a grey image (`label` and `labels` take the numbers of \
                         a PNG with a palette)"
                    ));
                }
                Ok(Grey { dims, bits: 8, values: rgba.pixels().map(|p| u16::from(p[0])).collect() })
            }
            other => {
                let color = other.color();
                let (channels, bits) =
                    (color.channel_count(), color.bits_per_pixel() / u16::from(color.channel_count()));
                Err(format!(
                    "pixels have {channels} channels of {bits} bits; a slice must be a grey image of 8 or 16 bits"
                ))
            }
        }
    }
}

/// A reader that takes no more bytes than these.
fn within<R: BufRead + Seek>(mut reader: ImageReader<R>, bytes: u64) -> ImageReader<R> {
    let mut limits = Limits::default();
    limits.max_alloc = Some(bytes);
    reader.limits(limits);
    reader
}

#[cfg(test)]
mod tests {
    use tiff::encoder::{TiffEncoder, colortype::Gray8};

    use super::Grey;

    /// Unlike a label, a grey value is how bright a pixel is shown.
    #[test]
    fn white_is_the_largest_value_also_where_it_is_zero_in_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mask.tif");
        let mut file = Vec::new();
        let mut encoder = TiffEncoder::new(std::io::Cursor::new(&mut file)).expect("it begins");
        encoder.write_image::<Gray8>(3, 1, &[0, 5, 255]).expect("a page");
        for (white, wanted) in [(false, [0, 5, 255]), (true, [255, 250, 0])] {
            // The entry of tag 262, a short: black is 0 becomes white is 0.
            let entry = |value: u8| [6, 1, 3, 0, 1, 0, 0, 0, value, 0];
            let at = file.windows(10).position(|w| w == entry(1)).expect("it is there");
            let mut bytes = file.clone();
            bytes[at..at + 10].copy_from_slice(&entry(u8::from(!white)));
            std::fs::write(&path, &bytes).expect("it is written");
            assert_eq!(Grey::read(&path).expect("a grey image").values, wanted);
        }
    }
}
