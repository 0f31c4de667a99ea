//! Slices by whose contours a body ends.
//!
//! A law through the areas of contours that lie close together tells more of their noise than of the body: over a height T beyond contours g and h
//! inward, an area that is off by d counts for d T^2 / (g h). The nearest is nearest to the end, too: it is passed over only where it lies within a twelfth
//! of the usual gap, and the next lies a quarter of it farther in.

/// Contours that have a say in how the body ends: three, and a fourth that tells where the fall of the areas begins.
const SAY: usize = 4;
/// Those by which the height of an end is measured, and without which slices that lie close together have a say as well.
const MEASURED: usize = 3;
/// Slices, from the end inward, among which they are.
pub const LOOKED_AT: usize = 9;
/// Gaps, from the end inward, of which the widest is the usual one there, unless the stack's middle gap is narrower.
const AROUND: usize = 4;
/// Least distances of the second from the first, of the third from the second and of the fourth from the third, usual gaps.
const APART: [f64; SAY - 1] = [1.0 / 12.0, 0.25, 0.25];
/// Least gap that the height of an end is measured by, usual gaps.
const LEAST: f64 = 0.5;

/// The usual gap at the end of slices at heights `z`, from the end inward, of a stack with this [middle gap](crate::stack::heights::middle_gap).
fn usual(z: &[f64], middle: f64) -> f64 {
    z.windows(2).take(AROUND).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max).min(middle)
}

/// Those of the slices at heights `z`, from the end inward, that have a say, the outermost first; where there are fewer than three so far apart, the
/// outermost three. `middle` is the middle gap of the whole stack.
pub fn ending(z: &[f64], middle: f64) -> Vec<usize> {
    let z = &z[..z.len().min(LOOKED_AT)];
    let usual = usual(z, middle);
    let mut some: Vec<usize> = Vec::new();
    for (k, here) in z.iter().enumerate() {
        let is_apart = |last: &usize| (here - z[*last]).abs() >= usual * APART[some.len() - 1];
        if some.len() < SAY && some.last().is_none_or(is_apart) {
            some.push(k);
        }
    }
    if some.len() < MEASURED { (0..z.len().min(MEASURED)).collect() } else { some }
}

/// The gap by which the height of an end is measured: the wider of the first two between slices that have a say, and half of the usual one at least.
pub fn gap_of_ending(z: &[f64], middle: f64) -> f64 {
    let some = ending(z, middle);
    let pairs = some[..some.len().min(MEASURED)].windows(2);
    let apart = pairs.map(|pair| (z[pair[1]] - z[pair[0]]).abs()).fold(0.0, f64::max);
    apart.max(LEAST * usual(z, middle))
}

/// The gap to where the next slice would lie, beyond those at heights `z`, from the end inward: a usual one, counted from the innermost that lies nearer
/// to the end than that, since lines between the levels of a map (30, 60, 61, 90, 91) are drawn beside a level and make no new one; at least the last gap.
pub fn gap_to_next(z: &[f64], middle: f64) -> f64 {
    let usual = usual(z, middle);
    let away = |other: &f64| (other - z[0]).abs();
    let between = z.iter().map(away).take_while(|away| *away < usual).last().unwrap_or(0.0);
    z.get(1).map_or(0.0, away).max(usual - between)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_between_levels_make_no_nearer_next_level() {
        for (z, middle, wanted) in [
            (&[][..], 0.0, 0.0),
            (&[3.0], 0.0, 0.0),
            (&[40.0, 30.0, 20.0, 10.0], 10.0, 10.0),
            // The next level is 120, or 60 or 80.
            (&[91.0, 90.0, 61.0, 60.0, 30.0], 30.0, 29.0),
            (&[90.0, 61.0, 60.0, 30.0], 30.0, 29.0),
            (&[50.0, 40.0, 20.0, 0.0], 20.0, 10.0),
            (&[75.0, 70.0, 65.0, 60.0, 40.0], 20.0, 5.0),
            (&[41.0, 40.5, 40.0, 30.0, 20.0], 10.0, 9.0),
            // Drawn more closely towards the end, or an end in which levels are missing.
            (&[4.0, 3.0, 2.0, 1.0, 0.0, -20.0], 20.0, 1.0),
            (&[90.0, 70.0, 68.0, 66.0], 2.0, 20.0),
        ] {
            assert_eq!(gap_to_next(z, middle), wanted, "{z:?}");
            let upside_down: Vec<f64> = z.iter().map(|z| -z).collect();
            assert_eq!(gap_to_next(&upside_down, middle), wanted, "{z:?}");
        }
        // Even gaps stay as they are, however they are rounded.
        let even: Vec<f64> = (0..9).rev().map(|k| 0.1 * f64::from(k)).collect();
        assert_eq!(gap_to_next(&even, 0.1), even[0] - even[1]);
    }

    #[test]
    fn slices_close_together_have_one_say() {
        for (z, middle, wanted) in [
            (&[][..], 0.0, &[][..]),
            (&[3.0, 1.0], 2.0, &[0, 1]),
            (&[0.0, 1.0, 2.0, 3.0, 4.0], 1.0, &[0, 1, 2, 3]),
            (&[0.0, 1.0, 2.0], 1.0, &[0, 1, 2]),
            // Gaps of up to 1 : 4 are as they were.
            (&[0.0, 1.0, 2.0, 6.0, 10.0], 4.0, &[0, 1, 2, 3]),
            (&[41.0, 40.5, 40.0, 30.0, 20.0], 10.0, &[0, 2, 3, 4]),
            (&[40.5, 40.25, 40.0, 30.0, 20.0], 10.0, &[0, 3, 4]),
            (&[41.0, 40.0, 30.0, 29.9, 20.0], 10.0, &[0, 1, 2, 4]),
            (&[41.0, 40.0, 39.0, 30.0, 20.0], 10.0, &[0, 1, 3, 4]),
            // Drawn more closely towards the end, or an end in which slices are missing.
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 24.0, 44.0], 20.0, &[0, 1, 2, 3]),
            (&[0.0, 20.0, 22.0, 24.0], 2.0, &[0, 1, 2, 3]),
            // Too few so far apart.
            (&[20.5, 20.0, 0.0], 20.0, &[0, 1, 2]),
        ] {
            assert_eq!(ending(z, middle), wanted, "{z:?}");
            let upside_down: Vec<f64> = z.iter().map(|z| -z).collect();
            assert_eq!(ending(&upside_down, middle), wanted, "{z:?}");
        }
        assert_eq!(gap_of_ending(&[41.0, 40.5, 40.0, 30.0, 20.0], 10.0), 10.0);
        assert_eq!(gap_of_ending(&[8.0, 6.0, 4.0, -2.0, -8.0], 6.0), 3.0);
        assert_eq!([gap_of_ending(&[41.0, 40.5], 0.5), gap_of_ending(&[41.0], 0.0)], [0.5, 0.0]);
    }
}
