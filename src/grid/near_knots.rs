//! Slopes where slices lie far nearer to each other than to the next: what their contours do from one to the other is lost in the pixels.
//!
//! Contours drawn in pixels are right to a fraction of a pixel. Over a gap of half a pixel that is a slope of one, and over the wide gap beside it a
//! bulge of many pixels. So a narrow gap's way is weighed against what the gaps around it say: of the `by` px by which it differs there is
//! `by^3 / (by^2 + doubt^2)` left (a Wiener filter, of noise `doubt` and what is seen). There is no doubt where the gap beside is up to [`UNLIKE`] times as
//! wide, the noise of contours where it is [`WHOLLY`] times as wide, and from there on as the root of that grows: the bulge that noise would make grows with
//! it, and what a smooth body moves by in the narrow gap shrinks.

use super::spline::{HermiteArc, hermite, slope};
use crate::settings::{SlopeRule, SplineEnd};

/// Gaps are unlike where one is more than so many times the other.
pub const UNLIKE: f64 = 4.0;
/// Where one is so many times the other all that the narrow one says is doubted.
pub const WHOLLY: f64 = 2.0 * UNLIKE;

/// Share to which a gap is narrow beside another one.
#[inline(always)]
pub fn narrow(gap: f64, beside: f64) -> f64 {
    ((beside / gap - UNLIKE) / (WHOLLY - UNLIKE)).clamp(0.0, 1.0)
}

/// Times the noise of contours by which a gap is doubted beside another one.
#[inline(always)]
fn doubted(gap: f64, beside: f64) -> f64 {
    narrow(gap, beside) * (beside / (WHOLLY * gap)).max(1.0).sqrt()
}

/// What is left of a difference of `by` px that may be noise of `doubt` px.
#[inline(always)]
fn believed(by: f64, doubt: f64) -> f64 {
    let (seen, noise) = (by * by, doubt * doubt);
    if noise > 0.0 { by * (seen / (seen + noise)) } else { by }
}

/// A gap beside a slice: its secant, px per unit of its height, and that.
pub type Gap = [f64; 2];

/// The gaps beside a slice, below and above, `farther` those on the other side of these (0 high: there is none), with the narrower one seen together
/// with what is beyond it, as far as it is doubted.
#[inline(always)]
pub fn settled(beside: [Gap; 2], farther: [Gap; 2], doubt: f64) -> [Gap; 2] {
    let [below, above] = beside;
    [seen_with(below, farther[0], above, doubt), seen_with(above, farther[1], below, doubt)]
}

/// The gap `own`, where it is narrow beside `other`: see [`settled`].
#[inline(always)]
fn seen_with([d, h]: Gap, [beyond, width]: Gap, [other, wide]: Gap, doubt: f64) -> Gap {
    let share = narrow(h, wide);
    if share <= 0.0 {
        return [d, h];
    }
    // The way across both; what both are too narrow for the gap on the other side says.
    let both = h + width;
    let way = (d * h + beyond * width) - other * both;
    let across = other + believed(way, doubt * doubted(both, wide)) / both;
    let by = (d - across) * h;
    let left = believed(by, doubt * doubted(h, wide));
    let kept = if by != 0.0 { left / by } else { 1.0 - share };
    [across + left / h, kept * h + (1.0 - kept) * both]
}

/// The slope of [`slope`] at knot `center`, s in px, where knots that are far nearer than the wider gap beside it are doubted: they are drawn to the
/// curve through the others.
pub fn settled_slope(z: &[f64], s: &[f64], center: usize, rule: SlopeRule, end: SplineEnd, doubt: f64) -> f64 {
    let gap = |k: usize| z[k + 1] - z[k];
    let beside = [center.checked_sub(1), (center + 1 < z.len()).then_some(center)];
    let wider = beside.into_iter().flatten().map(gap).fold(0.0, f64::max);
    let far = |a: usize, b: usize| UNLIKE * (z[a] - z[b]).abs() >= wider;
    if (1..z.len()).all(|k| far(k, k - 1)) {
        return slope(z, s, center, rule, end);
    }
    let mut kept = vec![center];
    for k in (0..center).rev() {
        if far(kept[kept.len() - 1], k) {
            kept.push(k);
        }
    }
    kept.reverse();
    for k in center + 1..z.len() {
        if far(kept[kept.len() - 1], k) {
            kept.push(k);
        }
    }
    let some_z: Vec<f64> = kept.iter().map(|k| z[*k]).collect();
    let some_s: Vec<f64> = kept.iter().map(|k| s[*k]).collect();
    let slopes: Vec<f64> = (0..kept.len()).map(|k| slope(&some_z, &some_s, k, rule, end)).collect();
    let line = |k: usize, z: f64| some_s[k] + slopes[k] * (z - some_z[k]);
    let mut drawn = s.to_vec();
    for k in (0..z.len()).filter(|k| kept.binary_search(k).is_err()) {
        let above = kept.partition_point(|kept| *kept < k);
        let (on, nearest) = if above == 0 {
            (line(0, z[k]), some_z[0] - z[k])
        } else if above == kept.len() {
            (line(above - 1, z[k]), z[k] - some_z[above - 1])
        } else {
            let (gap, way) = (some_z[above] - some_z[above - 1], z[k] - some_z[above - 1]);
            let arc: HermiteArc =
                [some_s[above] - some_s[above - 1], gap * slopes[above - 1], gap * slopes[above], 1.0];
            (some_s[above - 1] + hermite(&arc, way / gap), way.min(gap - way))
        };
        drawn[k] = on + believed(s[k] - on, doubt * doubted(nearest, wider));
    }
    slope(z, &drawn, center, rule, end)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOUBT: f64 = 0.35;
    const NONE: Gap = [0.0; 2];

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-9, "{a}, not {b}");
    }

    #[test]
    fn gaps_that_are_alike_or_not_doubted_stay_as_they_are() {
        let beyond = [[7.0, 2.0], [-3.0, 5.0]];
        for beside in [[[1.0, 2.0], [-4.0, 8.0]], [[1.0, 8.0], [0.5, 2.0]], [[0.3, 1.0], [0.2, 1.0]]] {
            assert_eq!(settled(beside, beyond, DOUBT), beside);
        }
        let unlike = [[1.0, 0.5], [-0.4, 10.0]];
        assert_eq!(settled(unlike, beyond, 0.0), unlike);
    }

    #[test]
    fn noise_in_a_narrow_gap_is_seen_with_what_lies_beyond_it_and_a_step_stays() {
        // A parabola -z^2 / 40: from -9.5 to -0.5, and from 0 to 10. A tenth of a pixel in half a pixel.
        let of = |noise: f64| settled([[noise / 0.5, 0.5], [-0.25, 10.0]], [[0.25, 9.0], NONE], DOUBT)[0];
        let [secant, gap] = of(0.1);
        assert!((secant - 0.25).abs() < 0.05 && gap > 8.5, "{secant} over {gap}");
        // What the narrow gap says grows with it, without a jump, and a step of 5 px is one.
        let found: Vec<f64> = (0..=500).map(|k| of(f64::from(k) / 100.0)[0]).collect();
        assert!(found.windows(2).all(|w| w[1] > w[0] && w[1] - w[0] < 0.05), "{found:?}");
        assert!((found[500] - 10.0).abs() < 0.2 && of(5.0)[1] < 0.7, "{}", found[500]);
        // Nothing beyond it: the gap on the other side.
        near(settled([[-0.25, 0.5], [-0.25, 10.0]], [NONE; 2], DOUBT)[0][0], -0.25);
        assert!((settled([[0.2, 0.5], [-0.25, 10.0]], [NONE; 2], DOUBT)[0][0] + 0.25).abs() < 0.2);
    }

    #[test]
    fn upside_down_and_in_other_units_it_is_the_same() {
        let (a, b, c, d) = ([0.7, 0.5], [-0.25, 6.0], [0.3, 4.0], [-0.5, 8.0]);
        let [below, above] = settled([a, b], [c, d], DOUBT);
        let turned = |[secant, gap]: Gap| [-secant, gap];
        let down = settled([turned(b), turned(a)], [turned(d), turned(c)], DOUBT);
        assert_eq!(down, [turned(above), turned(below)]);
        let long = |[secant, gap]: Gap| [secant / 8.0, gap * 8.0];
        assert_eq!(settled([long(a), long(b)], [long(c), long(d)], DOUBT), [long(below), long(above)]);
    }

    #[test]
    fn a_line_keeps_its_slope_and_noise_at_near_knots_does_not_reach_the_slope() {
        let z = [0.0, 0.5, 1.0, 20.0, 21.0, 40.0, 40.2, 50.0];
        let line: Vec<f64> = z.iter().map(|z| 3.0 - 0.4 * z).collect();
        let noisy: Vec<f64> =
            line.iter().zip([0.2, -0.1, 0.2, -0.2, 0.1, 0.1, -0.2, 0.1]).map(|(s, n)| s + n).collect();
        for rule in [SlopeRule::Natural, SlopeRule::Hyman, SlopeRule::Pchip, SlopeRule::Catmull] {
            let of = |s: &[f64], k: usize, doubt: f64| settled_slope(&z, s, k, rule, SplineEnd::Parabolic, doubt);
            for k in 0..z.len() {
                near(of(&line, k, DOUBT), -0.4);
                assert_eq!(of(&noisy, k, 0.0), slope(&z, &noisy, k, rule, SplineEnd::Parabolic));
            }
            // Those that a wide gap lies beside.
            let worst = |doubt: f64| (2..7).map(|k| (of(&noisy, k, doubt) + 0.4).abs()).fold(0.0, f64::max);
            assert!(worst(DOUBT) < 0.2 && worst(0.0) > 0.35, "{rule:?}: {} for {}", worst(DOUBT), worst(0.0));
        }
    }
}
