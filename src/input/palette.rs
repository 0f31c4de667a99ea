//! A PNG whose pixels are numbers of colours in a palette: the numbers, not the colours.

use std::io::BufReader;
use std::path::Path;

use png::{ColorType, Decoder, DecodingError, Limits, Transformations};

use super::volume::grid::Failure;
use crate::storage::regular;
use crate::storage::room::check_room;

/// How a PNG begins.
const MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Bytes that what is beside the pixels may take, unpacked.
const BESIDE: usize = 16 << 20;

/// An image of numbers, and the colours that stand for them.
pub(super) struct Indexed {
    /// Columns and rows.
    pub dims: [usize; 2],
    /// Numbers, row by row.
    pub numbers: Vec<u8>,
    /// Red, green and blue of each number.
    pub palette: Vec<[u8; 3]>,
}

impl Indexed {
    /// Reads an image; nothing where it is none of numbers, or all of its colours are grey: then it is a grey image that some program saved so.
    ///
    /// # Errors
    /// What is wrong with the file, without its name.
    pub fn read(path: &Path) -> Failure<Option<Self>> {
        if regular::begin(path, MAGIC.len() as u64).map_err(|e| format!("cannot read: {e}"))? != MAGIC {
            return Ok(None);
        }
        let unreadable = |e: DecodingError| format!("cannot read: {e}");
        let file = BufReader::new(regular::open(path).map_err(|e| format!("cannot read: {e}"))?);
        let mut decoder = Decoder::new_with_limits(file, Limits { bytes: BESIDE });
        decoder.set_transformations(Transformations::IDENTITY);
        if decoder.read_header_info().map_err(unreadable)?.color_type != ColorType::Indexed {
            return Ok(None);
        }
        let mut reader = decoder.read_info().map_err(unreadable)?;
        let info = reader.info();
        let (dims, bits) = ([info.width, info.height].map(|n| n as usize), info.bit_depth as usize);
        let palette: Vec<[u8; 3]> = info.palette.iter().flat_map(|p| p.as_chunks().0).copied().collect();
        if palette.iter().all(|[r, g, b]| r == g && g == b) {
            return Ok(None);
        }
        let length = reader.output_buffer_size().unwrap_or(usize::MAX);
        check_room(length as f64 + dims[0] as f64 * dims[1] as f64)
            .map_err(|m| format!("{}x{} px {m}", dims[0], dims[1]))?;
        let mut packed = vec![0; length];
        reader.next_frame(&mut packed).map_err(unreadable)?;
        // Numbers of fewer bits share bytes, the first in the upper ones; each row begins with a byte of its own.
        let stride = (dims[0] * bits).div_ceil(8).max(1);
        let number = |row: &[u8], i: usize| {
            let byte = row[i * bits / 8];
            byte >> (8 - bits - i * bits % 8) & (u8::MAX >> (8 - bits))
        };
        let rows = packed.chunks(stride).take(dims[1]);
        let numbers = rows.flat_map(|row| (0..dims[0]).map(move |i| number(row, i))).collect();
        Ok(Some(Indexed { dims, numbers, palette }))
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use png::{BitDepth, Encoder};

    use super::*;

    fn read(bits: BitDepth, width: u32, packed: &[u8], palette: &[u8]) -> Option<Indexed> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        let mut encoder = Encoder::new(File::create(&path).expect("a file"), width, 2);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(bits);
        encoder.set_palette(palette.to_vec());
        encoder.write_header().and_then(|mut w| w.write_image_data(packed)).expect("it is written");
        Indexed::read(&path).expect("it is sound")
    }

    #[test]
    fn numbers_are_read_and_not_their_colours() {
        let colours = [[0; 3], [128, 0, 0], [0, 128, 0], [128, 128, 0]].concat();
        let wanted = [0, 1, 2, 3, 3, 0, 2, 1, 0, 1];
        let two = read(BitDepth::Two, 5, &[0b0001_1011, 0b1100_0000, 0b0010_0100, 0b0100_0000], &colours);
        let whole = read(BitDepth::Eight, 5, &wanted, &colours);
        for image in [two, whole] {
            let image = image.expect("an image of numbers");
            assert_eq!((image.dims, &image.numbers[..], image.palette[1]), ([5, 2], &wanted[..], [128, 0, 0]));
        }
        assert!(read(BitDepth::One, 3, &[0b0100_0000, 0], &[0, 0, 0, 255, 255, 255]).is_none(), "black and white");
    }
}
