//! NIfTI-1 label volumes; the header is read by the `nifti` crate.

use std::io::{BufRead, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use glam::{DAffine3, DMat3, DVec3};
use nifti::{Endianness, NiftiHeader};

use crate::error::{Error, Result};
use crate::input::volume::data::{Coding, Data};
use crate::input::volume::element::Element;
use crate::input::volume::grid::{Failure, VolumeGrid};
use crate::input::volume::{Volume, open};

/// Size of the header: voxels cannot begin before its end.
const HEADER: f32 = 348.0;
/// Position of the first voxel where the header does not place it.
const USUAL_OFFSET: u64 = 352;

/// Reads the header of a `.nii` or `.nii.gz`.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<Volume> {
    let fail = |message: String| Error::Format { path: path.into(), message };
    let mut input = open(path)?;
    let start = input.fill_buf().map_err(|source| Error::Read { path: path.into(), source })?;
    let gzip = start.starts_with(&[0x1f, 0x8b]);
    let mut bytes = Vec::new();
    let mut input: Box<dyn Read> = if gzip { Box::new(MultiGzDecoder::new(input)) } else { Box::new(input) };
    input.by_ref().take(HEADER as u64).read_to_end(&mut bytes).map_err(|e| fail(format!("NIfTI header: {e}")))?;
    if matches!(bytes[..], [0x1c, 2, 0, 0, ..] | [0, 0, 2, 0x1c, ..]) {
        return Err(fail("is NIfTI-2; save it as NIfTI-1".into()));
    }
    let header = NiftiHeader::from_reader(&bytes[..]).map_err(|e| fail(format!("NIfTI header: {e}")))?;
    let volume = volume(path, gzip, &header).map_err(fail)?;
    volume.check()?;
    Ok(volume)
}

fn volume(path: &Path, gzip: bool, header: &NiftiHeader) -> Failure<Volume> {
    let dims = dims(header)?;
    let (origin, steps) = placement(header, dims)?;
    let unit = match header.xyzt_units & 7 {
        1 => "m",
        3 => "um",
        _ => "mm",
    };
    if &header.magic != b"n+1\0" {
        return Err(format!("magic is {:?}; voxels must lie in the same file (n+1)", magic(&header.magic)));
    }
    let skip = match header.vox_offset {
        0.0 => USUAL_OFFSET,
        at if at.is_finite() && at >= HEADER && at.fract() == 0.0 => at as u64,
        at => return Err(format!("vox_offset must be a whole number from {HEADER} on; got {at}")),
    };
    let scale = match [header.scl_slope, header.scl_inter] {
        [0.0, _] | [1.0, 0.0] => None,
        [slope, inter] if slope.is_finite() && inter.is_finite() => Some([f64::from(slope), f64::from(inter)]),
        // What some programs write for "no scaling".
        [slope, _] if slope.is_nan() => None,
        [slope, inter] => return Err(format!("scl_slope and scl_inter must be finite; got {slope} and {inter}")),
    };
    let (offset, coding, skip) = if gzip { (0, Coding::Gzip, skip) } else { (skip, Coding::Raw, 0) };
    let grid = VolumeGrid { dims, origin, steps, unit: unit.into(), spaced: true };
    let element = (element(header.datatype)?, header.endianness == Endianness::Big);
    let data = Data::Stream { file: path.into(), offset, coding, skip };
    let notes = two_forms(header, dims).into_iter().collect();
    Ok(Volume { scale, notes, ..Volume::new(path, "NIfTI", grid, element, data) })
}

fn magic(bytes: &[u8]) -> String {
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

fn dims(header: &NiftiHeader) -> Failure<[usize; 3]> {
    let dim = header.dim;
    let axes = dim[0] as usize;
    if !(2..=7).contains(&axes) {
        return Err(format!("dim[0] must be 2 to 7; got {}", dim[0]));
    }
    if let Some(k) = (4..=axes).find(|&k| dim[k] > 1) {
        return Err(format!("dim[{k}] is {}; a label volume has three axes", dim[k]));
    }
    let dims = std::array::from_fn(|a| if a < axes { dim[a + 1] as usize } else { 1 });
    Ok(dims)
}

/// Share of a voxel by which sform and qform may place the volume's corners differently: both are rounded by those who write them.
const SAME_PLACE: f64 = 0.1;

/// Note on a header whose sform and qform, both meant to count, place the volume differently.
fn two_forms(header: &NiftiHeader, dims: [usize; 3]) -> Option<String> {
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
        format!("sform and qform of the header place the volume differently, by up to {most:.3}; the sform is used")
    })
}

/// Origin and steps in LPS, from the sform, else the qform, else the voxel sizes.
fn placement(header: &NiftiHeader, dims: [usize; 3]) -> Failure<(DVec3, [DVec3; 3])> {
    if header.sform_code <= 0
        && let Some(a) =
            (1..=3).find(|&a| (a < 3 || dims[2] > 1) && !(header.pixdim[a].is_finite() && header.pixdim[a] > 0.0))
    {
        return Err(format!("pixdim[{a}], a voxel spacing, must be a positive number; got {}", header.pixdim[a]));
    }
    let form = if header.sform_code > 0 {
        sform(header)
    } else if header.qform_code > 0 {
        qform(header)
    } else {
        DAffine3::from_mat3(DMat3::from_diagonal(DVec3::from_array([1, 2, 3].map(|k| f64::from(header.pixdim[k])))))
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
fn sform(header: &NiftiHeader) -> DAffine3 {
    let rows = [header.srow_x, header.srow_y, header.srow_z];
    let [x, y, z, origin] = [0, 1, 2, 3].map(|c| DVec3::from(rows.map(|row| f64::from(row[c]))));
    DAffine3::from_cols(x, y, z, origin)
}

/// The quaternion form (NIfTI-1 header, method 2).
fn qform(header: &NiftiHeader) -> DAffine3 {
    let [b, c, d] = [header.quatern_b, header.quatern_c, header.quatern_d].map(f64::from);
    let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
    let handed = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let [sx, sy, sz] = [1, 2, 3].map(|k| f64::from(header.pixdim[k]));
    let offset = [header.quatern_x, header.quatern_y, header.quatern_z].map(f64::from);
    // Columns. Written out: `from_quat` wants a quaternion of length one, and rounds otherwise.
    let x = DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c));
    let y = DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b));
    let z = DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c);
    DAffine3::from_cols(x * sx, y * sy, z * (sz * handed), offset.into())
}
