//! Words about intervals that nothing of the body crosses.

/// Intervals that are named; of more their number is told.
const NAMED: usize = 3;

/// An interval that nothing crosses, though both its contours have parts.
pub(crate) struct Apart<'s> {
    /// Names of its slices.
    pub slices: [&'s str; 2],
    /// Whether no part of one slice was found to go on as one of the other; else it does, but no layer lies over the next.
    pub unmatched: bool,
}

/// What a person should know of them, each kind with what mends it.
pub(crate) fn words(apart: &[Apart<'_>]) -> Vec<String> {
    let of = |unmatched: bool, why: &str, mends: &str| {
        let some: Vec<_> = apart.iter().filter(|gap| gap.unmatched == unmatched).collect();
        let named: Vec<String> =
            some.iter().take(NAMED).map(|gap| format!("`{}` and `{}`", gap.slices[0], gap.slices[1])).collect();
        let more = some.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(", and in {more} more") } else { String::new() };
        (!some.is_empty())
            .then(|| format!("the body is in pieces between {}{more}: {why}: {mends}", named.join(", between ")))
    };
    let unmatched = of(
        true,
        "no part of one slice goes on as one of the next",
        "are slices missing or moved? `--link auto` follows parts that look alike, `--links` those that are named; `interslice inspect` tells which could be",
    );
    let thin = of(
        false,
        "what goes on from slice to slice is too thin there to hang together, or moves by more than its width from layer to layer",
        "finer pixels or a finer `--dz` follow it",
    );
    unmatched.into_iter().chain(thin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_told_once_with_what_mends_it() {
        let gap = |slices, unmatched| Apart { slices, unmatched };
        assert!(words(&[]).is_empty());
        let all: Vec<Apart<'_>> = [["a", "b"], ["b", "c"], ["c", "d"], ["d", "e"], ["e", "f"]]
            .into_iter()
            .map(|slices| gap(slices, slices[0] != "c"))
            .collect();
        let told = words(&all);
        let [unmatched, thin] = &told[..] else { panic!("{told:?}") };
        let places = "in pieces between `a` and `b`, between `b` and `c`, between `d` and `e`, and in 1 more: no part";
        assert!(
            unmatched.contains(places) && unmatched.contains("--link auto") && !unmatched.contains("--dz"),
            "{told:?}"
        );
        assert!(
            thin.contains("between `c` and `d`: what goes on") && thin.contains("--dz") && !thin.contains("--link")
        );
    }
}
