//! Splines through distances: cubic Hermite curves and the rules for the slope at a contour.

use crate::settings::{SlopeRule, SplineEnd};

/// Course of a piece of contour over the interval: `[S, m0, m1, ok]` in px per interval, the cubic Hermite curve
/// `s(0) = 0, s(1) = S, s'(0) = m0, s'(1) = m1`, and 1 where its particle arrived.
pub type HermiteArc = [f64; 4];

/// Cubic Hermite curve of a course, `s(0) = 0`, at `t` in [0, 1].
#[inline(always)]
pub fn hermite(&[s, m0, m1, _]: &HermiteArc, t: f64) -> f64 {
    t * (m0 + t * ((3.0 * s - 2.0 * m0 - m1) + t * (m0 + m1 - 2.0 * s)))
}

/// Its derivative.
#[inline(always)]
pub fn hermite_rate(&[s, m0, m1, _]: &HermiteArc, t: f64) -> f64 {
    m0 + t * (2.0 * (3.0 * s - 2.0 * m0 - m1) + t * 3.0 * (m0 + m1 - 2.0 * s))
}

/// Bend of a course off its chord over a step: `s(t + q dt) = (1 - q) s(t) + q s(t + dt) - q (1 - q) (b + c q)` with these `[b, c]`.
#[inline(always)]
pub fn bend(&[s, m0, m1, _]: &HermiteArc, t: f64, dt: f64) -> [f64; 2] {
    let (square, cube) = (3.0 * s - 2.0 * m0 - m1, m0 + m1 - 2.0 * s);
    [dt * dt * (square + cube * (3.0 * t + dt)), dt * dt * dt * cube]
}

/// Smooth step from 0 at `t <= 0` to 1 at `t >= 1`: `3 t^2 - 2 t^3`.
#[inline(always)]
pub fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Slope ds/dz at knot `center` of the curve that `rule` puts through the knots `(z, s)`, increasing in z. Fewer than two knots have
/// slope 0, two have their secant.
///
/// - `linear`: no slope of its own; the mean of the secants, used only to judge ends
/// - `natural`: C2 cubic spline with the given end condition (de Boor 2001, ch. IV)
/// - `hyman`: that spline's slope, limited to three times the smaller neighbouring secant, 0 at extrema (Hyman 1983)
/// - `pchip`: weighted harmonic mean (Fritsch and Butland 1984); at the ends the three-point formula, limited as in SciPy
/// - `catmull`: secants weighted by distance (a parabola through three knots), three-point ends
pub fn slope(z: &[f64], s: &[f64], center: usize, rule: SlopeRule, end: SplineEnd) -> f64 {
    let n = z.len();
    if n < 2 {
        return 0.0;
    }
    let gap = |k: usize| z[k + 1] - z[k];
    let secant = |k: usize| (s[k + 1] - s[k]) / gap(k);
    if n == 2 {
        return secant(0);
    }
    let interior = center > 0 && center + 1 < n;
    match rule {
        SlopeRule::Natural => spline_slope(z, s, center, end),
        SlopeRule::Hyman => {
            let m = spline_slope(z, s, center, end);
            if interior {
                limited(m, secant(center - 1), secant(center))
            } else {
                let d = if center == 0 { secant(0) } else { secant(n - 2) };
                limited(m, d, d)
            }
        }
        SlopeRule::Pchip if interior => harmonic(secant(center - 1), secant(center), gap(center - 1), gap(center)),
        SlopeRule::Linear | SlopeRule::Catmull if interior => {
            let (hl, hr) = (gap(center - 1), gap(center));
            (hr * secant(center - 1) + hl * secant(center)) / (hl + hr)
        }
        _ => {
            let (a, b) = if center == 0 { (0, 1) } else { (n - 2, n - 3) };
            let (da, db) = (secant(a), secant(b));
            if rule == SlopeRule::Pchip {
                three_point_end([gap(a), gap(b)], [da, db])
            } else {
                ((2.0 * gap(a) + gap(b)) * da - gap(a) * db) / (gap(a) + gap(b))
            }
        }
    }
}

/// Slope at an end from the two secants next to it, the nearer first: a parabola's, limited as in SciPy's PCHIP.
pub fn three_point_end([h0, h1]: [f64; 2], [d0, d1]: [f64; 2]) -> f64 {
    let m = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if m * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && m.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        m
    }
}

/// Cubic Hermite curve through values `a` and `b` with slopes per interval, at `t` in [0, 1].
#[inline]
pub fn hermite_values([a, b]: [f64; 2], [ma, mb]: [f64; 2], t: f64) -> f64 {
    // The same to the last bit from the other end.
    let s = 1.0 - t;
    let share = |x: f64| x * x * (3.0 - 2.0 * x);
    (share(s) * a + share(t) * b) + s * t * (s * ma - t * mb)
}

/// Weighted harmonic mean of two secants, 0 where they differ in sign.
#[inline]
pub fn harmonic(dl: f64, dr: f64, hl: f64, hr: f64) -> f64 {
    if dl * dr <= 0.0 {
        return 0.0;
    }
    let (wl, wr) = (2.0 * hr + hl, hr + 2.0 * hl);
    (wl + wr) / (wl / dl + wr / dr)
}

/// Mean of two secants that lies near the smaller one, `dl dr (dl + dr) / (dl^2 + dr^2)` (van Albada, van Leer and Roberts 1982), 0 where they
/// differ in sign.
#[inline]
pub fn van_albada(dl: f64, dr: f64) -> f64 {
    if dl * dr <= 0.0 { 0.0 } else { dl * dr * (dl + dr) / (dl * dl + dr * dr) }
}

/// `m` where it has the sign of both secants and at most three times the smaller one, else the nearest such value.
#[inline]
pub fn limited(m: f64, dl: f64, dr: f64) -> f64 {
    if dl * dr <= 0.0 || m * dl <= 0.0 {
        return 0.0;
    }
    m.abs().min(3.0 * dl.abs().min(dr.abs())).copysign(dl)
}

/// Keeps a course monotone whatever error its correspondences have: both slopes between 0 and 3 S.
pub fn monotone([s, m0, m1, ok]: HermiteArc) -> HermiteArc {
    [s, limited(m0, s, s), limited(m1, s, s), ok]
}

/// Knots for which there is room without asking for memory.
const FEW: usize = 32;

/// Slope of the C2 cubic spline at one knot; at least three knots.
fn spline_slope(z: &[f64], s: &[f64], center: usize, end: SplineEnd) -> f64 {
    let n = z.len();
    let (mut few, mut many) = ([[0.0; 4]; FEW], Vec::new());
    let rows = match few.get_mut(..n) {
        Some(rows) => rows,
        None => {
            many.resize(n, [0.0; 4]);
            &mut many[..]
        }
    };
    // Gaps and secants.
    let of = |k: usize| {
        let h = z[k + 1] - z[k];
        [h, (s[k + 1] - s[k]) / h]
    };
    // Rows (below, diagonal, above, right-hand side) of the tridiagonal system for the slopes.
    let end_row = |[h0, d0]: [f64; 2], [h1, d1]: [f64; 2]| match end {
        SplineEnd::Natural => [2.0, 1.0, 3.0 * d0],
        SplineEnd::Parabolic => [1.0, 1.0, 2.0 * d0],
        // With three knots both ends say the same: one parabola.
        SplineEnd::NotAKnot if n == 3 => [1.0, 0.0, ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)],
        SplineEnd::NotAKnot => [h1, h0 + h1, ((h0 + 2.0 * (h0 + h1)) * h1 * d0 + h0 * h0 * d1) / (h0 + h1)],
    };
    let mut before = of(0);
    let [diagonal, above, right] = end_row(before, of(1));
    rows[0] = [0.0, diagonal, above, right];
    for (i, row) in rows.iter_mut().enumerate().take(n - 1).skip(1) {
        let ([h0, d0], [h1, d1]) = (before, of(i));
        *row = [h1, 2.0 * (h0 + h1), h0, 3.0 * (h1 * d0 + h0 * d1)];
        before = [h1, d1];
    }
    let [diagonal, below, right] = end_row(before, of(n - 3));
    rows[n - 1] = [below, diagonal, 0.0, right];
    for i in 1..n {
        let [_, diagonal, above, right] = rows[i - 1];
        let factor = rows[i][0] / diagonal;
        rows[i][1] -= factor * above;
        rows[i][3] -= factor * right;
    }
    let mut m = rows[n - 1][3] / rows[n - 1][1];
    for row in rows[center..n - 1].iter().rev() {
        m = (row[3] - row[2] * m) / row[1];
    }
    m
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knots with uneven gaps.
    const Z: [f64; 6] = [0.0, 1.0, 3.0, 3.5, 5.0, 9.0];
    const RULES: [SlopeRule; 5] =
        [SlopeRule::Linear, SlopeRule::Natural, SlopeRule::Hyman, SlopeRule::Pchip, SlopeRule::Catmull];
    const ENDS: [SplineEnd; 3] = [SplineEnd::Natural, SplineEnd::Parabolic, SplineEnd::NotAKnot];

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-9, "{a}, not {b}");
    }

    /// Slopes at the first `n` knots of the curve through `f`.
    fn slopes(n: usize, rule: SlopeRule, end: SplineEnd, f: impl Fn(f64) -> f64) -> Vec<f64> {
        let s: Vec<f64> = Z[..n].iter().map(|z| f(*z)).collect();
        (0..n).map(|k| slope(&Z[..n], &s, k, rule, end)).collect()
    }

    #[test]
    fn a_course_is_the_cubic_of_its_ends() {
        // s = 3 t + t^2 - 3 t^3, with S = 1, s'(0) = 3, s'(1) = -4.
        let course = [1.0, 3.0, -4.0, 1.0];
        for t in [0.0, 0.3, 0.5, 0.9, 1.0] {
            near(hermite(&course, t), 3.0 * t + t * t - 3.0 * t * t * t);
            near(hermite_rate(&course, t), 3.0 + 2.0 * t - 9.0 * t * t);
            near(hermite_values([5.0, 6.0], [3.0, -4.0], t), 5.0 + hermite(&course, t));
        }
        let (t, dt) = (0.25, 0.5);
        let [b, c] = bend(&course, t, dt);
        for q in [0.0, 0.2, 0.7, 1.0] {
            let chord = (1.0 - q) * hermite(&course, t) + q * hermite(&course, t + dt);
            near(hermite(&course, t + q * dt), chord - q * (1.0 - q) * (b + c * q));
        }
        for (t, value) in [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.15625), (0.5, 0.5), (1.0, 1.0), (2.0, 1.0)] {
            near(smoothstep(t), value);
        }
    }

    #[test]
    fn every_rule_has_the_slope_of_a_line() {
        for rule in RULES {
            for end in ENDS {
                for n in 2..=Z.len() {
                    slopes(n, rule, end, |z| 4.0 - 3.0 * z).into_iter().for_each(|m| near(m, -3.0));
                }
            }
        }
        near(slope(&[2.0], &[7.0], 0, SlopeRule::Natural, SplineEnd::Natural), 0.0);
    }

    #[test]
    fn rules_are_exact_for_the_polynomials_that_they_promise() {
        let parabola = |z: f64| 1.0 + 2.0 * z - 0.5 * z * z;
        for (rule, end) in [
            (SlopeRule::Catmull, SplineEnd::Natural),
            (SlopeRule::Linear, SplineEnd::Natural),
            (SlopeRule::Natural, SplineEnd::Parabolic),
            (SlopeRule::Natural, SplineEnd::NotAKnot),
        ] {
            for n in 3..=Z.len() {
                for (k, m) in slopes(n, rule, end, parabola).into_iter().enumerate() {
                    near(m, 2.0 - Z[k]);
                }
            }
        }
        for n in 4..=Z.len() {
            let cubic = slopes(n, SlopeRule::Natural, SplineEnd::NotAKnot, |z| z * z * z - 4.0 * z * z);
            for (k, m) in cubic.into_iter().enumerate() {
                near(m, 3.0 * Z[k] * Z[k] - 8.0 * Z[k]);
            }
        }
    }

    #[test]
    fn a_spline_has_one_curvature_at_a_knot_and_that_of_its_rule_at_the_ends() {
        let f = |z: f64| (1.7 * z).sin() + 0.1 * z * z;
        for end in ENDS {
            for n in 3..=Z.len() {
                let m = slopes(n, SlopeRule::Natural, end, f);
                let h = |k: usize| Z[k + 1] - Z[k];
                let secant = |k: usize| (f(Z[k + 1]) - f(Z[k])) / h(k);
                // Second derivatives at the two ends of a piece.
                let first = |k: usize| (6.0 * secant(k) - 4.0 * m[k] - 2.0 * m[k + 1]) / h(k);
                let last = |k: usize| (2.0 * m[k] + 4.0 * m[k + 1] - 6.0 * secant(k)) / h(k);
                (0..n - 2).for_each(|k| near(last(k), first(k + 1)));
                let third = |k: usize| (last(k) - first(k)) / h(k);
                match end {
                    SplineEnd::Natural => [first(0), last(n - 2)].into_iter().for_each(|bend| near(bend, 0.0)),
                    SplineEnd::Parabolic => [third(0), third(n - 2)].into_iter().for_each(|third| near(third, 0.0)),
                    SplineEnd::NotAKnot => {
                        near(third(0), third(1));
                        near(third(n - 2), third(n - 3));
                    }
                }
            }
        }
    }

    #[test]
    fn limited_slopes_are_those_of_the_literature() {
        // Secants 1 and 4 over gaps 1 and 2: weights 5 and 4 (Fritsch and Butland).
        near(harmonic(1.0, 4.0, 1.0, 2.0), 1.5);
        near(slope(&[0.0, 1.0, 3.0], &[0.0, 1.0, 9.0], 1, SlopeRule::Pchip, SplineEnd::Natural), 1.5);
        near(harmonic(-1.0, 4.0, 1.0, 2.0), 0.0);
        near(van_albada(1.0, 3.0), 1.2);
        near(van_albada(1.0, -3.0), 0.0);
        // SciPy's ends: a parabola's slope, none against the secant, three times the secant at most where the next turns back.
        near(three_point_end([1.0, 2.0], [2.0, 3.0]), 5.0 / 3.0);
        near(three_point_end([1.0, 1.0], [1.0, 4.0]), 0.0);
        near(three_point_end([1.0, 1.0], [1.0, -4.0]), 3.0);
        near(three_point_end([1.0, 1.0], [1.0, -2.0]), 2.5);
        near(three_point_end([3.0, 1.0], [1.0, -0.5]), 17.0 / 8.0);
        let rising = slopes(3, SlopeRule::Pchip, SplineEnd::Natural, |z| 2.0 * z + z * z);
        near(rising[0], three_point_end([1.0, 2.0], [3.0, 6.0]));
        near(rising[2], three_point_end([2.0, 1.0], [6.0, 3.0]));
        for (m, limit) in [(2.0, 2.0), (4.0, 3.0), (-1.0, 0.0), (0.0, 0.0)] {
            near(limited(m, 1.0, 5.0), limit);
            near(limited(-m, -5.0, -1.0), -limit);
        }
        near(limited(1.0, 1.0, -1.0), 0.0);
        assert_eq!(monotone([2.0, 7.0, -1.0, 1.0]), [2.0, 6.0, 0.0, 1.0]);
    }

    #[test]
    fn hymans_slopes_are_the_splines_where_these_are_monotone() {
        // A step: the spline swings over, Hyman's does not.
        let step = |z: f64| if z < 3.2 { z } else { z + 40.0 };
        for end in ENDS {
            let (free, tame) = (slopes(6, SlopeRule::Natural, end, step), slopes(6, SlopeRule::Hyman, end, step));
            let secant = |k: usize| (step(Z[k + 1]) - step(Z[k])) / (Z[k + 1] - Z[k]);
            for k in 0..6usize {
                let (below, above) = (secant(k.saturating_sub(1)), secant(k.min(4)));
                near(tame[k], limited(free[k], below, above));
            }
            assert!(free.iter().zip(&tame).any(|(a, b)| (a - b).abs() > 0.1));
        }
        let wave = slopes(6, SlopeRule::Hyman, SplineEnd::Natural, |z| if z == 3.0 { 5.0 } else { 0.0 });
        near(wave[2], 0.0);
    }
}
