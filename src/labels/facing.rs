//! Labels that face each other: one ends on a slice where the other begins on the next.
//!
//! Their border lies between the slices, so that they touch on none. Alone both would end flat and leave a gap right through what is solid. Two that lie on
//! each other by half of the larger contour at least are taken for neighbours; what merely passes below a corner of another ends by itself.

use std::collections::BTreeMap;

use super::stack::{LabelPair, LabelStack};

/// Part of the larger of both contours, by area, that has to lie on the other.
const SHARE: f64 = 0.5;

/// The pairs that face each other, and the slices between which they do.
pub(super) fn facing(stack: &LabelStack, painted: &[Vec<bool>]) -> BTreeMap<LabelPair, Vec<usize>> {
    let mut found: BTreeMap<LabelPair, Vec<usize>> = BTreeMap::new();
    for (k, slices) in stack.drawn.windows(2).enumerate() {
        let ends = |a: usize, on: usize, off: usize| {
            painted[on][a] && !painted[off][a] && stack.given[a].settles(on) && stack.given[a].settles(off)
        };
        let all = 0..stack.labels.len();
        if !all.clone().any(|a| ends(a, k, k + 1)) || !all.clone().any(|a| ends(a, k + 1, k)) {
            continue;
        }
        let of = |l: u32| (l as usize).checked_sub(1);
        let (mut areas, mut on_each_other) = ([0, 1].map(|_| vec![0u64; all.len()]), BTreeMap::new());
        for (&low, &high) in slices[0].iter().zip(&slices[1]) {
            let pair = [of(low), of(high)];
            areas.iter_mut().zip(pair).for_each(|(areas, a)| a.into_iter().for_each(|a| areas[a] += 1));
            if let [Some(a), Some(b)] = pair {
                *on_each_other.entry((a, b)).or_insert(0u64) += 1;
            }
        }
        for ((a, b), shared) in on_each_other {
            let larger = areas[0][a].max(areas[1][b]);
            if ends(a, k, k + 1) && ends(b, k + 1, k) && shared as f64 >= SHARE * larger as f64 {
                found.entry((a.min(b), a.max(b))).or_default().extend([k, k + 1]);
            }
        }
    }
    found
}
