//! TIFFs that are packed by LZW, in strips and tiles, as other programs write them.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use tiff::encoder::TiffEncoder;
use tiff::tags::{CompressionMethod, Tag};
use weezl::BitOrder;

use crate::files::folder;
use interslice::input::{Input, read_surveyed};
use interslice::stack::ReadOptions;

/// Columns and rows.
type Size = [usize; 2];

/// How pages are written.
#[derive(Debug, Clone, Copy)]
struct Packing {
    /// Size of a tile; nothing for strips of five rows.
    tile: Option<Size>,
    /// Whether the codes end with the one that says so.
    ended: bool,
    /// Whether differences along rows are packed.
    predicted: bool,
}

/// Bytes of the chunk that begins at this pixel.
fn chunk([x, y]: Size, [w, h]: Size, predicted: bool, at: &dyn Fn(usize, usize) -> u16) -> Vec<u8> {
    let row = |j: usize| {
        let row: Vec<u16> = (x..x + w).map(|i| at(i, j)).collect();
        let before = |k: usize| if predicted && k > 0 { row[k - 1] } else { 0 };
        (0..w).flat_map(|k| row[k].wrapping_sub(before(k)).to_ne_bytes()).collect::<Vec<u8>>()
    };
    (y..y + h).flat_map(row).collect()
}

/// Writes a page of 16-bit numbers, as often as there are `pages`.
fn write(path: &Path, pages: usize, [w, h]: Size, packing: Packing, at: impl Fn(usize, usize) -> u16) {
    let Packing { tile, ended, predicted } = packing;
    let mut file = Vec::new();
    let mut encoder = TiffEncoder::new(Cursor::new(&mut file)).expect("it begins");
    let within = |i: usize, j: usize| if i < w && j < h { at(i, j) } else { 0 };
    for _ in 0..pages {
        let mut directory = encoder.image_directory().expect("a page");
        let [across, down] = tile.unwrap_or([w, 5]);
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for y in (0..h).step_by(down) {
            for x in (0..w).step_by(across) {
                let rows = if tile.is_some() { down } else { down.min(h - y) };
                let bytes = chunk([x, y], [across, rows], predicted, &within);
                let mut encoder = weezl::encode::Encoder::with_tiff_size_switch(BitOrder::Msb, 8);
                let mut codes = encoder.encode(&bytes).expect("memory can be written");
                if !ended {
                    // The code of the end takes 9 to 12 bits: the last byte is its own.
                    codes.pop();
                }
                offsets.push(directory.write_data(&codes[..]).expect("its codes") as u32);
                counts.push(codes.len() as u32);
            }
        }
        let (places, lengths) = match tile {
            Some(_) => (Tag::TileOffsets, Tag::TileByteCounts),
            None => (Tag::StripOffsets, Tag::StripByteCounts),
        };
        let sizes = match tile {
            Some([across, down]) => vec![(Tag::TileWidth, across), (Tag::TileLength, down)],
            None => vec![(Tag::RowsPerStrip, down)],
        };
        let shorts = [
            (Tag::ImageWidth, w),
            (Tag::ImageLength, h),
            (Tag::BitsPerSample, 16),
            (Tag::Compression, CompressionMethod::LZW.to_u16().into()),
            (Tag::PhotometricInterpretation, 1),
            (Tag::Predictor, if predicted { 2 } else { 1 }),
        ];
        for (tag, value) in shorts.into_iter().chain(sizes) {
            directory.write_tag(tag, value as u16).expect("a tag");
        }
        directory.write_tag(places, &offsets[..]).expect("a tag");
        directory.write_tag(lengths, &counts[..]).expect("a tag");
        directory.finish().expect("a page");
    }
    fs::write(path, file).expect("it is written");
}

/// Ways to pack, and sizes that do not end with their chunks.
fn each(mut case: impl FnMut(Size, Packing)) {
    for size in [[32, 32], [37, 29], [64, 96]] {
        for tile in [None, Some([16, 16]), Some([32, 64]), Some([64, 128])] {
            for (ended, predicted) in [(true, false), (true, true), (false, false)] {
                case(size, Packing { tile, ended, predicted });
            }
        }
    }
}

fn disc(i: usize, j: usize) -> u16 {
    u16::from(i.abs_diff(17).pow(2) + j.abs_diff(15).pow(2) < 130)
}

#[test]
fn pages_are_read_whatever_the_last_codes_of_their_chunks_are() {
    let folder = folder();
    let path = folder.path().join("labels.tif");
    let options = ReadOptions { spacing: Some(vec![1.0; 3]), ..ReadOptions::default() };
    let patterns: [fn(usize, usize) -> u16; 4] = [
        disc,
        |i, j| 300 * disc(i, j),
        |i, j| u16::from((4..20).contains(&i) && (7..23).contains(&j)),
        |i, j| (i * 7919 + j * 104_729 + i * j * 31) as u16 / 7 % 3,
    ];
    each(|size, packing| {
        for at in patterns {
            write(&path, 2, size, packing, at);
            let surveyed = read_surveyed(&path, &options).unwrap_or_else(|e| panic!("{size:?}, {packing:?}: {e}"));
            let mut pixels = 0;
            let labels = surveyed.1.expect("a volume").volume.labels(|run| {
                for (n, value) in run.values.iter().enumerate() {
                    let mut place = run.first;
                    place[run.along] += n;
                    assert_eq!(*value, i64::from(at(place[0], place[1])), "{size:?}, {packing:?}, {place:?}");
                    pixels += 1;
                }
            });
            labels.expect("it can be decoded again");
            assert_eq!(pixels, 2 * size[0] * size[1]);
        }
    });
}

#[test]
fn slices_are_read_so_too() {
    let folder = folder();
    let options = ReadOptions { spacing: Some(vec![1.0; 3]), ..ReadOptions::default() };
    each(|size, packing| {
        for name in ["s0.tif", "s1.tif"] {
            write(&folder.path().join(name), 1, size, packing, |i, j| 300 * disc(i, j));
        }
        let input = Input::read(folder.path(), &options).unwrap_or_else(|e| panic!("{size:?}, {packing:?}: {e}"));
        let inside = |n: usize| disc(n % size[0], n / size[0]) == 1;
        for slice in &input.stack.slices {
            assert!((0..size[0] * size[1]).all(|n| slice.content.inside(n) == inside(n)), "{size:?}, {packing:?}");
        }
    });
}

/// What is cut off is no page.
#[test]
fn codes_that_stand_for_too_little_are_refused() {
    let folder = folder();
    let path = folder.path().join("labels.tif");
    let options = ReadOptions { spacing: Some(vec![1.0; 3]), ..ReadOptions::default() };
    write(&path, 2, [32, 32], Packing { tile: Some([16, 16]), ended: true, predicted: false }, disc);
    let sound = fs::read(&path).expect("it was written");
    // The first chunk begins with a clear code; with the end in its place nothing follows.
    let at = 8;
    assert_eq!(sound[at], 0x80, "the first of 9 bits");
    let ended = [&sound[..at], &[0x80, 0xc0], &sound[at + 2..]].concat();
    fs::write(&path, ended).expect("it is written");
    let told = read_surveyed(&path, &options).expect_err("it is cut off").to_string();
    assert!(told.contains("page 0: chunk 0: LZW: the codes stand for "), "{told}");
}
