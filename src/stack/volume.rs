//! Label volumes: which of their slices become the stack.

use std::path::Path;

use super::options::ReadOptions;
use super::{ContourStack, Geometry, HeightGrid, Slice, SliceContent};
use crate::error::{Error, Result};

/// Largest cosine between the slice normal and the stacking direction's deviation that still counts as straight.
const SHEAR_LIMIT: f64 = 1e-3;

/// A volume of integer labels, x fastest; its slices lie along the third axis.
#[derive(Debug, Clone)]
pub struct LabelVolume {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// World position (LPS) of voxel (0, 0, 0).
    pub origin: [f64; 3],
    /// World steps (LPS) from voxel to voxel along each axis.
    pub steps: [[f64; 3]; 3],
    /// Length unit.
    pub unit: String,
    /// Values.
    pub labels: Vec<i64>,
}

impl LabelVolume {
    /// The chosen slices of the chosen label. Heights are distances along the third axis from the volume's first slice, and the
    /// volume's own slices are the output grid.
    pub(super) fn into_stack(self, path: &Path, options: &ReadOptions) -> Result<ContourStack> {
        let fail = |message: String| Error::Format { path: path.into(), message };
        let [nx, ny, nz] = self.dims;
        let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let spacing = self.steps.map(length);
        if let Some(axis) = (0..3).find(|&a| !(spacing[a].is_finite() && spacing[a] > 0.0)) {
            return Err(fail(format!(
                "voxel spacing along axis {axis} must be a positive number; got {}",
                spacing[axis]
            )));
        }
        let axes: [[f64; 3]; 3] = std::array::from_fn(|a| self.steps[a].map(|v| v / spacing[a]));
        check_axes(&axes).map_err(|m| fail(format!("{m}; resample the volume first")))?;
        let wanted = |v: i64| options.label.map_or(v != 0, |label| v == label);
        let has_label = |k: usize| self.labels[k * nx * ny..(k + 1) * nx * ny].iter().any(|&v| wanted(v));
        let chosen: Vec<usize> = match (&options.slices, options.keep) {
            (Some(list), _) => {
                if let Some(&k) = list.iter().find(|&&k| k >= nz) {
                    let message = format!("must name slices 0 to {}; got {k}", nz.saturating_sub(1));
                    return Err(Error::Setting { name: "slices".into(), message });
                }
                let mut list = list.clone();
                list.sort_unstable();
                list.dedup();
                list
            }
            (None, Some(0)) => {
                return Err(Error::Setting { name: "keep".into(), message: "must be at least 1; got 0".into() });
            }
            (None, Some(keep)) => (0..nz).step_by(keep).collect(),
            (None, None) => (0..nz).filter(|&k| has_label(k)).collect(),
        };
        if !chosen.iter().any(|&k| has_label(k)) {
            let label = options.label.map_or("a non-zero label".into(), |l| format!("label {l}"));
            return Err(fail(format!("none of the {} chosen slices has {label}", chosen.len())));
        }
        let slices = chosen
            .iter()
            .map(|&k| Slice {
                name: format!("k={k}"),
                z: k as f64 * spacing[2],
                extra: false,
                content: SliceContent::Mask(
                    self.labels[k * nx * ny..(k + 1) * nx * ny].iter().map(|&v| wanted(v)).collect(),
                ),
            })
            .collect();
        Ok(ContourStack {
            dims: [nx, ny],
            spacing: [spacing[0], spacing[1]],
            unit: self.unit,
            slices,
            z_out: Some(HeightGrid { start: 0.0, step: spacing[2], count: nz }),
            geometry: Geometry { origin: self.origin, axes },
        })
    }
}

/// Checks that world directions are perpendicular unit vectors.
///
/// # Errors
/// A message with axis, value and limit.
pub(super) fn check_axes(axes: &[[f64; 3]; 3]) -> std::result::Result<(), String> {
    let dot = |a: usize, b: usize| -> f64 { (0..3).map(|k| axes[a][k] * axes[b][k]).sum() };
    for a in 0..3 {
        let length = dot(a, a).sqrt();
        if (length - 1.0).abs() > SHEAR_LIMIT || length.is_nan() {
            return Err(format!("axis {a} is {length} long; it must be 1"));
        }
    }
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let cosine = dot(a, b);
        if cosine.abs() > SHEAR_LIMIT {
            return Err(format!("axes {a} and {b} are not perpendicular (cosine {cosine:.4}, at most {SHEAR_LIMIT})"));
        }
    }
    Ok(())
}

/// Whole numbers of a volume of floats.
///
/// # Errors
/// A message with place and value for anything else.
pub(super) fn whole(value: f64, index: usize) -> std::result::Result<i64, String> {
    if value.fract() == 0.0 && value.abs() < 9e15 {
        Ok(value as i64)
    } else {
        Err(format!("voxel {index} is {value}; a label volume must hold whole numbers"))
    }
}
