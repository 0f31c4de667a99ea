//! The lengths that a stack may have: sides of its pixels, and steps between heights.

/// Least and largest of them, in the unit. Distances are kept, and meshes written, in single precision, whose normal numbers lie between 1.2e-38 and
/// 3.4e38: the square of a thousandth of the least and of ten thousand times the largest are among them, and so is what is made of them.
const RANGE: [f64; 2] = [1e-15, 1e15];

/// What is wrong with a length, after its name.
///
/// # Errors
/// That it is not positive or no number, or that it lies beyond the range.
pub(crate) fn check_length(length: f64) -> Result<(), String> {
    let [least, most] = RANGE;
    match length {
        h if !(h.is_finite() && h > 0.0) => Err(format!("must be a positive number; got {h}")),
        h if !(least..=most).contains(&h) => {
            Err(format!("must lie between {least:e} and {most:e}; got {h:e}; give all lengths in another unit"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_positive_and_single_precision_holds_its_square() {
        for good in [1e-15, 0.3, 1.0, 1e15] {
            assert_eq!(check_length(good), Ok(()));
            let [least, most] = [1e-3 * good, 1e4 * good].map(|length| (length * length) as f32);
            assert!(least.is_normal() && most.is_normal(), "{good}");
        }
        for (wrong, words) in [
            (0.0, "must be a positive number; got 0"),
            (-1.0, "must be a positive number; got -1"),
            (f64::NAN, "must be a positive number; got NaN"),
            (f64::INFINITY, "must be a positive number; got inf"),
            (1e-200, "must lie between 1e-15 and 1e15; got 1e-200; give all lengths in another unit"),
            (1e300, "must lie between 1e-15 and 1e15; got 1e300; give all lengths in another unit"),
        ] {
            assert_eq!(check_length(wrong), Err(words.into()));
        }
    }
}
