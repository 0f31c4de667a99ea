//! Pages of a TIFF that are packed by LZW, unpacked here: the decoder of the crate `tiff` refuses sound ones.
//!
//! It takes it for the end of the codes that weezl makes no progress. weezl says so, too, where a clear code or the last bytes come out of the bits
//! that it holds. The chunks become those of a TIFF in memory that is not packed: predictor, tiles and samples stay the decoder's matter.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};

use tiff::decoder::{ChunkType, Decoder};
use tiff::tags::{ByteOrder, CompressionMethod, PlanarConfiguration, Tag};
use weezl::BitOrder;
use weezl::decode::Configuration;

use super::grid::Failure;
use super::tiff_pages::told;
use crate::storage::room::check_room;

/// What the decoder asks a page for, but for its packing and the places of its chunks.
const KEPT: [Tag; 13] = [
    Tag::ImageWidth,
    Tag::ImageLength,
    Tag::BitsPerSample,
    Tag::PhotometricInterpretation,
    Tag::SamplesPerPixel,
    Tag::RowsPerStrip,
    Tag::PlanarConfiguration,
    Tag::Predictor,
    Tag::TileWidth,
    Tag::TileLength,
    Tag::ExtraSamples,
    Tag::SampleFormat,
    Tag::ChromaSubsampling,
];
/// Calls of weezl in a row that move nothing before the codes are at their end: it holds 64 bits, which are seven codes.
const IDLE_CALLS: usize = 7;
/// Bytes of codes that a byte can take: it and a clear code before it, 12 bits each.
const CODES_OF_A_BYTE: u64 = 3;
/// Bytes that end the codes.
const END: u64 = 8;

/// The decoder's page as a TIFF of its own that is not packed; nothing for a page that is not packed by LZW.
pub(crate) fn unpacked<R: Read + Seek>(decoder: &mut Decoder<R>) -> Failure<Option<Vec<u8>>> {
    let compression = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(told)?;
    if compression != Some(CompressionMethod::LZW.to_u16()) {
        return Ok(None);
    }
    let mut tags = BTreeMap::new();
    for tag in KEPT {
        if let Some(values) = decoder.find_tag_unsigned_vec::<u64>(tag).map_err(told)? {
            tags.insert(tag.to_u16(), values);
        }
    }
    let (at, of_bytes) = match decoder.get_chunk_type() {
        ChunkType::Strip => (Tag::StripOffsets, Tag::StripByteCounts),
        ChunkType::Tile => (Tag::TileOffsets, Tag::TileByteCounts),
    };
    let [places, lengths] = [at, of_bytes].map(|tag| decoder.get_tag_u64_vec(tag).map_err(told));
    let sizes = chunk_sizes(decoder, &tags)?;
    let all = sizes.iter().fold(HEADER as u64, |sum, size| sum.saturating_add(*size));
    check_room(all as f64).map_err(|more| format!("its chunks, unpacked, {more}"))?;
    let mut file = vec![0; HEADER];
    let mut offsets = Vec::new();
    for (chunk, ((place, length), size)) in places?.into_iter().zip(lengths?).zip(&sizes).enumerate() {
        let mut codes = Vec::new();
        // Chunks may say that they all go on to the end of the file.
        let length = length.min(size.saturating_mul(CODES_OF_A_BYTE).saturating_add(END));
        let source = decoder.inner();
        let read = source.seek(SeekFrom::Start(place)).and_then(|_| source.take(length).read_to_end(&mut codes));
        read.map_err(|e| format!("chunk {chunk}: cannot read: {e}"))?;
        offsets.push(file.len() as u64);
        unpack(&codes, &mut file, *size as usize).map_err(|m| format!("chunk {chunk}: LZW: {m}"))?;
    }
    tags.insert(at.to_u16(), offsets);
    tags.insert(of_bytes.to_u16(), sizes);
    directory(&mut file, decoder.byte_order(), &tags);
    Ok(Some(file))
}

/// Bytes that the decoder reads of each chunk: whole rows, as many as lie on the page.
fn chunk_sizes<R: Read + Seek>(decoder: &mut Decoder<R>, tags: &BTreeMap<u16, Vec<u64>>) -> Failure<Vec<u64>> {
    let first = |tag: Tag| tags.get(&tag.to_u16()).and_then(|values| values.first()).copied();
    let (width, height) = decoder.dimensions().map_err(told)?;
    let (chunk_width, chunk_height) = decoder.chunk_dimensions();
    let (across, down) = (width.div_ceil(chunk_width), height.div_ceil(chunk_height));
    let samples = first(Tag::SamplesPerPixel).unwrap_or(1);
    let planar = first(Tag::PlanarConfiguration) == Some(PlanarConfiguration::Planar.to_u16().into());
    let (planes, together) = if planar { (samples, 1) } else { (1, samples) };
    let bits = first(Tag::BitsPerSample).unwrap_or(1).checked_mul(together);
    let row = bits.and_then(|bits| bits.checked_mul(chunk_width.into())).map(|bits| bits.div_ceil(8));
    let size_of_row = |k: u32| row.and_then(|row| row.checked_mul(chunk_height.min(height - k * chunk_height).into()));
    let rows: Option<Vec<u64>> = (0..down).map(size_of_row).collect();
    let rows = rows.ok_or_else(|| format!("chunks of {chunk_width}x{chunk_height} px are too many bytes"))?;
    let plane = rows.iter().flat_map(|size| std::iter::repeat_n(*size, across as usize));
    Ok((0..planes).flat_map(|_| plane.clone()).collect())
}

/// Appends what the codes of a chunk stand for, `size` bytes. They may go on behind it, and may lack their end.
fn unpack(codes: &[u8], file: &mut Vec<u8>, size: usize) -> Failure<()> {
    let start = file.len();
    file.resize(start + size, 0);
    let out = &mut file[start..];
    let order = Configuration::with_tiff_size_switch(BitOrder::Msb, 8).with_yield_on_full_buffer(true);
    let mut decoder = order.build();
    let (mut read, mut written, mut idle) = (0, 0, 0);
    while written < size && !decoder.has_ended() && idle <= IDLE_CALLS {
        let step = decoder.decode_bytes(&codes[read..], &mut out[written..]);
        step.status.map_err(|e| e.to_string())?;
        (read, written) = (read + step.consumed_in, written + step.consumed_out);
        idle = if step.consumed_in + step.consumed_out == 0 { idle + 1 } else { 0 };
    }
    if written < size { Err(format!("the codes stand for {written} of {size} bytes")) } else { Ok(()) }
}

/// Bytes of a BigTIFF's header.
const HEADER: usize = 16;

/// Writes the header of a BigTIFF, and its one directory behind the chunks. Numbers and chunks have the same order of bytes.
fn directory(file: &mut Vec<u8>, order: ByteOrder, tags: &BTreeMap<u16, Vec<u64>>) {
    let little = order == ByteOrder::LittleEndian;
    let short = |v: u16| if little { v.to_le_bytes() } else { v.to_be_bytes() };
    let long = |v: u64| if little { v.to_le_bytes() } else { v.to_be_bytes() };
    let start = file.len();
    let header = [*if little { b"II" } else { b"MM" }, short(43), short(8), short(0)];
    file[..8].copy_from_slice(header.as_flattened());
    file[8..HEADER].copy_from_slice(&long(start as u64));
    let (mut entries, mut behind) = (Vec::new(), Vec::new());
    let beyond = start + 8 + 20 * tags.len() + 8;
    for (tag, values) in tags {
        let shorts: Option<Vec<_>> = values.iter().map(|v| u16::try_from(*v).ok().map(short)).collect();
        let (kind, mut bytes) = match shorts {
            Some(shorts) => (3, shorts.into_flattened()),
            None => (16, values.iter().flat_map(|v| long(*v)).collect()),
        };
        if bytes.len() > 8 {
            let at = long((beyond + behind.len()) as u64);
            behind.append(&mut bytes);
            bytes.extend(at);
        }
        bytes.resize(8, 0);
        entries.extend([short(*tag), short(kind)].as_flattened());
        entries.extend(long(values.len() as u64));
        entries.extend(bytes);
    }
    file.extend(long(tags.len() as u64));
    file.extend(entries);
    file.extend(long(0));
    file.extend(behind);
}
