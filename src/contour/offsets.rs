//! Areas of what a distance field encloses once its contour is drawn in or out.

use crate::grid::field::covered;

/// Steps of offsets per px; half a pixel is a whole number of them, so that areas at whole steps are exact.
const PER_PX: i64 = 50;
/// The farthest that a contour is drawn out, px: fields are known to the margin of tiles, which is at least 12.
pub const OUT: i64 = 11;

/// Areas over offsets: `A(d) = sum covered(phi + d)`, px squared, falling.
#[derive(Debug, Clone)]
pub struct Offsets {
    /// Number of the first offset, in steps.
    first: i64,
    areas: Vec<f64>,
    /// Inradius, px.
    pub depth: f64,
}

impl Offsets {
    /// The areas of a field, negative inside, by its values at the pixels that count.
    pub fn new(values: impl Iterator<Item = f64> + Clone) -> Self {
        let step = 1.0 / PER_PX as f64;
        let deepest = values.clone().fold(0.0, f64::min);
        let low = (deepest * PER_PX as f64).floor() as i64 - 1;
        let high = (OUT + 1) * PER_PX;
        let mut counts = vec![[0.0; 2]; (high - low + 1) as usize];
        for v in values {
            let bin = (v * PER_PX as f64).floor();
            if bin < high as f64 {
                let [count, sum] = &mut counts[(bin as i64 - low) as usize];
                (*count, *sum) = (*count + 1.0, *sum + v);
            }
        }
        // Integral of the number of values below s, at each step: `sum max(0, s - v)`.
        let mut below = [0.0; 2];
        let mut integral = Vec::with_capacity(counts.len());
        for (k, [count, sum]) in counts.into_iter().enumerate() {
            integral.push((low + k as i64) as f64 * step * below[0] - below[1]);
            below = [below[0] + count, below[1] + sum];
        }
        let at = |k: i64| if k < low { 0.0 } else { integral[(k - low) as usize] };
        let half = PER_PX / 2;
        let first = -OUT * PER_PX;
        let areas = (first..=half - low).map(|d| (at(half - d) - at(-half - d)).max(0.0)).collect();
        Offsets { first, areas, depth: -deepest }
    }

    /// The offset at which this area is enclosed; positive ones draw the contour in.
    pub fn of(&self, area: f64) -> f64 {
        let k = self.areas.partition_point(|a| *a > area).clamp(1, self.areas.len() - 1);
        let [a, b] = [self.areas[k - 1], self.areas[k]];
        let f = if a > b { ((a - area) / (a - b)).clamp(0.0, 1.0) } else { 1.0 };
        (self.first as f64 + (k - 1) as f64 + f) / PER_PX as f64
    }

    /// Length of the contour, px: how fast the area falls at first.
    pub fn perimeter(&self) -> f64 {
        let own = (-self.first) as usize;
        let around = PER_PX as usize / 2;
        self.areas[own - around] - self.areas[(own + around).min(self.areas.len() - 1)]
    }
}

/// Area that a field encloses on pixels of these values, px squared.
pub fn area(values: impl Iterator<Item = f64>) -> f64 {
    values.map(covered).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::field::Field;

    #[test]
    fn a_disc_drawn_in_or_out_has_its_area() {
        let disc = Field::from_fn([61, 61], |i, j| (i as f64 - 30.3).hypot(j as f64 - 29.8) - 12.0);
        let values = || disc.data.iter().copied();
        let offsets = Offsets::new(values());
        assert!((offsets.of(area(values()))).abs() < 1e-9);
        for radius in [1.0f64, 3.0, 8.5, 12.0, 15.0, 21.0] {
            let found = offsets.of(std::f64::consts::PI * radius.powi(2));
            // A disc of a few pixels has its area from few of them. Seen: 0.045 at a radius of 1.
            assert!((12.0 - radius - found).abs() < 0.02 + 0.04 / radius, "{radius}: {found}");
        }
        assert!((offsets.perimeter() / (24.0 * std::f64::consts::PI) - 1.0).abs() < 0.01);
        assert!(offsets.of(0.0) >= 12.0);
    }
}
