//! Ends of a body that goes on evenly up to a contour and is rounded off from there: a finger, a bone, a tube with a closed end.
//!
//! Its last three areas do not tell it from a ball: those of a rod, A, A, A - d, lie on a parabola that falls half as fast as what rounds the rod off. A
//! fourth does. Of the line through the areas of the third and the fourth contour the first two keep off by D and d; where the fall is quadratic from a
//! height z on, by (see below) D = k (z1 - z)^2 and d = k (z2 - z)^2, d at most the share that it has where z is the third contour's height. Of a ball d is
//! more (a third of D by even gaps, and there a quarter), and its areas are left to the parabola through three of them: where the fall begins at the third
//! contour both laws are one.

use crate::grid::spline::smoothstep;

/// What four areas say of an end that is rounded off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounded {
    /// Change of the area per height at the outermost contour, outward.
    pub slope: f64,
    /// Half its second derivative.
    pub bend: f64,
    /// Share of it in what lies beyond the contour, the rest being the parabola's through three areas: 1 of what rounds off a rod, 0 where all of the fall
    /// is that of the line.
    pub share: f64,
    /// Share of the gap to the next contour as a limit of the height. Where the second contour tells nothing of the fall, this began at it at the earliest: it
    /// is as steep as that says, or steeper, and had the next slice not been empty it would have been drawn.
    pub limited: f64,
}

impl Rounded {
    /// By the areas of four contours, the outermost first, at distances `away` (increasing, the first 0) inward. Nothing where there are fewer, or where they
    /// fall otherwise.
    pub fn through(areas: &[f64], away: &[f64]) -> Option<Self> {
        let (&[area, second, third, fourth, ..], &[_, gap, far, farthest, ..]) = (areas, away) else { return None };
        let slope = (third - fourth) / (farthest - far);
        let off = |area: f64, away: f64| third + slope * (far - away) - area;
        let (first_off, second_off) = (off(area, 0.0), off(second, gap).max(0.0));
        let most = ((far - gap) / far).powi(2) * first_off;
        if first_off <= 0.0 || second <= area || second_off >= most {
            return None;
        }
        let root = (first_off.sqrt() - second_off.sqrt()) / gap;
        let share = smoothstep(first_off / (second - area));
        Some(Rounded {
            slope: slope - 2.0 * root * first_off.sqrt(),
            bend: -root * root,
            share,
            limited: share * (1.0 - second_off / most),
        })
    }

    /// Slope and half the second derivative beyond the contour, where the parabola's are `parabola`.
    pub fn blended(&self, [slope, bend]: [f64; 2]) -> [f64; 2] {
        [slope + self.share * (self.slope - slope), bend + self.share * (self.bend - bend)]
    }

    /// The largest height, where the gap to the next contour is `gap` and the largest of all ends is `highest`: the harmonic mean of the two.
    pub fn limit(&self, gap: f64, highest: f64) -> f64 {
        if gap < highest { 1.0 / ((1.0 - self.limited) / highest + self.limited / gap) } else { highest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Areas of a rod that widens inward by `line` per height and is rounded off from `start` below the outermost contour on, over `long`.
    fn rod(away: &[f64], line: f64, start: f64, long: f64) -> Vec<f64> {
        let fall = |t: f64| 100.0 * ((start - t).max(0.0) / long).powi(2);
        away.iter().map(|t| 100.0 + line * (t - start) - fall(*t)).collect()
    }

    #[test]
    fn a_rod_is_rounded_off_as_it_is() {
        // The fall begins between the second contour and the third.
        for away in [[0.0, 1.0, 2.0, 3.0], [0.0, 0.7, 2.0, 2.4]] {
            for (line, start) in [(0.0, 1.01), (0.0, 1.9), (3.0, 1.5), (-3.0, 1.2)] {
                let found = Rounded::through(&rod(&away, line, start, 2.5), &away).expect("it is rounded");
                let [slope, bend] = [-line - 200.0 * start / 6.25, -100.0 / 6.25];
                assert!((found.slope - slope).abs() < 1e-9 && (found.bend - bend).abs() < 1e-9, "{found:?}, {slope}");
                assert!(line != 0.0 || found.share > 0.99, "{found:?}");
            }
        }
    }

    #[test]
    fn where_the_second_contour_tells_nothing_the_next_gap_is_the_limit() {
        let away = [0.0, 1.0, 2.0, 3.0];
        // The fall begins below the outermost contour: it is taken to begin at the second.
        let found = Rounded::through(&rod(&away, 0.0, 0.6, 1.0), &away).expect("it is rounded");
        assert!((found.slope + 72.0).abs() < 1e-9 && (found.bend + 36.0).abs() < 1e-9, "{found:?}");
        assert_eq!((found.share, found.limited), (1.0, 1.0));
        assert_eq!([found.limit(1.0, 2.0), found.limit(1.0, f64::INFINITY), found.limit(1.0, 0.5)], [1.0, 1.0, 0.5]);
        // The later the second contour tells of it, the less.
        let limits = [1.0, 1.2, 1.5, 1.8, 2.0 - 1e-9].map(|start| {
            let found = Rounded::through(&rod(&away, 0.0, start, 2.5), &away).expect("it is rounded");
            found.limit(1.0, 2.0)
        });
        assert!(limits[0] == 1.0 && limits.windows(2).all(|w| w[0] < w[1]) && limits[4] > 1.99, "{limits:?}");
    }

    #[test]
    fn balls_cones_and_paraboloids_are_not() {
        let away = [0.0, 1.0, 2.0, 3.0];
        let of = |area: fn(f64) -> f64| Rounded::through(&away.map(area), &away);
        assert_eq!(of(|t| 25.0 - (2.0 - t).powi(2)), None, "a ball");
        assert_eq!(of(|t| (0.5 + t).powi(2)), None, "a cone");
        assert_eq!(of(|t| 3.0 + 4.0 * t), None, "a paraboloid");
        assert_eq!(of(|_| 7.0), None, "a rod that ends flat");
        assert_eq!(of(|t| 7.0 - t), None, "one that widens towards its end");
        assert_eq!(Rounded::through(&[1.0, 2.0, 2.0], &away), None, "three contours");
    }

    #[test]
    fn noise_of_a_paraboloid_has_no_say() {
        // Areas off by half a percent: what falls faster than the line is a small part of the fall.
        let away = [0.0, 1.0, 2.0, 3.0];
        for k in 0..100 {
            let off = |n: usize| 1.0 + 0.005 * (1.7 * f64::from(k) + 2.9 * n as f64).sin();
            let areas: Vec<f64> = away.iter().enumerate().map(|(n, t)| (30.0 + 20.0 * t) * off(n)).collect();
            assert!(Rounded::through(&areas, &away).is_none_or(|found| found.share < 0.02), "{k}");
        }
    }
}
