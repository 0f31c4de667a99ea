//! Many warnings of one kind as one.

use std::collections::BTreeMap;

/// Warnings of a kind that are told one by one; of more their number and the first few are.
const ONE_BY_ONE: usize = 6;
/// The first ones that are told of many.
const FIRST: usize = 3;

/// Warnings in their order; where more than [`ONE_BY_ONE`] differ only in numbers and names in backticks, one line in the place of the first: their
/// number, and the first [`FIRST`] of them.
pub(crate) fn gathered(warnings: Vec<String>) -> Vec<String> {
    let (mut known, mut kinds) = (BTreeMap::new(), Vec::<Vec<String>>::new());
    for warning in warnings {
        let at = *known.entry(kind(&warning)).or_insert(kinds.len());
        if at == kinds.len() {
            kinds.push(Vec::new());
        }
        kinds[at].push(warning);
    }
    let told = |all: Vec<String>| match all.len() {
        0..=ONE_BY_ONE => all,
        n => vec![format!("{n} times: {}; and {} more", all[..FIRST].join("; "), n - FIRST)],
    };
    kinds.into_iter().flat_map(told).collect()
}

/// The words of a warning without names, numbers and what belongs to these (1.5e-9).
fn kind(warning: &str) -> String {
    let words = warning.split('`').step_by(2);
    words.flat_map(|words| words.split(|c: char| c.is_ascii_digit() || ".-e".contains(c))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_of_a_kind_are_one_line_with_the_first_places() {
        let vanished =
            |n: usize| format!("the upward sweep of a group between heights {n} and {}.5 vanished at t = 0.{n}", n + 1);
        let linked = |n: usize| format!("part {n} of `slice {n} e.png` and part 1 of `b` are linked");
        let mut all = vec!["one".to_string()];
        all.extend((0..ONE_BY_ONE).map(linked));
        all.extend((0..3000).map(vanished));
        let told = gathered(all.clone());
        assert_eq!(told[..=ONE_BY_ONE], all[..=ONE_BY_ONE]);
        let [line] = &told[ONE_BY_ONE + 1..] else { panic!("{told:?}") };
        let first = [0, 1, 2].map(vanished).join("; ");
        assert_eq!(*line, format!("3000 times: {first}; and 2997 more"));
        assert_eq!(gathered(told.clone()), told, "told again it stays");
    }
}
