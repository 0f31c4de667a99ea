//! The hold-out score: how well a stack's own slices are found again when they are left out.

use serde::Serialize;

use crate::backend::{Backend, Means};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reference::exact::exact_distance;
use crate::settings::Settings;
use crate::shelf::Budget;
use crate::stack::{ContourStack, Slice};
use crate::surface::Layer;

/// How well slices that were left out are found.
#[derive(Debug, Clone, Default, Serialize)]
pub struct HoldOut {
    /// Every which slice was left out.
    pub leave: usize,
    /// The slices that were left out and have something on them, in the truth or in the result.
    pub slices: Vec<SliceScore>,
    /// `2 |A and B| / (|A| + |B|)` over all of them together; none where the truth is empty on all.
    pub dice: Option<f64>,
    /// Mean distance between the contours of truth and result, both ways, unit of the stack, over the slices that have both; none where none has.
    pub surface_distance: Option<f64>,
    /// Volume of the result less that of the truth, % of the truth; none where the truth is empty on all.
    pub volume_error_percent: Option<f64>,
}

/// The same for one slice.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SliceScore {
    /// Name of the slice.
    pub name: String,
    /// Its height.
    pub z: f64,
    /// Pixels inside, truth and result.
    pub pixels: [usize; 2],
    /// Dice coefficient; none where the truth is empty.
    pub dice: Option<f64>,
    /// Mean contour distance, unit of the stack; none where one of both is empty.
    pub surface_distance: Option<f64>,
    /// Area of the result less that of the truth, % of the truth; none where the truth is empty.
    pub area_error_percent: Option<f64>,
}

/// Leaves out every `leave`-th slice but for the first and last, reconstructs them from the rest, and compares.
///
/// # Errors
/// [`Error::Setting`] if `leave` is less than 2 or there are links, [`Error::Stack`] if that leaves nothing out; as [`crate::reconstruct_with`].
pub fn hold_out(
    stack: &ContourStack,
    settings: &Settings,
    leave: usize,
    backend: &dyn Backend,
    progress: &dyn Progress,
) -> Result<HoldOut> {
    stack.validate()?;
    if leave < 2 {
        let message = format!("must be at least 2: 2 leaves out every second slice; got {leave}");
        return Err(Error::Setting { name: "leave".into(), message });
    }
    if !settings.links.is_empty() {
        let message = "name parts of neighbouring slices; with slices left out these are no neighbours".to_string();
        return Err(Error::Setting { name: "links".into(), message });
    }
    let last = stack.slices.len() - 1;
    let left_out = |k: usize| k > 0 && k < last && k % leave == leave - 1;
    let (dropped, kept): (Vec<usize>, Vec<usize>) = (0..=last).partition(|&k| left_out(k));
    if dropped.is_empty() {
        let message = format!(
            "{} slices leave nothing out with `--leave {leave}`; at least {leave} and one more are needed",
            last + 1
        );
        return Err(Error::Stack(message));
    }
    let slices: Vec<Slice> = kept.iter().map(|&k| stack.slices[k].clone()).collect();
    let rest = ContourStack {
        dims: stack.dims,
        spacing: stack.spacing,
        unit: stack.unit.clone(),
        slices,
        z_out: None,
        geometry: stack.geometry,
    };
    let heights: Vec<f64> = dropped.iter().map(|&k| stack.slices[k].z).collect();
    let (mut out, mut both, mut sizes, mut distances) =
        (HoldOut { leave, ..HoldOut::default() }, 0, [0, 0], Vec::new());
    let mut truth = dropped.iter().map(|&k| &stack.slices[k]);
    let mut score = |layer: Layer| {
        let Some(slice) = layer.output.then(|| truth.next()).flatten() else { return Ok(()) };
        let masks = [slice.content.sides(), layer.phi.iter().map(|v| *v < 0.0).collect()];
        let pixels = masks.each_ref().map(|m| m.iter().filter(|i| **i).count());
        if pixels == [0, 0] {
            return Ok(());
        }
        let common = masks[0].iter().zip(&masks[1]).filter(|(a, b)| **a && **b).count();
        let distance = contour_distance(&masks, stack.dims, stack.spacing);
        both += common;
        sizes = [sizes[0] + pixels[0], sizes[1] + pixels[1]];
        distances.extend(distance);
        out.slices.push(SliceScore {
            name: slice.name.clone(),
            z: slice.z,
            pixels,
            dice: dice(common, pixels),
            surface_distance: distance,
            area_error_percent: excess(pixels),
        });
        Ok(())
    };
    let means = Means { backend, progress, budget: &Budget::unlimited() };
    crate::reconstruct_into(&rest, &heights, settings, &means, &mut score)?;
    out.dice = dice(both, sizes);
    out.surface_distance = (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64);
    out.volume_error_percent = excess(sizes);
    Ok(out)
}

/// `2 |A and B| / (|A| + |B|)` where there is a truth.
fn dice(common: usize, [truth, found]: [usize; 2]) -> Option<f64> {
    (truth > 0).then(|| 2.0 * common as f64 / (truth + found) as f64)
}

/// How much more there is in the second than in the first, % of the first where there is any.
fn excess([truth, found]: [usize; 2]) -> Option<f64> {
    (truth > 0).then(|| 100.0 * (found as f64 - truth as f64) / truth as f64)
}

/// Mean distance of each mask's border pixels to the other mask's border.
fn contour_distance(masks: &[Vec<bool>; 2], dims: [usize; 2], spacing: [f64; 2]) -> Option<f64> {
    if masks.iter().any(|m| !m.contains(&true) || !m.contains(&false)) {
        return None;
    }
    let px = spacing[0].max(spacing[1]);
    let fields = masks.each_ref().map(|m| exact_distance(m, dims, spacing.map(|s| s / px)));
    let [nx, ny] = dims;
    let (mut sum, mut count) = (0.0, 0usize);
    for (own, other) in [(0, 1), (1, 0)] {
        let inside = |n: usize| masks[own][n];
        for n in (0..nx * ny).filter(|&n| inside(n)) {
            let (i, j) = (n % nx, n / nx);
            let open = (i > 0 && !inside(n - 1))
                || (i + 1 < nx && !inside(n + 1))
                || (j > 0 && !inside(n - nx))
                || (j + 1 < ny && !inside(n + nx));
            if open {
                // Both borders run half a pixel outside of their last pixels.
                sum += (fields[other].data[n] - fields[own].data[n]).abs() * px;
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / count as f64)
}
