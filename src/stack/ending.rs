//! Slices by whose contours a body ends.
//!
//! A law through the areas of contours that lie close together tells more of their noise than of the body: over a height T beyond contours g and h
//! inward, an area that is off by d counts for d T^2 / (g h). So each lies at least a quarter of the usual gap farther in than the one before.

/// Contours that have a say in how the body ends.
pub const SAY: usize = 3;
/// Slices, from the end inward, among which they are.
pub const LOOKED_AT: usize = 9;
/// Gaps, from the end inward, of which the widest is the usual one there, unless the stack's middle gap is narrower.
const AROUND: usize = 4;
/// Least distance between them, usual gaps.
const APART: f64 = 0.25;

/// Those of the slices at heights `z`, from the end inward, that have a say, the outermost first; where there are fewer than three so far apart, the
/// outermost three. `middle` is the [middle gap](crate::stack::heights::middle_gap) of the whole stack.
pub fn ending(z: &[f64], middle: f64) -> Vec<usize> {
    let z = &z[..z.len().min(LOOKED_AT)];
    let widest = z.windows(2).take(AROUND).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    let apart = APART * widest.min(middle);
    let mut some: Vec<usize> = Vec::new();
    for (k, here) in z.iter().enumerate() {
        if some.len() < SAY && some.last().is_none_or(|&last| (here - z[last]).abs() >= apart) {
            some.push(k);
        }
    }
    if some.len() < SAY { (0..z.len().min(SAY)).collect() } else { some }
}

/// The two gaps between slices that have a say, the outermost first; 0 where there are fewer.
pub fn gaps_of_ending(z: &[f64], middle: f64) -> [f64; 2] {
    let some = ending(z, middle);
    [0, 1].map(|k| some.get(k + 1).map_or(0.0, |&next| (z[next] - z[some[k]]).abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_close_together_have_one_say() {
        for (z, middle, wanted) in [
            (&[][..], 0.0, &[][..]),
            (&[3.0, 1.0], 2.0, &[0, 1]),
            (&[0.0, 1.0, 2.0, 3.0], 1.0, &[0, 1, 2]),
            // Gaps of up to 1 : 4 are as they were.
            (&[0.0, 1.0, 2.0, 6.0, 10.0], 4.0, &[0, 1, 2]),
            (&[41.0, 40.5, 40.0, 30.0, 20.0], 10.0, &[0, 3, 4]),
            (&[41.0, 40.0, 30.0, 29.9, 20.0], 10.0, &[0, 2, 4]),
            // Drawn more closely towards the end, or an end in which slices are missing.
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 24.0, 44.0], 20.0, &[0, 1, 2]),
            (&[0.0, 20.0, 22.0, 24.0], 2.0, &[0, 1, 2]),
            // Too few so far apart.
            (&[20.5, 20.0, 0.0], 20.0, &[0, 1, 2]),
        ] {
            assert_eq!(ending(z, middle), wanted, "{z:?}");
            let upside_down: Vec<f64> = z.iter().map(|z| -z).collect();
            assert_eq!(ending(&upside_down, middle), wanted, "{z:?}");
        }
        assert_eq!(gaps_of_ending(&[41.0, 40.5, 40.0, 30.0, 20.0], 10.0), [11.0, 10.0]);
        assert_eq!(gaps_of_ending(&[41.0, 40.5], 0.5), [0.5, 0.0]);
    }
}
