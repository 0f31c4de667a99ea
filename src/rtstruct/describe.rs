//! Description of a structure set, as a colleague would give it.

use super::{ChosenRois, Roi, StructureSet};
use crate::error::{Result, counted};
use crate::polygons::plane::smallest_gap;
use crate::polygons::zones;
use crate::stack::ReadOptions;

impl StructureSet {
    /// Every ROI: its planes, contours and holes, what would be left out, and why it cannot be reconstructed where it cannot.
    pub fn describe(&self) -> Vec<String> {
        let drawn = self.rois.iter().filter(|r| r.is_drawn()).count();
        let mut lines = vec![format!("RT structure set, {} ROIs, {drawn} of them drawn", self.rois.len())];
        for roi in &self.rois {
            lines.extend(self.describe_roi(roi));
        }
        lines
    }

    /// The ROIs that `options` name, or the only one, where they are drawn on too few planes to be reconstructed; nothing of others.
    ///
    /// # Errors
    /// The errors of [`StructureSet::find`].
    pub fn describe_flat(&self, options: &ReadOptions) -> Result<Option<Vec<String>>> {
        let named = options.roi.iter().map(|name| self.find(name)).collect::<Result<Vec<_>>>()?;
        let rois = if named.is_empty() { self.rois.iter().collect() } else { named };
        let flat = self.on_planes(rois.clone(), options.pixel).is_ok_and(|chosen| chosen.planes.heights.len() < 2);
        Ok(flat.then(|| rois.into_iter().flat_map(|roi| self.describe_roi(roi)).collect()))
    }

    /// One ROI.
    fn describe_roi(&self, roi: &Roi) -> Vec<String> {
        let head = roi.label();
        if !roi.is_drawn() {
            return vec![format!("{head}: not drawn")];
        }
        match self.closed(vec![roi], None) {
            Err(e) if roi.fault.is_some() => vec![format!("{head}: cannot be read: {e}")],
            Err(e) => vec![format!("{head}: {} contours, cannot be reconstructed: {e}", roi.contours.len())],
            Ok(chosen) => chosen.describe(),
        }
    }
}

impl ChosenRois<'_> {
    /// The chosen ROIs as one body, and notes.
    pub fn describe(&self) -> Vec<String> {
        let names: Vec<String> = self.rois.iter().map(|r| r.label()).collect();
        let heights = &self.planes.heights;
        let [mut holes, mut keyholes] = [0, 0];
        for region in (0..heights.len()).flat_map(|k| self.regions(k)) {
            holes += zones::holes(&region);
            keyholes += zones::keyholes(&region);
        }
        let is_or_are = |n: usize, one: &str, more: &str| match n {
            0 => None,
            1 => Some(format!("1 contour is {one}")),
            n => Some(format!("{n} contours are {more}")),
        };
        let of_holes = [
            is_or_are(holes, "a hole", "holes"),
            is_or_are(keyholes, "a keyhole, with a hole in the same line", "keyholes, with a hole in the same line"),
        ];
        let of_holes: Vec<String> = of_holes.into_iter().flatten().collect();
        let xor = self.rois.iter().any(|r| r.contours.iter().any(super::Contour::is_xor));
        let [x, y, z] = self.planes.axes[2].to_array();
        let across = match [x, y, z] {
            [0.0, 0.0, 1.0] => "axial".into(),
            [1.0, 0.0, 0.0] => "sagittal".into(),
            [0.0, 1.0, 0.0] => "coronal".into(),
            _ => format!("oblique, normal ({x:.4}, {y:.4}, {z:.4})"),
        };
        let mut lines = vec![format!(
            "{}: {}{} on {} ({across}) at {} to {} mm, {}; {}",
            names.join(" + "),
            counted(self.planes.plane_of.len(), "contour"),
            if xor { " (XOR)" } else { "" },
            counted(heights.len(), "plane"),
            short(heights[0]),
            short(heights[heights.len() - 1]),
            gaps(heights),
            if of_holes.is_empty() { "no contour is a hole".into() } else { of_holes.join(", ") }
        )];
        lines.extend(self.notes.iter().map(|n| format!("    {n}")));
        lines
    }
}

/// The gaps between heights in words: `78 gaps of 3 mm, 1 of 6 mm`.
fn gaps(heights: &[f64]) -> String {
    let mut counted: Vec<(f64, usize)> = Vec::new();
    let mut sorted: Vec<f64> = heights.windows(2).map(|w| w[1] - w[0]).collect();
    sorted.sort_by(f64::total_cmp);
    for gap in sorted {
        match counted.last_mut() {
            Some((first, n)) if gap - *first <= 1e-3 => *n += 1,
            _ => counted.push((gap, 1)),
        }
    }
    if counted.len() > 4 {
        let (low, high) = (smallest_gap(heights).unwrap_or(0.0), counted[counted.len() - 1].0);
        return format!("gaps of {} to {} mm", short(low), short(high));
    }
    let words =
        counted.iter().map(|(gap, n)| format!("{n} gap{} of {} mm", if *n == 1 { "" } else { "s" }, short(*gap)));
    words.collect::<Vec<_>>().join(", ")
}

/// Without the tail that binary fractions leave.
fn short(v: f64) -> f64 {
    (v * 1e4).round() / 1e4
}
