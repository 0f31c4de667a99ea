//! The curve of the field's values along a trajectory: its slopes at the slices, what lies between them, and how upright a surface is.

use crate::grid::spline::{harmonic, hermite_values, limited, smoothstep, van_albada};

/// Share of `4 t^2 (1 - t)^2 |A - B|` taken off of what is no relief: what interpolated distances shrink by systematically.
pub const SHRINKING: f64 = 0.2;

/// Surfaces that go sideways by more than this per height are less upright, those that go by more than FLAT not at all.
pub const STEEP: f64 = 1.5;
/// See [`STEEP`].
pub const FLAT: f64 = 4.0;

/// Slope of the field at a slice from the secants of the intervals below and above it, per height: the mean of PCHIP and of Catmull-Rom limited
/// to three times the smaller secant; of relief van Albada's, since beside a contour a plain stays a plain although a slope begins on the
/// other side. None of them has a unit of height.
#[inline(always)]
pub fn slope([below, above]: [f64; 2], [h_below, h_above]: [f64; 2], relief: f64) -> f64 {
    let pchip = harmonic(below, above, h_below, h_above);
    let mean = (h_above * below + h_below * above) / (h_below + h_above);
    (1.0 - relief) * 0.5 * (pchip + limited(mean, below, above)) + relief * van_albada(below, above)
}

/// Value of the field at time `t` of an interval, from values and slopes (per interval) at both ends. What it shrinks by is taken off where
/// there is room for it above the lesser end: `s r / sqrt(s^2 + r^2)`, or a body would swell beyond its larger contour.
#[inline]
pub fn between([a, b]: [f64; 2], [ma, mb]: [f64; 2], relief: f64, t: f64) -> f64 {
    let shrinking = SHRINKING * (1.0 - relief) * 4.0 * (t * (1.0 - t)).powi(2) * (a - b).abs();
    let value = hermite_values([a, b], [ma, mb], t);
    let room = (value - a.min(b)).max(0.0);
    let square = shrinking * shrinking + room * room;
    if square > 0.0 { value - shrinking * room / square.sqrt() } else { value }
}

/// Uprightness of a surface that goes `sideways` per height: 1 for a wall, 0 for a plain. What lies flat is relief between contour lines, which
/// neither shrinks nor shows creases.
#[inline]
pub fn upright(sideways: f64) -> f64 {
    1.0 - smoothstep((sideways - STEEP) / (FLAT - STEEP))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Secants below and above, and gaps.
    fn some() -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let secants = [-40.0, -3.0, -0.2, 0.0, 0.05, 0.7, 2.0, 2.5, 6.0, 90.0];
        let pairs = secants.into_iter().flat_map(move |a| secants.map(|b| [a, b]));
        pairs.flat_map(|d| [[1.0, 1.0], [0.3, 2.0]].map(|h| (d, h)))
    }

    #[test]
    fn slopes_are_the_same_upside_down() {
        for (([a, b], [h, k]), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            assert_eq!(slope([a, b], [h, k], relief), -slope([-b, -a], [k, h], relief), "{a} {b} {h} {k}");
        }
    }

    #[test]
    fn a_line_keeps_its_slope_and_none_overshoots() {
        for ((d @ [a, b], h), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            let m = slope(d, h, relief);
            if a == b {
                assert!((m - a).abs() <= 1e-12 * a.abs(), "{a}: {m}");
            }
            // Up to three times the smaller secant a cubic curve stays monotone (Fritsch and Carlson 1980).
            let (sign, least) = (if a * b > 0.0 { a.signum() } else { 0.0 }, a.abs().min(b.abs()));
            assert!(m * sign >= 0.0 && m.abs() <= 3.0 * least * sign.abs(), "{d:?}, {h:?}: {m}");
        }
    }

    #[test]
    fn a_monotone_curve_stays_between_its_ends() {
        let times = (0..=64).map(|k| f64::from(k) / 64.0);
        for ((a, b), t) in
            [(8.5_f64, -0.4), (-0.4, 8.5), (1.0, 1.0)].iter().flat_map(|e| times.clone().map(move |t| (*e, t)))
        {
            for m in [0.0, 1.0, 3.0].iter().flat_map(|m| [0.0, 1.0, 3.0].map(|n| [m * (b - a), n * (b - a)])) {
                let (least, most) = (a.min(b), a.max(b));
                let value = between([a, b], m, 0.0, t);
                assert!((least - 1e-12..=most + 1e-12).contains(&value), "{a} {b} {m:?} {t}: {value}");
                assert_eq!(value, between([b, a], [-m[1], -m[0]], 0.0, 1.0 - t), "upside down");
                if m == [b - a; 2] && t == 0.5 {
                    let full = SHRINKING * 0.25 * (a - b).abs();
                    assert!(
                        (0.5 * (a + b) - value - full).abs() <= 0.01 * full,
                        "where there is room all of it is taken off"
                    );
                }
            }
        }
    }

    #[test]
    fn slopes_have_no_unit_of_height() {
        for ((d, h), relief) in some().flat_map(|d| [0.0, 0.3, 1.0].map(|relief| (d, relief))) {
            // A power of two, so that nothing is rounded.
            let stretched = slope(d.map(|d| d / 8.0), h.map(|h| 8.0 * h), relief);
            assert_eq!(8.0 * stretched, slope(d, h, relief), "{d:?}, {h:?}");
        }
    }

    #[test]
    fn of_relief_the_smaller_secant_counts_more() {
        let [h, d] = [[1.0, 1.0], [0.5, 1.5]];
        // PCHIP 0.75 and Catmull-Rom 1; 1.5 / 2.5.
        assert_eq!([0.0, 1.0].map(|relief| slope(d, h, relief)), [0.5 * (0.75 + 1.0), 0.6]);
    }
}
