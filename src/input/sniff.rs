//! Formats by content: how files begin, whatever they are called.

use std::io::Read;
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::storage::folders::nearest_files;
use crate::storage::regular;

/// Bytes that are looked at.
const BEGIN: u64 = 4096;

/// Name of the format of a file, as [`super::format::FORMATS`] has it; nothing where its begin does not tell.
pub(super) fn format(path: &Path) -> Option<&'static str> {
    let bytes = regular::begin(path, BEGIN).ok()?;
    of_begin(&bytes).or_else(|| packed(&bytes))
}

/// Format of what gzip has packed: only NIfTI is read so.
fn packed(bytes: &[u8]) -> Option<&'static str> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return None;
    }
    let mut begin = Vec::new();
    // What follows the first bytes is cut off here.
    let _ = MultiGzDecoder::new(bytes).take(BEGIN).read_to_end(&mut begin);
    of_begin(&begin).filter(|format| *format == "nifti")
}

/// Files of a folder that are looked at before it is no folder of DICOM files.
const MOST_LOOKED_AT: usize = 1000;

/// Whether a folder, or one below it, has DICOM files.
pub(super) fn has_dicom(folder: &Path) -> bool {
    let files = nearest_files(folder, MOST_LOOKED_AT).unwrap_or_default();
    files.iter().any(|path| format(path) == Some("rtstruct"))
}

/// Whether a folder is a group or an array of Zarr.
pub(super) fn is_zarr(folder: &Path) -> bool {
    ["zarr.json", ".zgroup", ".zarray", ".zattrs"].iter().any(|name| folder.join(name).is_file())
}

fn of_begin(bytes: &[u8]) -> Option<&'static str> {
    let begins = |with: &[u8]| bytes.starts_with(with);
    if begins(b"NRRD000") {
        return Some("nrrd");
    }
    if begins(b"\x93NUMPY") {
        return Some("npy");
    }
    if begins(b"ObjectType") || begins(b"NDims") {
        return Some("mha");
    }
    if begins(b"II*\0") || begins(b"MM\0*") || begins(b"II+\0") || begins(b"MM\0+") {
        return Some("tiff");
    }
    if [b"n+1\0", b"ni1\0"].iter().any(|magic| bytes.get(344..348) == Some(&magic[..])) {
        return Some("nifti");
    }
    if [b"n+2\0", b"ni2\0"].iter().any(|magic| bytes.get(4..8) == Some(&magic[..])) {
        return Some("nifti");
    }
    if begins(b"PK\x03\x04") && bytes.get(30..).is_some_and(|name| name.windows(3).take(256).any(|w| w == b"npy")) {
        return Some("npz");
    }
    if is_dicom(bytes) {
        return Some("rtstruct");
    }
    #[cfg(feature = "terrain")]
    if let Some(map) = crate::terrain::format(bytes) {
        return Some(map);
    }
    is_geojson(bytes).then_some("geojson")
}

/// Whether a file is DICOM: `DICM` behind a preamble or without one, or elements of the first groups of a data set.
pub(super) fn is_dicom(bytes: &[u8]) -> bool {
    if bytes.get(128..132) == Some(b"DICM") || bytes.starts_with(b"DICM") {
        return true;
    }
    let Some(&[group, 0, element, 0, a, b, c, d]) = bytes.first_chunk() else { return false };
    // The first element of a data set is a short one, with its value representation or without.
    let explicit = matches!(&[a, b], b"UL" | b"UI" | b"CS" | b"OB" | b"SH" | b"DA");
    let implicit = u32::from_le_bytes([a, b, c, d]) <= 64;
    let first = match group {
        2 => element <= 0x10,
        8 => element <= 0x18,
        _ => false,
    };
    first && (explicit || implicit)
}

/// Whether a text begins as a collection of features does.
fn is_geojson(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let first = bytes.iter().find(|b| !b.is_ascii_whitespace());
    first == Some(&b'{') && bytes.windows(19).any(|w| w == b"\"FeatureCollection\"")
}
