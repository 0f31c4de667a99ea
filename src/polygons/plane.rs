//! Contours drawn in space: the planes they lie on.
//!
//! All contours share one normal, an axis of the world where that fits, else the mean of their own. Heights are distances along it.

use glam::{DVec2, DVec3};

use super::Polygon;

/// Distance, mm, by which heights of a contour's points may differ, and planes may differ in height and still be one: well below the slice distances of
/// patients, well above rounded coordinates. Of images of small animals and specimens slices may lie as near: there it is less ([`PlaneSet::tolerance`]).
pub const TOLERANCE: f64 = 0.1;
/// Least of them: what coordinates of 16 characters are rounded by.
const LEAST: f64 = 1e-4;

/// Parallel planes of contours.
#[derive(Debug, Clone)]
pub struct PlaneSet {
    /// Unit vectors: x and y in the planes, and the normal along which heights are measured; right-handed.
    pub axes: [DVec3; 3],
    /// Heights `p . n` of the planes, increasing: mean over the points of their contours.
    pub heights: Vec<f64>,
    /// Number of the plane on which each contour lies.
    pub plane_of: Vec<usize>,
    /// Heights of contours within this are one plane, mm: the first of [`TOLERANCE`], a tenth, a hundredth of it, ... by which planes are farther apart.
    pub tolerance: f64,
}

/// A contour that leaves its plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Bent {
    /// Number of the contour.
    pub contour: usize,
    /// By how much, end to end.
    pub by: f64,
    /// The normal.
    pub normal: DVec3,
}

impl PlaneSet {
    /// The planes of `contours` (each of at least 3 points).
    ///
    /// # Errors
    /// The contour that leaves its plane most.
    pub fn of(contours: &[&[DVec3]]) -> Result<Self, Bent> {
        let straight = [DVec3::Z, DVec3::X, DVec3::Y];
        let fits = |n: &DVec3| worst(contours, *n).is_none_or(|bent| bent.by <= TOLERANCE);
        let normal = straight.into_iter().find(fits).unwrap_or_else(|| mean_normal(contours));
        match worst(contours, normal) {
            Some(bent) if bent.by > TOLERANCE || bent.by.is_nan() => return Err(bent),
            _ => {}
        }
        let axes = frame(normal);
        let height = |c: &&[DVec3]| mean(&c.iter().map(|p| p.dot(normal)).collect::<Vec<f64>>());
        let of: Vec<f64> = contours.iter().map(height).collect();
        let mut order: Vec<usize> = (0..of.len()).collect();
        order.sort_by(|a, b| of[*a].total_cmp(&of[*b]));
        let heights: Vec<f64> = order.iter().map(|k| of[*k]).collect();
        let mut tolerance = TOLERANCE;
        let mut planes = grouped(&heights, tolerance);
        while tolerance > LEAST && planes.windows(2).any(|w| w[1][0] - w[0][w[0].len() - 1] <= tolerance) {
            tolerance *= 0.1;
            planes = grouped(&heights, tolerance);
        }
        let mut plane_of = vec![0; of.len()];
        let numbers = planes.iter().enumerate().flat_map(|(plane, all)| all.iter().map(move |_| plane));
        order.into_iter().zip(numbers).for_each(|(k, plane)| plane_of[k] = plane);
        Ok(PlaneSet { axes, heights: planes.iter().map(|p| mean(p)).collect(), plane_of, tolerance })
    }

    /// A contour in the coordinates of its plane.
    pub fn project(&self, contour: &[DVec3]) -> Polygon {
        contour.iter().map(|p| DVec2::new(p.dot(self.axes[0]), p.dot(self.axes[1]))).collect()
    }
}

/// Increasing heights in groups, each within `tolerance` of its first one.
fn grouped(heights: &[f64], tolerance: f64) -> Vec<&[f64]> {
    let mut groups = Vec::new();
    let mut rest = heights;
    while let Some(first) = rest.first() {
        // One that is no number is a group of its own.
        let (group, others) = rest.split_at(rest.partition_point(|h| h - first <= tolerance).max(1));
        groups.push(group);
        rest = others;
    }
    groups
}

/// Mean about the first value: equal values give exactly that value, where sums would round.
fn mean(values: &[f64]) -> f64 {
    let first = values.first().copied().unwrap_or(0.0);
    first + values.iter().map(|v| v - first).sum::<f64>() / values.len().max(1) as f64
}

/// Smallest gap between neighbouring heights; nothing for fewer than two.
pub fn smallest_gap(heights: &[f64]) -> Option<f64> {
    heights.windows(2).map(|w| w[1] - w[0]).min_by(f64::total_cmp)
}

/// The contour whose heights along `normal` differ most.
fn worst(contours: &[&[DVec3]], normal: DVec3) -> Option<Bent> {
    let spread = |c: &[DVec3]| {
        let heights = c.iter().map(|p| p.dot(normal));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
        high - low
    };
    let all = contours.iter().enumerate().map(|(contour, c)| Bent { contour, by: spread(c), normal });
    all.max_by(|a, b| a.by.total_cmp(&b.by))
}

/// Sum of the contours' area vectors `1/2 sum p x q` (Newell), each turned to agree with the largest, as a unit vector whose largest
/// component is positive.
fn mean_normal(contours: &[&[DVec3]]) -> DVec3 {
    let vectors: Vec<DVec3> = contours.iter().map(|c| area_vector(c)).collect();
    let largest =
        vectors.iter().copied().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared())).unwrap_or(DVec3::Z);
    let unit = unit(vectors.iter().map(|v| if v.dot(largest) < 0.0 { -*v } else { *v }).sum());
    if unit[dominant(unit)] < 0.0 { -unit } else { unit }
}

fn area_vector(contour: &[DVec3]) -> DVec3 {
    // About the first point: far from the origin the terms would cancel.
    let Some(o) = contour.first() else { return DVec3::ZERO };
    contour.windows(2).map(|w| 0.5 * (w[0] - o).cross(w[1] - o)).sum()
}

/// Axes in the plane: the first is the world axis after the normal's own, laid into the plane; axial planes get x and y.
fn frame(normal: DVec3) -> [DVec3; 3] {
    let after = (dominant(normal) + 1) % 3;
    let x = unit(DVec3::AXES[after] - normal[after] * normal);
    [x, normal.cross(x), normal]
}

fn dominant(v: DVec3) -> usize {
    (0..3).max_by(|a, b| v[*a].abs().total_cmp(&v[*b].abs())).unwrap_or(2)
}

fn unit(v: DVec3) -> DVec3 {
    let length = v.length();
    if length > 0.0 { v / length } else { DVec3::Z }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Planes of squares at these heights.
    fn planes(heights: &[f64]) -> PlaneSet {
        let square = |z: f64| [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]].map(|[x, y]| DVec3::new(x, y, z));
        let squares: Vec<[DVec3; 4]> = heights.iter().copied().map(square).collect();
        PlaneSet::of(&squares.iter().map(<[_; 4]>::as_slice).collect::<Vec<_>>()).expect("they are flat")
    }

    #[test]
    fn planes_as_near_as_contours_of_one_plane_may_be_stay_apart() {
        for gap in [3.0, 0.12, 0.1, 0.09, 0.05, 0.02, 0.004] {
            let heights: Vec<f64> = (0..30).map(|k| 7.0 + gap * f64::from(k)).collect();
            let found = planes(&heights);
            assert_eq!(found.heights.len(), 30, "{gap} mm apart");
            assert!(found.tolerance < gap && found.plane_of.iter().copied().eq(0..30), "{gap} mm apart");
        }
        // Contours of one plane are one, whatever their order, where planes are farther apart.
        let wobbling = [3.05, 0.0, 0.1, 6.0, 0.03, 5.93, 3.0];
        let found = planes(&wobbling);
        assert_eq!((found.plane_of, found.tolerance), (vec![1, 0, 0, 2, 0, 2, 1], TOLERANCE));
        assert_eq!(planes(&[0.0, 0.05, 0.051, 0.1, 0.15]).plane_of, [0, 1, 1, 2, 3]);
    }

    #[test]
    fn the_first_axis_is_the_worlds_after_the_normals() {
        let [x, y, z] = DVec3::AXES;
        assert_eq!([z, x, y].map(frame), [[x, y, z], [y, z, x], [z, x, y]]);
        for normal in [DVec3::new(0.1, -0.2, 0.9), DVec3::new(-0.8, 0.3, 0.2), DVec3::new(0.2, 0.7, -0.3)] {
            let axes = frame(normal.normalize());
            let after = (dominant(normal) + 1) % 3;
            assert!(axes[0].dot(DVec3::AXES[after]) > 0.9, "{axes:?}");
            assert!((axes[0].cross(axes[1]) - axes[2]).length() < 1e-12, "{axes:?}");
            assert!(axes.iter().all(|a| (a.length() - 1.0).abs() < 1e-12) && axes[0].dot(axes[2]).abs() < 1e-12);
        }
    }
}
