//! Labels that face each other: one ends on a slice where the other begins on the next.
//!
//! Their border lies between the slices, so that they touch on none. Alone both would end flat and leave a gap right through what is solid. They are taken
//! for neighbours where half of either contour at least lies on such labels of the other slice, and the gap is no wider than gaps within them. What
//! merely passes below a corner of another ends by itself, and so does what ends before slices without any paint.

use std::collections::BTreeMap;

use super::stack::{LabelPair, LabelStack};

/// Share of a contour, by area, that has to lie on a label of the other slice to face it.
const SHARE: f64 = 0.5;

/// Gaps up to so many times as wide as the widest within one of both labels are not wider.
const WIDER: f64 = 1.5;

/// Two labels that face each other, by their places.
#[derive(Debug, Clone, Copy)]
pub(super) struct Facing {
    /// The slice on which the lower one ends, and that on which the upper one begins.
    pub slices: [usize; 2],
    /// The lower one and the upper one.
    pub labels: [usize; 2],
}

impl Facing {
    /// Both, the smaller place first.
    pub fn pair(&self) -> LabelPair {
        let [a, b] = self.labels;
        (a.min(b), a.max(b))
    }
}

/// All labels that face each other, of those that are `painted` on each slice.
pub(super) fn facing(stack: &LabelStack, painted: &[Vec<bool>]) -> Vec<Facing> {
    let z = |k: usize| stack.stack.slices[k].z;
    let widest = widest(stack, painted);
    let [ends, begins] = [true, false].map(|up| stops(stack, painted, up));
    let mut candidates: BTreeMap<[usize; 2], Vec<[usize; 2]>> = BTreeMap::new();
    for (low, ends) in ends.iter().enumerate() {
        for &Stop { label: a, towards } in ends {
            for (high, begins) in begins.iter().enumerate().take(towards + 1).skip(low + 1) {
                let near = |b: usize| z(high) - z(low) <= WIDER * widest[a].max(widest[b]);
                let from = begins.iter().filter(|begin| begin.towards <= low && near(begin.label));
                from.for_each(|begin| candidates.entry([low, high]).or_default().push([a, begin.label]));
            }
        }
    }
    let of = |(slices, pairs): ([usize; 2], Vec<[usize; 2]>)| {
        let large = large_faces(slices.map(|k| &stack.drawn[k][..]), &pairs);
        large.into_iter().map(move |labels| Facing { slices, labels })
    };
    candidates.into_iter().flat_map(of).collect()
}

/// For each label the widest gap between slices that follow each other in it on both of which it is painted, else the middle one of the stack's.
fn widest(stack: &LabelStack, painted: &[Vec<bool>]) -> Vec<f64> {
    let gap = |pair: &[usize]| stack.stack.slices[pair[1]].z - stack.stack.slices[pair[0]].z;
    let mut gaps: Vec<f64> = (1..stack.drawn.len()).map(|k| gap(&[k - 1, k])).collect();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps.get(gaps.len() / 2).copied().unwrap_or(0.0);
    let of = |a: usize| {
        let both = stack.given[a].slices.windows(2).filter(|pair| pair.iter().all(|&k| painted[k][a]));
        both.map(gap).reduce(f64::max).unwrap_or(usual)
    };
    (0..stack.labels.len()).map(of).collect()
}

/// A label that ends on a slice, or begins there.
struct Stop {
    label: usize,
    /// The farthest slice up to which nothing more is known of it: the next on which it is known not to be, else the last of the stack; for one that begins
    /// the one before, else the first.
    towards: usize,
}

/// For each slice the labels that end there, going `up`, or begin there.
fn stops(stack: &LabelStack, painted: &[Vec<bool>], up: bool) -> Vec<Vec<Stop>> {
    let mut stops: Vec<Vec<Stop>> = painted.iter().map(|_| Vec::new()).collect();
    for (label, given) in stack.given.iter().enumerate() {
        let mut known: Vec<usize> = given.slices.iter().chain(&given.shut).copied().collect();
        known.sort_unstable();
        if !up {
            known.reverse();
        }
        let outermost = if up { painted.len().saturating_sub(1) } else { 0 };
        let next = known.iter().skip(1).map(|k| Some(*k)).chain([None]);
        for (&on, next) in known.iter().zip(next) {
            if painted[on][label] && next.is_none_or(|next| !painted[next][label]) {
                stops[on].push(Stop { label, towards: next.unwrap_or(outermost) });
            }
        }
    }
    stops
}

/// Those of some pairs of labels that end on the first of two slices and begin on the second of which either is covered enough by such labels.
fn large_faces(slices: [&[u32]; 2], pairs: &[[usize; 2]]) -> Vec<[usize; 2]> {
    let mut shared: BTreeMap<[usize; 2], u64> = pairs.iter().map(|pair| (*pair, 0)).collect();
    let mut areas =
        [0, 1].map(|side: usize| pairs.iter().map(|pair| (pair[side], 0)).collect::<BTreeMap<usize, u64>>());
    let mut covered = areas.clone();
    for (&low, &high) in slices[0].iter().zip(slices[1]) {
        let labels = [low, high].map(|l| (l as usize).wrapping_sub(1));
        for (areas, label) in areas.iter_mut().zip(&labels) {
            areas.entry(*label).and_modify(|area| *area += 1);
        }
        shared.entry(labels).and_modify(|pixels| *pixels += 1);
    }
    for (pair, pixels) in &shared {
        covered.iter_mut().zip(pair).for_each(|(covered, label)| *covered.entry(*label).or_default() += pixels);
    }
    let enough = |side: usize, a: usize| covered[side][&a] as f64 >= SHARE * areas[side][&a] as f64;
    let touch = shared.into_iter().filter(|(_, pixels)| *pixels > 0).map(|(pair, _)| pair);
    touch.filter(|[a, b]| enough(0, *a) && enough(1, *b)).collect()
}
