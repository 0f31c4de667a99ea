//! Law by which the area of a part falls beyond the last contour.
//!
//! The area of a sphere, an ellipsoid or a paraboloid cut by parallel planes is quadratic in their height, that of a cone with its tip on the axis
//! the square of a line: three contours give such bodies' ends exactly, whatever the cross-section's shape. A fourth tells where a body goes on evenly and is
//! [rounded off](crate::pipeline::ends::rounded) only then.

use std::f64::consts::PI;

use crate::grid::spline::smoothstep;
use crate::pipeline::ends::rounded::Rounded;
use crate::report::CapRule;

/// A tip up to so many times as far as the highest that is allowed is brought there; beyond it is lower, and from the other on there is none, unless the
/// contour is drawn in by so many px: a tube that the stack cuts goes on, and whether its areas fall by a pixel or rise by one must not decide whether
/// it has a nose. The areas of a tilted tube of radius 8 px in pixels tell of tips 7 to 100 gaps away, by contours that are drawn in by up to 0.2 px.
const FAR: [f64; 2] = [1.5, 2.5];
const DRAWN_IN: [f64; 2] = [0.25, 0.75];
/// An area falls where its contour is drawn in by more than about a third of this, px: rounding must not decide whether a body ends.
const LEAST_FALL: f64 = 1e-3;

/// Area `t` beyond the contour: `area (1 - q) (1 - (p - 1) q)`, `q = t / height`, and for `p > 2`, where that had a second zero before the tip,
/// `area ((1 - q) / (1 + (p / 2 - 1) q))^2`: a flank that is steep at the contour and gentler up to a tip that is still a cone's, not a needle. Both
/// begin with the slope `-p area / height`: 0 for half an ellipsoid, 1 for a paraboloid, 2 for a cone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    /// Area of the contour.
    pub area: f64,
    /// Height at which the area is 0.
    pub height: f64,
    /// See above.
    pub power: f64,
}

impl Law {
    /// The law that begins with `area` and its change `slope` per height, which is not positive, and ends at `height`.
    pub fn ending(area: f64, slope: f64, height: f64) -> Self {
        Law { area, height, power: -slope * height / area }
    }

    /// A paraboloid by its slope, no higher than `highest`. Nothing where it does not shrink.
    pub fn paraboloid(area: f64, slope: f64, highest: f64) -> Option<Self> {
        (slope < 0.0).then(|| Law::ending(area, slope, (-area / slope).min(highest)))
    }

    /// The law through the areas of contours, the outermost first, at distances `away` (increasing, the first 0) inward, no higher than
    /// `highest`: through three of them, which a fourth may correct, else two. Nothing where the area does not fall towards the end, or so little that the body goes on far
    /// beyond, or where there is but one.
    pub fn through(areas: &[f64], away: &[f64], highest: f64) -> Option<(Self, CapRule)> {
        let (&[area, inner, ..], &[_, gap, ..]) = (areas, away) else { return None };
        if inner - area <= LEAST_FALL * inner.sqrt() {
            return None;
        }
        let rounded = Rounded::through(areas, away);
        let parabola = quadratic(areas, away);
        let highest = rounded.map_or(highest, |rounded| rounded.limit(gap, highest));
        let (law, rule) = match rounded.map_or(parabola, |rounded| parabola.map(|parabola| rounded.blended(parabola))) {
            None => (Law::paraboloid(area, (area - inner) / gap, f64::INFINITY)?, CapRule::Paraboloid),
            Some([slope, bend]) => {
                // Of cones 0, of paraboloids 1, of balls more. The nearer zero of a cone's area is off by the root of what the area is off by: towards it
                // the line through the radii has the say.
                let root = (slope * slope - 4.0 * area * bend) / (slope * slope);
                let share = if slope < 0.0 { smoothstep(root) } else { 0.0 };
                let cone =
                    Law { area, height: tip_of_cone(areas, away, if slope < 0.0 { -root } else { 1.0 }), power: 2.0 };
                // In the form that does not cancel.
                let height = 2.0 * area / (-slope * (1.0 + root.max(0.0).sqrt()));
                let blend = |a: f64, b: f64| if share > 0.0 { a + share * (b - a) } else { a };
                let height = blend(cone.height, height);
                let law = Law::ending(area, blend(cone.slope(), slope), height);
                let rule = match rounded {
                    _ if share < 0.5 => CapRule::Cone,
                    Some(rounded) if rounded.share >= 0.5 => CapRule::Rounded,
                    _ => CapRule::Quadratic,
                };
                (law, rule)
            }
        };
        if law.height <= highest {
            return Some((law, rule));
        }
        let between = |value: f64, [low, high]: [f64; 2]| smoothstep((value - low) / (high - low));
        // Of a disc: the fall of its area over its contour's length.
        let drawn_in = (inner - area) / (4.0 * PI * inner).sqrt();
        let height = highest * (1.0 - between(law.height / highest, FAR)).max(between(drawn_in, DRAWN_IN));
        (height > 0.0).then(|| (Law::ending(area, law.slope(), height), rule))
    }

    /// Change of the area per height at the contour.
    pub fn slope(&self) -> f64 {
        -self.power * self.area / self.height
    }

    /// Area at a distance `t` beyond the contour.
    pub fn at(&self, t: f64) -> f64 {
        let q = (t / self.height).clamp(0.0, 1.0);
        let share = match self.power > 2.0 {
            true => ((1.0 - q) / (1.0 + (0.5 * self.power - 1.0) * q)).powi(2),
            false => (1.0 - q) * (1.0 - (self.power - 1.0) * q),
        };
        self.area * share
    }
}

/// Height of the tip above the outermost contour by the fall of the radii of the first three (least squares), the more so by that of the first two the more
/// its flank flares, 0 for a cone.
fn tip_of_cone(areas: &[f64], away: &[f64], flare: f64) -> f64 {
    let count = areas.len().min(away.len()).min(3);
    let radii: Vec<f64> = areas[..count].iter().map(|area| area.sqrt()).collect();
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let (middle, radius) = (mean(&away[..count]), mean(&radii));
    let (mut rise, mut square) = (0.0, 0.0);
    for (away, r) in away.iter().zip(&radii) {
        rise += (away - middle) * (r - radius);
        square += (away - middle).powi(2);
    }
    let (line, first) = (rise / square, (radii[1] - radii[0]) / away[1]);
    radii[0] / if line > 0.0 { line + smoothstep(flare) * (first - line) } else { first }
}

/// Slope and half the second derivative, outward at the outermost, of the parabola through the first three areas; nothing where there are fewer.
pub fn quadratic(areas: &[f64], away: &[f64]) -> Option<[f64; 2]> {
    let (&[a, b, c, ..], &[_, g, h, ..]) = (areas, away) else { return None };
    let [near, far] = [(a - b) / g, (a - c) / h];
    let bend = (near - far) / (h - g);
    Some([near + bend * g, bend])
}

#[cfg(test)]
mod tests {
    use super::*;

    const AWAY: [f64; 3] = [0.0, 1.3, 2.1];

    fn law(area: impl Fn(f64) -> f64, highest: f64) -> Option<(Law, CapRule)> {
        Law::through(&AWAY.map(|t| area(-t)), &AWAY, highest)
    }

    /// `t` is counted outward from the contour.
    fn close(law: Law, area: impl Fn(f64) -> f64, tip: f64) {
        assert!((law.height - tip).abs() < 1e-6 * tip, "{law:?} for {tip}");
        for k in 0..=10 {
            let t = 0.1 * f64::from(k) * tip;
            assert!((law.at(t) - area(t)).abs() < 1e-9 * area(-2.0), "{t}: {} for {}", law.at(t), area(t));
        }
    }

    #[test]
    fn spheres_and_paraboloids_end_as_they_do() {
        // A sphere of radius 3 whose last contour is 1 below its pole, a paraboloid with 0.7 to go.
        let sphere = |t: f64| 9.0 - (2.0 + t).powi(2);
        let Some((found, CapRule::Quadratic)) = law(sphere, 9.0) else { panic!("a sphere is quadratic") };
        close(found, sphere, 1.0);
        let paraboloid = |t: f64| 5.0 * (0.7 - t);
        let Some((found, CapRule::Quadratic)) = law(paraboloid, 9.0) else { panic!("a paraboloid is quadratic") };
        close(found, paraboloid, 0.7);
    }

    #[test]
    fn cones_end_at_their_tip_whatever_the_noise() {
        for noise in [-0.02, -1e-9, 0.0, 1e-9, 0.02] {
            let cone = |t: f64| (2.0 - t).powi(2) * (1.0 + noise * (7.0 * t).sin());
            let (found, _) = law(cone, 9.0).expect("it shrinks");
            // The tip is where the noise says; what lies before it has little volume.
            let volume: f64 = (0..1000).map(|k| found.at(0.003 * f64::from(k)) * 0.003).sum();
            // Seen: 9 % with 2 % of noise.
            assert!((volume / (8.0 / 3.0) - 1.0).abs() < 0.02 + 5.0 * noise.abs(), "{noise}: {found:?}, {volume}");
        }
    }

    #[test]
    fn the_tip_of_a_cone_does_not_follow_its_noise() {
        // Areas off by up to half a percent. By the nearer zero of the areas alone tips lie 0.66 to 1.01 of the way.
        for k in 0..200 {
            let off = |n: usize| 0.005 * (1.7 * f64::from(k) + 2.9 * n as f64).sin();
            let areas: Vec<f64> =
                AWAY.iter().enumerate().map(|(n, away)| (2.0 + away).powi(2) * (1.0 + off(n))).collect();
            let (found, _) = Law::through(&areas, &AWAY, 9.0).expect("it shrinks");
            assert!((0.96..1.01).contains(&(found.height / 2.0)), "{k}: {}", found.height / 2.0);
        }
    }

    #[test]
    fn flaring_ends_are_cones_and_growing_ones_none() {
        let (found, rule) = law(|t| 1.0 + (1.0 - t).powi(4), 9.0).expect("it shrinks");
        assert!(rule == CapRule::Cone && (found.power - 2.0).abs() < 1e-12, "{rule:?}, {found:?}");
        // So steep a flank that the parabola rises at the contour: what lies farther in has no say.
        let (found, rule) = Law::through(&[1.0, 2.0, 50.0], &[0.0, 1.0, 2.0], 9.0).expect("it shrinks");
        assert!(rule == CapRule::Cone && (found.height - 1.0 / (2f64.sqrt() - 1.0)).abs() < 1e-12, "{found:?}");
        assert_eq!(law(|t| 4.0 + t, 9.0), None);
        assert_eq!(law(|_| 4.0, 9.0), None);
        let two = Law::through(&[3.0, 5.0], &[0.0, 2.0], 9.0);
        assert_eq!(two, Some((Law { area: 3.0, height: 3.0, power: 1.0 }, CapRule::Paraboloid)));
    }

    #[test]
    fn a_limited_end_keeps_its_slope() {
        let (free, _) = law(|t| 9.0 - (1.0 + t).powi(2), 9.0).expect("it shrinks");
        for highest in [1.9, 1.6, 1.34] {
            let (found, _) = law(|t| 9.0 - (1.0 + t).powi(2), highest).expect("it shrinks");
            assert_eq!(found.height, highest);
            assert!((found.slope() - free.slope()).abs() < 1e-12 && found.at(highest) == 0.0, "{found:?}");
        }
    }

    #[test]
    fn a_tube_that_hardly_falls_goes_on_and_nothing_jumps() {
        // From cones that end at the highest tip to ones that go on to thrice that.
        let cones = |radius: f64| -> Vec<f64> {
            let tips = (0..=400).map(|k| 1.0 + 0.005 * f64::from(k));
            let cone = |tip: f64| law(|t| (radius * (tip - t)).powi(2), 1.0);
            tips.map(|tip| cone(tip).map_or(0.0, |(law, _)| law.height)).collect()
        };
        assert!(cones(10.0).iter().all(|h| (h - 1.0).abs() < 1e-9), "a cone that falls by pixels closes");
        let heights = cones(0.1);
        assert!(heights[..100].iter().all(|h| (h - 1.0).abs() < 1e-9) && heights[301..].iter().all(|h| *h == 0.0));
        assert!(heights.windows(2).all(|w| w[1] <= w[0] + 1e-9 && w[0] - w[1] < 0.01), "{heights:?}");
        assert_eq!(Law::through(&[200.0, 202.0, 200.0], &[0.0, 4.0, 8.0], 8.0), None, "pixels, and no end");
    }

    #[test]
    fn areas_never_turn_round() {
        // Every power there can be, cones with a tip too far among them: falling from the contour to the tip.
        for power in [0.0, 0.4, 1.0, 1.7, 2.0, 2.5, 6.0] {
            let law = Law { area: 2.0, height: 3.0, power };
            let areas: Vec<f64> = (0..=30).map(|k| law.at(0.1 * f64::from(k))).collect();
            assert!(
                areas[0] == 2.0 && areas[30].abs() < 1e-12 && areas.windows(2).all(|w| w[1] <= w[0]),
                "{power}: {areas:?}"
            );
        }
    }
}
