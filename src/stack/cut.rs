//! Where grey values are cut, and which side of that is inside.

use crate::error::{Error, Result};

/// A level, and the side of it that is inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The level.
    pub level: f64,
    /// Inside is what lies below it, not above.
    pub below: bool,
}

impl Cut {
    /// Depth of a value, negative inside: `level - value`, the other way round where what lies below is inside. Nothing at the level is inside.
    pub fn depth(self, value: f64) -> f32 {
        let depth = self.level - value;
        (if self.below { -depth } else { depth }) as f32
    }

    /// The side that is inside, in words.
    pub fn side(self) -> &'static str {
        if self.below { "below" } else { "above" }
    }

    /// Checks that values from `low` to `high`, of `what`, lie on both sides.
    ///
    /// # Errors
    /// [`Error::Setting`] for the level.
    pub fn check(self, [low, high]: [f64; 2], what: &str) -> Result<()> {
        let Cut { level, below } = self;
        let (parts, range) = match below {
            false => (level >= low && level < high, format!("[{low}, {high})")),
            true => (level > low && level <= high, format!("({low}, {high}]")),
        };
        if level.is_finite() && parts {
            return Ok(());
        }
        let message = format!("must lie in {range}, the range of {what}; got {level}");
        Err(Error::Setting { name: "level".into(), message })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_side_of_a_level_is_inside_and_values_lie_on_both() {
        for (below, inside, good) in [(false, 6.0, [0.0, 9.9]), (true, 4.0, [0.1, 10.0])] {
            let cut = |level: f64| Cut { level, below };
            assert!(
                cut(5.0).depth(inside) == -1.0 && cut(5.0).depth(10.0 - inside) == 1.0 && cut(5.0).depth(5.0) == 0.0
            );
            let check = |level: f64| cut(level).check([0.0, 10.0], "values");
            assert!(good.into_iter().all(|level| check(level).is_ok()), "{below}");
            let bad = if below { 0.0 } else { 10.0 };
            for level in [bad, -1.0, 11.0, f64::NAN, f64::INFINITY] {
                assert!(check(level).is_err(), "{below}: {level}");
            }
        }
    }
}
