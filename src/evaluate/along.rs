//! Heights of a map's surface along lines that were left out.
//!
//! Where a line between the centres of two neighbouring pixels crosses the contour of level z, `h = (1 - s) h_a + s h_b` with the heights of the
//! surface at both centres and the crossing's share `s` of the way; the error is the root of the mean of `(h - z)^2` over all crossings.

use super::view::View;
use crate::stack::SliceContent;

/// A sum of squares, and over how many crossings.
#[derive(Debug, Clone, Copy, Default)]
pub struct Errors {
    sum: f64,
    count: usize,
}

impl Errors {
    /// Of heights at the pixels in view, row-major, NaN where there is none, along the contour of `content` at height `z`.
    pub fn of(content: &SliceContent, z: f64, heights: &[f64], view: &View) -> Self {
        let values: Vec<f64> = match content {
            SliceContent::Level(level) => level.values().into_iter().map(f64::from).collect(),
            SliceContent::Mask(mask) => mask.iter().map(|inside| if inside { -0.5 } else { 0.5 }).collect(),
        };
        let values = view.of(&values);
        let [nx, ny] = view.dims;
        let mut errors = Errors::default();
        for n in 0..nx * ny {
            let beside = [(n % nx + 1 < nx).then_some(n + 1), (n / nx + 1 < ny).then_some(n + nx)];
            for m in beside.into_iter().flatten().filter(|m| (values[n] < 0.0) != (values[*m] < 0.0)) {
                let share = values[n] / (values[n] - values[m]);
                let height = (1.0 - share) * heights[n] + share * heights[m];
                if height.is_finite() {
                    errors.sum += (height - z) * (height - z);
                    errors.count += 1;
                }
            }
        }
        errors
    }

    /// Both together.
    pub fn add(&mut self, other: &Errors) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// Root of the mean of squares; none without a crossing.
    pub fn root_mean_square(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum / self.count as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::LevelSlice;

    /// A plane that rises by 3 per pixel to the right, and its contour at 10.5, between two pixels; what is off by 2 everywhere, and has no height at the
    /// left.
    #[test]
    fn errors_are_those_at_the_contour() {
        let dims = [9, 4];
        let plane: Vec<f64> = (0..36).map(|n| 3.0 * (n % 9) as f64).collect();
        let level: Vec<f32> = plane.iter().map(|h| (10.5 - h) as f32).collect();
        let content = SliceContent::Level(LevelSlice::new(&level, 9));
        let view = View::whole(dims);
        let exact = Errors::of(&content, 10.5, &plane, &view);
        assert!(exact.count == 4 && exact.root_mean_square().is_some_and(|e| e < 1e-6), "{exact:?}");
        let off: Vec<f64> = plane.iter().map(|h| if *h < 3.0 { f64::NAN } else { h - 2.0 }).collect();
        let mut both = Errors::of(&content, 10.5, &off, &view);
        assert!(both.root_mean_square().is_some_and(|e| (e - 2.0).abs() < 1e-6), "{both:?}");
        both.add(&exact);
        assert!(both.root_mean_square().is_some_and(|e| (e - 2f64.sqrt()).abs() < 1e-6), "{both:?}");
        assert_eq!(Errors::of(&content, 10.5, &[f64::NAN; 36], &view).root_mean_square(), None);
        // Of the columns before the contour.
        let part = View { first: [0, 1], dims: [3, 2], of: dims };
        assert_eq!(Errors::of(&content, 10.5, &part.of(&plane), &part).root_mean_square(), None);
    }
}
