//! NIfTI-1 label volumes, through the `nifti` crate.

use std::path::Path;

use nifti::{IntoNdArray, NiftiHeader, NiftiObject, ReaderOptions};

use super::volume::{LabelVolume, whole};
use crate::error::{Error, Result};

/// Most voxels this reader takes: the header of a damaged file may ask for anything.
const MOST_VOXELS: usize = 1 << 33;

/// Reads a `.nii` or `.nii.gz`.
///
/// # Errors
/// [`Error::Format`] naming field and value.
pub fn read(path: &Path) -> Result<LabelVolume> {
    let fail = |message: String| Error::Format { path: path.into(), message };
    let header = NiftiHeader::from_file(path).map_err(|e| fail(format!("NIfTI header: {e}")))?;
    let dims = dims(&header).map_err(fail)?;
    let (origin, steps) = placement(&header, dims).map_err(fail)?;
    let object = ReaderOptions::new().read_file(path).map_err(|e| fail(format!("NIfTI volume: {e}")))?;
    let values = object.into_volume().into_ndarray::<f64>().map_err(|e| fail(format!("NIfTI data: {e}")))?;
    let [nx, ny, nz] = dims;
    if values.len() != nx * ny * nz {
        return Err(fail(format!("holds {} voxels, but dim says {nx}x{ny}x{nz}", values.len())));
    }
    // The array is indexed [x, y, z]; read transposed it runs with x fastest.
    let labels = values
        .t()
        .iter()
        .enumerate()
        .map(|(k, v)| whole(*v, k))
        .collect::<std::result::Result<_, _>>()
        .map_err(fail)?;
    let unit = match header.xyzt_units & 7 {
        1 => "m",
        3 => "um",
        _ => "mm",
    };
    Ok(LabelVolume { dims, origin, steps, unit: unit.into(), labels })
}

type Failure<T> = std::result::Result<T, String>;

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
    match dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)) {
        Some(n) if (1..=MOST_VOXELS).contains(&n) => Ok(dims),
        _ => Err(format!("dim {}x{}x{} is no volume of 1 to {MOST_VOXELS} voxels", dims[0], dims[1], dims[2])),
    }
}

/// Origin and steps in LPS, from the sform, else the qform, else the voxel sizes.
fn placement(header: &NiftiHeader, dims: [usize; 3]) -> Failure<([f64; 3], [[f64; 3]; 3])> {
    let rows: [[f64; 4]; 3] = if header.sform_code > 0 {
        [header.srow_x, header.srow_y, header.srow_z].map(|r| r.map(f64::from))
    } else if header.qform_code > 0 {
        qform(header)
    } else {
        let size = |a: usize| f64::from(header.pixdim[a + 1]);
        [[size(0), 0.0, 0.0, 0.0], [0.0, size(1), 0.0, 0.0], [0.0, 0.0, size(2), 0.0]]
    };
    if let Some(v) = rows.iter().flatten().find(|v| !v.is_finite()) {
        return Err(format!("the orientation holds {v}"));
    }
    let lps = |v: [f64; 3]| [-v[0], -v[1], v[2]];
    let column = |c: usize| lps([rows[0][c], rows[1][c], rows[2][c]]);
    let mut steps = [column(0), column(1), column(2)];
    if dims[2] == 1 && steps[2] == [0.0; 3] {
        steps[2] = [0.0, 0.0, 1.0];
    }
    Ok((column(3), steps))
}

/// The quaternion form (NIfTI-1 header, method 2).
fn qform(header: &NiftiHeader) -> [[f64; 4]; 3] {
    let [b, c, d] = [header.quatern_b, header.quatern_c, header.quatern_d].map(f64::from);
    let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
    let handed = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let [sx, sy, sz] = [1, 2, 3].map(|k| f64::from(header.pixdim[k]));
    let sz = sz * handed;
    let offset = [header.quatern_x, header.quatern_y, header.quatern_z].map(f64::from);
    let rotation = [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
        [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
        [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
    ];
    std::array::from_fn(|r| [rotation[r][0] * sx, rotation[r][1] * sy, rotation[r][2] * sz, offset[r]])
}
