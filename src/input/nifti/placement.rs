//! Where a volume lies: the sform, the qform, or the sides of voxels alone.

use glam::{DAffine3, DMat3, DVec3};

use super::header::Header;
use crate::input::volume::grid::Failure;
use crate::stack::space::WorldSpace;

/// Share of a voxel by which sform and qform may place the volume's corners differently: both are rounded by those who write them.
const SAME_PLACE: f64 = 0.1;

/// Note on a header whose sform and qform, both meant to count, place the volume differently.
pub(super) fn two_forms(header: &Header, dims: [usize; 3], unit: &str) -> Option<String> {
    if header.sform_code <= 0 || header.qform_code <= 0 {
        return None;
    }
    let forms = [sform(header), qform(header)];
    let apart = |corner: usize| {
        let at = std::array::from_fn(|a| if corner >> a & 1 == 1 { dims[a] as f64 - 1.0 } else { 0.0 });
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
pub(super) fn no_form(header: &Header) -> Option<String> {
    let nowhere = header.sform_code <= 0 && header.qform_code <= 0 && header.format != "Analyze";
    nowhere.then(|| {
        "neither sform nor qform of the header counts (both codes are 0): read as the format says, x to the right and y to the front from voxel \
         (0, 0, 0), which other programs do otherwise; a result on top of the input in one of them needs a code above 0 in the input"
            .into()
    })
}

/// Origin and steps in LPS, from the sform, else the qform, else the voxel sizes.
pub(super) fn placement(header: &Header, dims: [usize; 3]) -> Failure<(DVec3, [DVec3; 3])> {
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

/// Space of the form that places the volume.
pub(super) fn space(header: &Header) -> WorldSpace {
    let code = if header.sform_code > 0 { header.sform_code } else { header.qform_code };
    WorldSpace::of_code(code)
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
}
