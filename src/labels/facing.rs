//! Labels that face each other: one ends on a slice where the other begins on the next.
//!
//! Their border lies between the slices, so that they touch on none. Alone both would end flat and leave a gap right through what is solid. They are taken
//! for neighbours where half of either contour at least lies on such labels of the other slice, and the gap is no wider than gaps within them. What
//! merely passes below a corner of another ends by itself, and so does what ends before slices without any paint.

use std::collections::BTreeMap;

use super::stack::{LabelPair, LabelStack};

/// Part of a contour, by area, that has to lie on others.
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

/// All labels that face each other, of those that are `painted` on each slice.
pub(super) fn facing(stack: &LabelStack, painted: &[Vec<bool>]) -> Vec<Facing> {
    let count = stack.labels.len();
    let widest = widest(stack, painted);
    let most = widest.iter().copied().fold(0.0, f64::max);
    let height = |[low, high]: [usize; 2]| stack.stack.slices[high].z - stack.stack.slices[low].z;
    // Whether a label is painted on one of two slices and not known to be anywhere between them, nor on the other.
    let stops = |a: usize, on: usize, off: usize| {
        let between = on.min(off) + 1..on.max(off);
        painted[on][a]
            && !painted[off][a]
            && stack.given[a].settles(off)
            && !between.into_iter().any(|k| stack.given[a].knows(k))
    };
    let mut found = Vec::new();
    for low in 0..stack.drawn.len() {
        for high in (low + 1..stack.drawn.len()).take_while(|&high| height([low, high]) <= WIDER * most) {
            let [ending, beginning]: [Vec<bool>; 2] =
                [[low, high], [high, low]].map(|[on, off]| (0..count).map(|a| stops(a, on, off)).collect());
            if ending.contains(&true) && beginning.contains(&true) {
                let near = |a: usize, b: usize| height([low, high]) <= WIDER * widest[a].max(widest[b]);
                let faces = Faces::of(stack, [low, high], [ending, beginning], near);
                found.extend(faces.large().map(|labels| Facing { slices: [low, high], labels }));
            }
        }
    }
    found
}

/// What labels that end on one slice and begin on another have of each other.
struct Faces {
    /// Pixels of each label on either slice, and how many of them lie on labels that end or begin on the other.
    areas: [Vec<u64>; 2],
    covered: [Vec<u64>; 2],
    pairs: Vec<[usize; 2]>,
}

impl Faces {
    fn of(stack: &LabelStack, slices: [usize; 2], stop: [Vec<bool>; 2], near: impl Fn(usize, usize) -> bool) -> Self {
        let count = stack.labels.len();
        let [mut areas, mut covered] = [0, 1].map(|_| [0, 1].map(|_| vec![0; count]));
        let mut shared: BTreeMap<[usize; 2], u64> = BTreeMap::new();
        let [low, high] = slices.map(|k| &stack.drawn[k]);
        for (&low, &high) in low.iter().zip(high) {
            let [a, b] = [low, high].map(|l| (l as usize).checked_sub(1));
            a.into_iter().for_each(|a| areas[0][a] += 1);
            b.into_iter().for_each(|b| areas[1][b] += 1);
            if let (Some(a), Some(b)) = (a, b)
                && stop[0][a]
                && stop[1][b]
                && near(a, b)
            {
                *shared.entry([a, b]).or_default() += 1;
            }
        }
        for ([a, b], pixels) in &shared {
            covered[0][*a] += pixels;
            covered[1][*b] += pixels;
        }
        Faces { areas, covered, pairs: shared.into_keys().collect() }
    }

    /// The pairs of which either is covered enough.
    fn large(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let enough = |side: usize, a: usize| self.covered[side][a] as f64 >= SHARE * self.areas[side][a] as f64;
        self.pairs.iter().copied().filter(move |[a, b]| enough(0, *a) && enough(1, *b))
    }
}
