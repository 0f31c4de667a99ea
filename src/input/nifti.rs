//! NIfTI-1, NIfTI-2 and Analyze 7.5 label volumes, in one file or as `.hdr` and `.img`. The `nifti` crate reads headers of NIfTI-1; Analyze has the
//! same places for what it says, and NIfTI-2, which the crate does not know, is read here.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use glam::{DAffine3, DMat3, DVec3};
use nifti::{Endianness, NiftiHeader};

use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, TAKE_ONE, VolumeGrid};
use crate::input::volume::{Volume, open};
use crate::storage::regular;

/// Sizes of the headers.
const ONE: usize = 348;
const TWO: usize = 540;
/// Extensions of a header whose voxels lie beside it, and of those voxels.
const HEADER: &str = "hdr";
const VOXELS: [&str; 2] = ["img", "img.gz"];

/// What a header says.
#[derive(Debug)]
struct Header {
    format: &'static str,
    /// Whether voxels lie in a file of their own.
    pair: bool,
    dim: [i64; 8],
    datatype: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: f64,
    inter: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quatern: [f64; 3],
    offset: [f64; 3],
    /// The rows of the sform.
    rows: [[f64; 4]; 3],
    big_endian: bool,
}

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

/// NIfTI-1, by the crate.
fn one(bytes: &[u8]) -> Failure<Header> {
    if bytes.len() < ONE {
        return Err(format!("NIfTI header: ends after {} of {ONE} bytes", bytes.len()));
    }
    let h = NiftiHeader::from_reader(bytes).map_err(|e| format!("NIfTI header: {e}"))?;
    let f64s = |row: [f32; 4]| row.map(f64::from);
    Ok(Header {
        format: "NIfTI",
        pair: &h.magic == b"ni1\0",
        // The format's are signed.
        dim: h.dim.map(|n| i64::from(n.cast_signed())),
        datatype: h.datatype,
        pixdim: h.pixdim.map(f64::from),
        vox_offset: f64::from(h.vox_offset),
        slope: f64::from(h.scl_slope),
        inter: f64::from(h.scl_inter),
        units: i32::from(h.xyzt_units),
        qform_code: i32::from(h.qform_code),
        sform_code: i32::from(h.sform_code),
        quatern: [h.quatern_b, h.quatern_c, h.quatern_d].map(f64::from),
        offset: [h.quatern_x, h.quatern_y, h.quatern_z].map(f64::from),
        rows: [f64s(h.srow_x), f64s(h.srow_y), f64s(h.srow_z)],
        big_endian: h.endianness == Endianness::Big,
    })
}

/// Analyze 7.5: NIfTI-1 without what came later, of which other things may stand in its place.
fn analyze(mut bytes: Vec<u8>) -> Failure<Header> {
    // Scaling, units, from the codes of the forms to the end of the rows, magic.
    for unknown in [112..120, 123..124, 252..328] {
        bytes.get_mut(unknown).unwrap_or_default().fill(0);
    }
    bytes.truncate(ONE);
    bytes.get_mut(344..).unwrap_or_default().copy_from_slice(b"ni1\0");
    Ok(Header { format: "Analyze", ..one(&bytes)? })
}

/// NIfTI-2.
fn two(bytes: &[u8]) -> Failure<Header> {
    let bytes: &[u8; TWO] =
        bytes.try_into().map_err(|_| format!("NIfTI-2 header: ends after {} of {TWO} bytes", bytes.len()))?;
    let big_endian = bytes[0] == 0;
    fn at<const N: usize>(bytes: &[u8; TWO], at: usize, big_endian: bool) -> [u8; N] {
        let mut value: [u8; N] = std::array::from_fn(|k| bytes[at + k]);
        if big_endian {
            value.reverse();
        }
        value
    }
    let short = |place| i16::from_le_bytes(at(bytes, place, big_endian));
    let int = |place| i32::from_le_bytes(at(bytes, place, big_endian));
    let long = |place| i64::from_le_bytes(at(bytes, place, big_endian));
    let real = |place| f64::from_le_bytes(at(bytes, place, big_endian));
    let magic = &bytes[4..12];
    if ![b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"].iter().any(|known| magic == *known) {
        return Err(format!("NIfTI-2 header: magic is \"{}\"; expected n+2 or ni2", text(magic).escape_default()));
    }
    Ok(Header {
        format: "NIfTI-2",
        pair: magic.starts_with(b"ni2"),
        dim: std::array::from_fn(|k| long(16 + 8 * k)),
        datatype: short(12),
        pixdim: std::array::from_fn(|k| real(104 + 8 * k)),
        // Exact: no file is 2^53 bytes long.
        vox_offset: long(168) as f64,
        slope: real(176),
        inter: real(184),
        units: int(500),
        qform_code: int(344),
        sform_code: int(348),
        quatern: [352, 360, 368].map(real),
        offset: [376, 384, 392].map(real),
        rows: [400, 432, 464].map(|row| std::array::from_fn(|k| real(row + 8 * k))),
        big_endian,
    })
}

fn volume(path: &Path, gzip: bool, header: &Header) -> Failure<Volume> {
    let dims = dims(header)?;
    let (origin, steps) = placement(header, dims)?;
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
    let grid = VolumeGrid { dims, origin, steps, unit: unit.into(), spaced: true };
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

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_end_matches('\0').to_string()
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

/// Share of a voxel by which sform and qform may place the volume's corners differently: both are rounded by those who write them.
const SAME_PLACE: f64 = 0.1;

/// Note on a header whose sform and qform, both meant to count, place the volume differently.
fn two_forms(header: &Header, dims: [usize; 3], unit: &str) -> Option<String> {
    if header.sform_code <= 0 || header.qform_code <= 0 {
        return None;
    }
    let forms = [sform(header), qform(header)];
    let apart = |corner: usize| {
        let at = std::array::from_fn(|a| if corner >> a & 1 == 1 { (dims[a] - 1) as f64 } else { 0.0 });
        let [s, q] = forms.map(|form| form.transform_point3(at.into()));
        s.distance(q)
    };
    let most = (0..8).map(apart).fold(0.0, f64::max);
    let side = |c: usize| forms[0].matrix3.col(c).length();
    let least = (0..3).filter(|&c| dims[c] > 1).map(side).fold(f64::INFINITY, f64::min);
    (most > SAME_PLACE * least).then(|| {
        format!(
            "sform and qform of the header place the volume differently, by up to {most:.3} {unit}; the sform is used, and what lies where the \
             qform says will not fit"
        )
    })
}

/// Note on a NIfTI header that places the volume nowhere.
fn no_form(header: &Header) -> Option<String> {
    let nowhere = header.sform_code <= 0 && header.qform_code <= 0 && header.format != "Analyze";
    nowhere.then(|| {
        "neither sform nor qform of the header counts (both codes are 0): read as the format says, x to the right and y to the front from voxel \
         (0, 0, 0), which other programs do otherwise; a result on top of the input in one of them needs a code above 0 in the input"
            .into()
    })
}

/// Origin and steps in LPS, from the sform, else the qform, else the voxel sizes.
fn placement(header: &Header, dims: [usize; 3]) -> Failure<(DVec3, [DVec3; 3])> {
    if header.sform_code <= 0
        && let Some(a) =
            (1..=3).find(|&a| (a < 3 || dims[2] > 1) && !(header.pixdim[a].is_finite() && header.pixdim[a] > 0.0))
    {
        return Err(format!("pixdim[{a}], a voxel spacing, must be a positive number; got {}", header.pixdim[a]));
    }
    let [sx, sy, sz] = [1, 2, 3].map(|k| header.pixdim[k]);
    let form = if header.sform_code > 0 {
        sform(header)
    } else if header.qform_code > 0 {
        qform(header)
    } else if header.format == "Analyze" {
        // As nibabel has it: the origin in the middle, x to the left.
        let middle = DVec3::from(dims.map(|n| 0.5 * (n as f64 - 1.0)));
        let steps = DVec3::new(-sx, sy, sz);
        DAffine3::from_mat3_translation(DMat3::from_diagonal(steps), -steps * middle)
    } else {
        DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(sx, sy, sz)))
    };
    if let Some(v) = form.to_cols_array().iter().find(|v| !v.is_finite()) {
        return Err(format!("the orientation holds {v}"));
    }
    // RAS to LPS turns the first two axes.
    let [x, y, mut z, origin] =
        [0, 1, 2, 3].map(|c| DVec3::new(-1.0, -1.0, 1.0) * DVec3::from(form.to_cols_array_2d()[c]));
    if dims[2] == 1 && z == DVec3::ZERO {
        z = DVec3::Z;
    }
    Ok((origin, [x, y, z]))
}

/// The affine form.
fn sform(header: &Header) -> DAffine3 {
    let [x, y, z, origin] = [0, 1, 2, 3].map(|c| DVec3::from(header.rows.map(|row| row[c])));
    DAffine3::from_cols(x, y, z, origin)
}

/// The quaternion form (NIfTI-1 header, method 2).
fn qform(header: &Header) -> DAffine3 {
    let [b, c, d] = header.quatern;
    let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
    let handed = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let [sx, sy, sz] = [1, 2, 3].map(|k| header.pixdim[k]);
    // Columns. Written out: `from_quat` wants a quaternion of length one, and rounds otherwise.
    let x = DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c));
    let y = DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b));
    let z = DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c);
    DAffine3::from_cols(x * sx, y * sy, z * (sz * handed), header.offset.into())
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn a_quaternion_is_its_rotation_whatever_its_axis() {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.6, -0.48, 0.64), DVec3::new(-2.0, 1.0, 2.0) / 3.0] {
            for angle in [0.0, 0.4, 1.7, 2.9] {
                let turn = DQuat::from_axis_angle(axis, angle);
                let header = |handed: f64| Header {
                    format: "NIfTI-1",
                    pair: false,
                    dim: [3, 4, 4, 4, 1, 1, 1, 1],
                    datatype: 2,
                    pixdim: [handed, 0.5, 0.75, 3.0, 0.0, 0.0, 0.0, 0.0],
                    vox_offset: 352.0,
                    slope: 1.0,
                    inter: 0.0,
                    units: 2,
                    qform_code: 1,
                    sform_code: 0,
                    quatern: [turn.x, turn.y, turn.z],
                    offset: [10.0, -20.0, 30.0],
                    rows: [[0.0; 4]; 3],
                    big_endian: false,
                };
                for handed in [1.0, -1.0] {
                    let found = qform(&header(handed));
                    for voxel in [DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 0.5, 0.0)] {
                        let wanted =
                            turn * (voxel * DVec3::new(0.5, 0.75, 3.0 * handed)) + DVec3::new(10.0, -20.0, 30.0);
                        assert!(found.transform_point3(voxel).distance(wanted) < 1e-9, "{axis}, {angle}, {voxel}");
                    }
                }
            }
        }
    }

    /// A NIfTI-2 header of 540 bytes, numbers as `order` turns them.
    fn nifti_2(magic: &[u8; 8], order: impl Fn(&mut [u8])) -> Vec<u8> {
        let mut bytes = vec![0; TWO];
        let mut put = |at: usize, value: &[u8]| {
            bytes[at..at + value.len()].copy_from_slice(value);
            order(&mut bytes[at..at + value.len()]);
        };
        put(0, &(TWO as i32).to_le_bytes());
        put(12, &4i16.to_le_bytes());
        [3i64, 7, 8, 9, 1, 1, 1, 1].iter().enumerate().for_each(|(k, n)| put(16 + 8 * k, &n.to_le_bytes()));
        [1.0, 0.5, 0.75, 3.0f64].iter().enumerate().for_each(|(k, side)| put(104 + 8 * k, &side.to_le_bytes()));
        put(168, &544i64.to_le_bytes());
        put(500, &2i32.to_le_bytes());
        bytes[4..12].copy_from_slice(magic);
        bytes
    }

    #[test]
    fn sizes_of_nifti_1_have_a_sign_and_a_header_has_all_its_bytes() {
        let mut bytes = vec![0; ONE];
        bytes[..4].copy_from_slice(&(ONE as i32).to_le_bytes());
        for (k, n) in [3i16, 20, -1, 9].iter().enumerate() {
            bytes[40 + 2 * k..][..2].copy_from_slice(&n.to_le_bytes());
        }
        bytes[344..].copy_from_slice(b"n+1\0");
        assert_eq!(one(&bytes).expect("it is whole").dim[..4], [3, 20, -1, 9]);
        let Err(message) = one(&bytes[..200]) else { panic!("it is cut off") };
        assert_eq!(message, "NIfTI header: ends after 200 of 348 bytes");
    }

    #[test]
    fn numbers_of_nifti_2_are_read_in_either_order() {
        for turn in [false, true] {
            let bytes = nifti_2(b"n+2\0\r\n\x1a\n", |value| {
                if turn {
                    value.reverse()
                }
            });
            let header = two(&bytes).expect("it is sound");
            assert_eq!((header.dim, header.datatype, header.units), ([3, 7, 8, 9, 1, 1, 1, 1], 4, 2));
            assert_eq!((&header.pixdim[..4], header.vox_offset), (&[1.0, 0.5, 0.75, 3.0][..], 544.0));
            assert_eq!((header.big_endian, header.pair), (turn, false));
        }
    }

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
