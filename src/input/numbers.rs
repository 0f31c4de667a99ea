//! Exactly so many numbers in JSON: of more serde_json says nothing but that characters trail.

use std::fmt;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// `N` numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers<const N: usize>(pub [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(Sequence)
    }
}

struct Sequence<const N: usize>;

impl<'de, const N: usize> Visitor<'de> for Sequence<N> {
    type Value = Numbers<N>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{N} numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<Numbers<N>, A::Error> {
        let wrong = |count| A::Error::invalid_length(count, &self);
        let mut numbers = [0.0; N];
        for (count, number) in numbers.iter_mut().enumerate() {
            *number = sequence.next_element()?.ok_or_else(|| wrong(count))?;
        }
        let mut count = N;
        while sequence.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        if count == N { Ok(Numbers(numbers)) } else { Err(wrong(count)) }
    }
}
