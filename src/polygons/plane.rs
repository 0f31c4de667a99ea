//! Contours drawn in space: the planes they lie on.
//!
//! All contours share one normal, an axis of the world where that fits, else the mean of their own. Heights are distances along it.

use super::Polygon;

/// How far, mm, a contour's points may leave its plane, and planes may differ in height and still be one: well below any slice distance,
/// well above rounded coordinates.
pub const TOLERANCE: f64 = 0.1;

/// Parallel planes of contours.
#[derive(Debug, Clone)]
pub struct PlaneSet {
    /// Unit vectors: x and y in the planes, and the normal along which heights are measured; right-handed.
    pub axes: [[f64; 3]; 3],
    /// Heights `p . n` of the planes, increasing: mean over the points of their contours.
    pub heights: Vec<f64>,
    /// Which plane each contour lies on.
    pub plane_of: Vec<usize>,
}

/// A contour that leaves its plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Bent {
    /// Which.
    pub contour: usize,
    /// By how much, end to end.
    pub by: f64,
    /// The normal.
    pub normal: [f64; 3],
}

impl PlaneSet {
    /// The planes of `contours` (each of at least 3 points).
    ///
    /// # Errors
    /// The contour that leaves its plane most.
    pub fn of(contours: &[&[[f64; 3]]]) -> Result<Self, Bent> {
        let straight = [2, 0, 1].map(|a| std::array::from_fn(|k| f64::from(u8::from(k == a))));
        let fits = |n: &[f64; 3]| worst(contours, *n).is_none_or(|bent| bent.by <= TOLERANCE);
        let normal = straight.into_iter().find(fits).unwrap_or_else(|| mean_normal(contours));
        match worst(contours, normal) {
            Some(bent) if bent.by > TOLERANCE || bent.by.is_nan() => return Err(bent),
            _ => {}
        }
        let axes = frame(normal);
        let height = |c: &&[[f64; 3]]| mean(&c.iter().map(|p| dot(*p, normal)).collect::<Vec<f64>>());
        let of: Vec<f64> = contours.iter().map(height).collect();
        let mut order: Vec<usize> = (0..of.len()).collect();
        order.sort_by(|a, b| of[*a].total_cmp(&of[*b]));
        let (mut planes, mut plane_of) = (Vec::<Vec<f64>>::new(), vec![0; of.len()]);
        for k in order {
            match planes.last_mut() {
                Some(plane) if of[k] - plane[0] <= TOLERANCE => plane.push(of[k]),
                _ => planes.push(vec![of[k]]),
            }
            plane_of[k] = planes.len() - 1;
        }
        Ok(PlaneSet { axes, heights: planes.iter().map(|p| mean(p)).collect(), plane_of })
    }

    /// A contour in the coordinates of its plane.
    pub fn project(&self, contour: &[[f64; 3]]) -> Polygon {
        contour.iter().map(|p| [dot(*p, self.axes[0]), dot(*p, self.axes[1])]).collect()
    }
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
fn worst(contours: &[&[[f64; 3]]], normal: [f64; 3]) -> Option<Bent> {
    let spread = |c: &[[f64; 3]]| {
        let heights = c.iter().map(|p| dot(*p, normal));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
        high - low
    };
    let all = contours.iter().enumerate().map(|(contour, c)| Bent { contour, by: spread(c), normal });
    all.max_by(|a, b| a.by.total_cmp(&b.by))
}

/// Sum of the contours' area vectors `1/2 sum p x q` (Newell), each turned to agree with the largest, as a unit vector whose largest
/// component is positive.
fn mean_normal(contours: &[&[[f64; 3]]]) -> [f64; 3] {
    let vectors: Vec<[f64; 3]> = contours.iter().map(|c| area_vector(c)).collect();
    let largest = vectors.iter().copied().max_by(|a, b| dot(*a, *a).total_cmp(&dot(*b, *b))).unwrap_or([0.0, 0.0, 1.0]);
    let mut sum = [0.0; 3];
    for v in &vectors {
        let sign = if dot(*v, largest) < 0.0 { -1.0 } else { 1.0 };
        (0..3).for_each(|a| sum[a] += sign * v[a]);
    }
    let unit = unit(sum);
    if unit[dominant(unit)] < 0.0 { unit.map(|v| -v) } else { unit }
}

fn area_vector(contour: &[[f64; 3]]) -> [f64; 3] {
    // About the first point: far from the origin the terms would cancel.
    let Some(o) = contour.first() else { return [0.0; 3] };
    let from = |p: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|a| p[a] - o[a]) };
    let mut sum = [0.0; 3];
    for w in contour.windows(2) {
        let c = cross(from(&w[0]), from(&w[1]));
        (0..3).for_each(|a| sum[a] += 0.5 * c[a]);
    }
    sum
}

/// Axes in the plane: the first is the world axis after the normal's own, laid into the plane; axial planes get x and y.
fn frame(normal: [f64; 3]) -> [[f64; 3]; 3] {
    let after = (dominant(normal) + 1) % 3;
    let x = unit(std::array::from_fn(|a| f64::from(u8::from(a == after)) - normal[after] * normal[a]));
    [x, cross(normal, x), normal]
}

fn dominant(v: [f64; 3]) -> usize {
    (0..3).max_by(|a, b| v[*a].abs().total_cmp(&v[*b].abs())).unwrap_or(2)
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
