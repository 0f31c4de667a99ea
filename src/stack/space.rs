//! Which world coordinates are of.

use serde::{Deserialize, Serialize};

/// The space that world coordinates are of, by NIfTI's codes; other formats do not tell it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum WorldSpace {
    /// The scanner's.
    #[default]
    Scanner,
    /// That of another file.
    Aligned,
    /// The atlas of Talairach and Tournoux.
    Talairach,
    /// The template MNI 152.
    Mni152,
    /// Another template's.
    Template,
}

impl WorldSpace {
    /// All of them.
    const ALL: [WorldSpace; 5] =
        [WorldSpace::Scanner, WorldSpace::Aligned, WorldSpace::Talairach, WorldSpace::Mni152, WorldSpace::Template];

    /// The space of a code, the scanner's where it is of none.
    pub fn of_code(code: i32) -> Self {
        Self::ALL.into_iter().find(|space| i32::from(space.code()) == code).unwrap_or_default()
    }

    /// Whether it is the scanner's.
    pub(super) fn is_scanner(&self) -> bool {
        *self == WorldSpace::Scanner
    }

    /// Its code.
    pub fn code(self) -> i16 {
        self as i16 + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_come_back() {
        assert!((1..=5).all(|code| i32::from(WorldSpace::of_code(code).code()) == code));
        assert!([i32::MIN, -1, 0, 6, 300].iter().all(|code| WorldSpace::of_code(*code) == WorldSpace::Scanner));
    }
}
