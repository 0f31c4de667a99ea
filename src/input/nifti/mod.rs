//! NIfTI-1, NIfTI-2 and Analyze 7.5 label volumes, in one file or as `.hdr` and `.img`.

mod header;
mod placement;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use self::header::{Header, ONE, TWO, analyze, one, two};
use self::placement::{no_form, placement, space, two_forms};
use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid};
use crate::input::volume::{Volume, open};
use crate::storage::regular;

/// Extensions of a header whose voxels lie beside it, and of those voxels.
const HEADER: &str = "hdr";
const VOXELS: [&str; 2] = ["img", "img.gz"];

/// Reads the header of a `.nii`, `.nii.gz`, `.hdr` or, beside its header, `.img`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let is_voxels = path.extension().is_some_and(|e| e.eq_ignore_ascii_case(VOXELS[0]));
    let named = if is_voxels { path.with_extension(HEADER) } else { path.to_path_buf() };
    let path = named.as_path();
    let fail = |message: String| Error::Format { path: path.into(), message };
    let mut input = open(path)?;
    let gzip = is_gzip(&mut input).map_err(|source| Error::Read { path: path.into(), source })?;
    let mut bytes = Vec::new();
    let mut input: Box<dyn Read> = if gzip { Box::new(MultiGzDecoder::new(input)) } else { Box::new(input) };
    input.by_ref().take(TWO as u64).read_to_end(&mut bytes).map_err(|e| fail(format!("NIfTI header: {e}")))?;
    let apart = path.extension().is_some_and(|e| e.eq_ignore_ascii_case(HEADER));
    let header = if matches!(bytes[..], [0x1c, 2, 0, 0, ..] | [0, 0, 2, 0x1c, ..]) {
        two(&bytes)
    } else if apart && bytes.get(344..ONE).is_some_and(|magic| magic != b"n+1\0" && magic != b"ni1\0") {
        analyze(bytes)
    } else {
        bytes.truncate(ONE);
        one(&bytes)
    };
    let volume = header.and_then(|header| volume(path, gzip, &header)).map_err(fail)?;
    volume.check()?;
    Ok(volume)
}

/// Whether a path is one of a header and its voxels.
pub(super) fn is_pair(path: &Path) -> bool {
    path.with_extension(HEADER).is_file() && voxels_of(path).is_some()
}

/// The voxels beside a header.
fn voxels_of(header: &Path) -> Option<PathBuf> {
    VOXELS.iter().map(|e| header.with_extension(e)).find(|path| path.is_file())
}

fn is_gzip(input: &mut impl BufRead) -> std::io::Result<bool> {
    Ok(input.fill_buf()?.starts_with(&[0x1f, 0x8b]))
}

fn volume(path: &Path, gzip: bool, header: &Header) -> Failure<Volume> {
    let dims = dims(header)?;
    let (origin, steps) = placement(header, dims)?;
    let space = space(header);
    let unit = match header.units & 7 {
        1 => "m",
        3 => "um",
        _ => "mm",
    };
    // Voxels cannot begin before the header's end, where they usually begin 4 bytes later.
    let least = match header {
        Header { pair: true, .. } => 0,
        Header { format: "NIfTI-2", .. } => TWO,
        _ => ONE,
    };
    let skip = match header.vox_offset {
        0.0 if header.pair => 0,
        0.0 => least as u64 + 4,
        at if at.is_finite() && at >= least as f64 && at.fract() == 0.0 => at as u64,
        at => return Err(format!("vox_offset must be a whole number from {least} on; got {at}")),
    };
    let scale = match [header.slope, header.inter] {
        [0.0, _] | [1.0, 0.0] => None,
        [slope, inter] if slope.is_finite() && inter.is_finite() => Some([slope, inter]),
        // What some programs write for "no scaling".
        [slope, _] if slope.is_nan() => None,
        [slope, inter] => return Err(format!("scl_slope and scl_inter must be finite; got {slope} and {inter}")),
    };
    let (file, gzip) = if header.pair { beside(path, header)? } else { (path.to_path_buf(), gzip) };
    let (offset, coding, skip) = if gzip { (0, Coding::Gzip, skip) } else { (skip, Coding::Raw, 0) };
    let grid = VolumeGrid { dims, origin, steps, unit: unit.into(), spaced: true, space };
    let element = (element(header.datatype)?, header.big_endian);
    let data = Data::Stream { file, offset, coding, skip };
    let mut notes: Vec<String> = two_forms(header, dims, unit).into_iter().chain(no_form(header)).collect();
    if header.format == "Analyze" {
        notes
            .push("Analyze does not say how a volume lies: x is taken to run to the left, y to the front, z up".into());
    }
    Ok(Volume { scale, notes, ..Volume::new(path, header.format, grid, element, data) })
}

/// The file of the voxels beside a header, and whether gzip has packed it.
fn beside(path: &Path, header: &Header) -> Failure<(PathBuf, bool)> {
    let missing = || {
        let [plain, packed] = VOXELS.map(|e| path.with_extension(e).display().to_string());
        let said = if header.format == "Analyze" { "Analyze" } else { "magic is \"ni1\"" };
        format!("{said}: voxels must lie beside the header, in {plain} or {packed}, which are not there")
    };
    let file = voxels_of(path).ok_or_else(missing)?;
    let opened = regular::open(&file).map(BufReader::new).and_then(|mut input| is_gzip(&mut input));
    let gzip = opened.map_err(|e| format!("data in {}: {e}", file.display()))?;
    Ok((file, gzip))
}

fn element(datatype: i16) -> Failure<Element> {
    let int = |size, signed| Ok(Element::Int { size, signed });
    match datatype {
        2 => int(1, false),
        4 => int(2, true),
        8 => int(4, true),
        16 => Ok(Element::Float),
        64 => Ok(Element::Double),
        256 => int(1, true),
        512 => int(2, false),
        768 => int(4, false),
        1024 => int(8, true),
        1280 => int(8, false),
        other => Err(format!("datatype {other} is no integer of 1 to 8 bytes, nor float32 or float64")),
    }
}

fn dims(header: &Header) -> Failure<[usize; 3]> {
    let dim = header.dim;
    let axes = usize::try_from(dim[0]).unwrap_or(0);
    if !(2..=7).contains(&axes) {
        return Err(format!("dim[0] must be 2 to 7; got {}", dim[0]));
    }
    if let Some(k) = (1..=axes.min(3)).find(|&k| dim[k] < 0) {
        return Err(format!("dim[{k}] must be a number of voxels; got {}", dim[k]));
    }
    if let Some(k) = (4..=axes).find(|&k| dim[k] > 1) {
        let of = if k == 4 { "volumes one behind the other (4D)" } else { "values of every voxel" };
        return Err(format!(
            "dim[{k}] is {0}: {0} {of}; a label volume has three axes: {TAKE_ONE}, as fslroi or nibabel's `image.slicer[..., 0]` do",
            dim[k]
        ));
    }
    let dims = std::array::from_fn(|a| if a < axes { dim[a + 1] as usize } else { 1 });
    Ok(dims)
}

#[cfg(test)]
mod tests {
    use super::header::tests::nifti_2;
    use super::*;

    #[test]
    fn voxels_begin_behind_the_header_and_in_a_file_of_their_own_anywhere() {
        for (magic, least) in [(b"n+2\0\r\n\x1a\n", 540), (b"ni2\0\r\n\x1a\n", 0)] {
            let mut header = two(&nifti_2(magic, |_| {})).expect("it is sound");
            header.vox_offset = -1.0;
            let message = volume(Path::new("a.nii"), false, &header).expect_err("before the file").to_string();
            assert!(message.contains(&format!("whole number from {least} on; got -1")), "{message}");
        }
    }
}
