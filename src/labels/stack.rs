//! Slices on which several labels are drawn.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::facing::facing;
use super::given::Given;
use super::report::LeftOut;
use crate::error::{Error, Result};
use crate::stack::appearance::Appearance;
use crate::stack::heights::SAME;
use crate::stack::{ContourStack, Slice, SliceContent};
use crate::surface::content::Scalar;

/// Labels by their places in a [`LabelStack`], the lower first.
pub(super) type LabelPair = (usize, usize);

/// Pairs of labels that have pixels side by side somewhere: the slices that both are given, increasing, and whether they touch there.
pub(super) struct Contacts {
    pairs: Vec<(LabelPair, Vec<(usize, bool)>)>,
}

impl Contacts {
    /// The pairs that touch on slice `at`, or, where both are not given it, on the two of their slices around it, and those that touch on one of these
    /// two: one of both ends, or they part. `at` lies before slice `above` where it is none itself.
    pub fn around(&self, above: usize, at: Option<usize>) -> [BTreeSet<LabelPair>; 2] {
        let touch = |common: &[(usize, bool)]| {
            let next = common.partition_point(|(k, _)| *k < above);
            let touches = |n: usize| common.get(n).is_some_and(|(_, touches)| *touches);
            match at.is_some_and(|k| common.get(next).is_some_and(|(next, _)| *next == k)) {
                true => [touches(next); 2],
                false => [next.checked_sub(1).is_some_and(touches), touches(next)],
            }
        };
        let mut around = [BTreeSet::new(), BTreeSet::new()];
        for (pair, common) in &self.pairs {
            match touch(common) {
                [true, true] => around[0].insert(*pair),
                [false, false] => false,
                _ => around[1].insert(*pair),
            };
        }
        around
    }
}

/// Pixels of a slice that labels have where others are drawn: stretches of them, by the label's place.
pub type Covered = Vec<(usize, Range<usize>)>;

/// A pair of labels and the slices on which their union has to be known.
type PairSlices = (LabelPair, Vec<usize>);

/// Unions that a label is in at most: each costs as much as a body, and what is left after so many is little.
const GROUPINGS: usize = 3;

/// Slices of neighbouring ones in both of which two labels touch.
fn beside(common: &[(usize, bool)]) -> Vec<usize> {
    let both = common.windows(2).filter(|w| w[0].1 && w[1].1);
    both.flat_map(|w| [w[0].0, w[1].0]).collect()
}

/// A label that is drawn on one slice only: there is nothing to interpolate, but what is painted stays.
#[derive(Debug, Clone)]
pub struct SingleSlice {
    /// Its number.
    pub label: i64,
    /// Its name and colour, as far as the input says them.
    pub appearance: Appearance,
    /// The slice, by its place in the stack.
    pub slice: usize,
    /// Its pixels there.
    pub pixels: Vec<usize>,
}

/// Drawn slices of several labels. Labels are called by their places in `labels`.
#[derive(Debug, Clone)]
pub struct LabelStack {
    /// All labels together.
    pub stack: ContourStack,
    /// The labels' numbers, increasing.
    pub labels: Vec<i64>,
    /// Their names and colours, as far as the input says them.
    pub appearances: Vec<Appearance>,
    /// Type of the input's voxels.
    pub scalar: Scalar,
    /// For each slice and pixel 0, or the place of its label and 1.
    pub drawn: Vec<Vec<u32>>,
    /// For each slice what labels have under others: nothing, but of labels that are each read whole.
    pub covered: Vec<Covered>,
    /// For each label its slices.
    pub given: Vec<Given>,
    /// Labels that are drawn on one slice only: not among `labels`, but in the label volume on that slice.
    pub singles: Vec<SingleSlice>,
    /// Labels that cannot be reconstructed, and why.
    pub left_out: Vec<LeftOut>,
    /// Way in which slices were read that could be read in another way too.
    pub reading: Option<String>,
    /// Notes on the input for a person.
    pub notes: Vec<String>,
}

impl LabelStack {
    /// Checks that each label can be reconstructed.
    ///
    /// # Errors
    /// The errors of [`ContourStack::validate`]; [`Error::Stack`] naming a label that is drawn on fewer than two slices.
    pub fn validate(&self) -> Result<()> {
        self.stack.validate()?;
        for (label, given) in self.labels.iter().zip(&self.given) {
            if let Some(why) = given.too_few() {
                return Err(Error::Stack(format!("label {label} {why}; leave it out of `--labels`")));
            }
        }
        Ok(())
    }

    /// Leaves out the labels for which there is a reason why: they are no longer drawn, but their slices stay, as paint that says something.
    pub(crate) fn leave_out(&mut self, why: impl Fn(&Self, usize) -> Option<String>) {
        let whys: Vec<Option<String>> = (0..self.labels.len()).map(|a| why(self, a)).collect();
        if whys.iter().all(Option::is_none) {
            return;
        }
        let mut left = 0;
        let places: Vec<usize> = std::iter::once(0)
            .chain(whys.iter().map(|why| {
                left += usize::from(why.is_none());
                if why.is_none() { left } else { 0 }
            }))
            .collect();
        let of = |(a, why): (usize, &Option<String>)| {
            let (label, name) = (self.labels[a], self.appearances[a].name.clone());
            why.clone().map(|why| LeftOut { label, name, why })
        };
        self.left_out.extend(whys.iter().enumerate().filter_map(of));
        let stays = |a: usize| places[a + 1] > 0;
        retain(&mut self.labels, stays);
        retain(&mut self.appearances, stays);
        retain(&mut self.given, stays);
        self.drawn.iter_mut().flatten().for_each(|l| *l = places[*l as usize] as u32);
        for pixels in &mut self.covered {
            pixels.retain(|(a, _)| stays(*a));
            pixels.iter_mut().for_each(|(a, _)| *a = places[*a + 1] - 1);
        }
        for (slice, drawn) in self.stack.slices.iter_mut().zip(&self.drawn) {
            slice.content = SliceContent::Mask(drawn.iter().map(|l| *l > 0).collect());
        }
    }

    /// Says of labels that are drawn on one slice whether the label volume, with layers at these heights, has them.
    pub(crate) fn tell_singles(&mut self, heights: &[f64]) {
        let slices = &self.stack.slices;
        let gaps = slices.windows(2).map(|w| w[1].z - w[0].z);
        let same = SAME * gaps.fold(f64::INFINITY, f64::min);
        for single in &self.singles {
            let z = slices[single.slice].z;
            let has = heights.iter().any(|height| (height - z).abs() <= same);
            for left in self.left_out.iter_mut().filter(|left| left.label == single.label) {
                left.why += &match has {
                    true => "; a label volume has it there as it is painted".to_string(),
                    false => format!("; no output layer lies there, at {z}"),
                };
            }
        }
    }

    /// Says why none is left, where all are left out.
    pub(crate) fn some_are_left(&self) -> std::result::Result<(), String> {
        let listed = || self.left_out.iter().map(LeftOut::to_string).collect::<Vec<_>>().join("; ");
        if self.labels.is_empty() {
            Err(format!("none of its labels can be reconstructed: {}", listed()))
        } else {
            Ok(())
        }
    }

    /// Heights of the slices of label `a`, and whether it has ended on the first and on the last of them.
    pub(crate) fn slices_of(&self, a: usize) -> (Vec<f64>, [bool; 2]) {
        let ends = self.given[a].ends().map_or(0..0, |[first, last]| first..last + 1);
        let own: Vec<usize> = ends.filter(|&k| self.settled(&[a], k)).collect();
        let place = a as u32 + 1;
        let has_ended = |k: Option<&usize>| {
            k.is_none_or(|&k| !self.drawn[k].contains(&place) && !self.covered[k].iter().any(|(b, _)| *b == a))
        };
        (own.iter().map(|&k| self.stack.slices[k].z).collect(), [has_ended(own.first()), has_ended(own.last())])
    }

    /// Least and largest number that the label volume has.
    pub(crate) fn range(&self) -> [i64; 2] {
        let all = self.labels.iter().copied().chain(self.singles.iter().map(|single| single.label));
        all.fold([i64::MAX, i64::MIN], |[least, most], label| [least.min(label), most.max(label)])
    }

    /// Names and colours of all labels that the label volume has.
    pub(crate) fn shown(&self) -> Vec<Appearance> {
        self.appearances.iter().chain(self.singles.iter().map(|single| &single.appearance)).cloned().collect()
    }

    /// Pixels drawn with label `a`, and the first of them.
    pub(super) fn drawn_pixels(&self, a: usize) -> (u64, usize) {
        let all = self.drawn.iter().flatten().enumerate().filter(|(_, l)| **l == a as u32 + 1);
        all.fold((0, usize::MAX), |(count, first), (n, _)| (count + 1, first.min(n)))
    }

    /// For each slice whether each label is painted there.
    pub(super) fn painted(&self) -> Vec<Vec<bool>> {
        let on = |slice: &Vec<u32>| {
            let mut painted = vec![false; self.labels.len() + 1];
            slice.iter().for_each(|&l| painted[l as usize] = true);
            painted[1..].to_vec()
        };
        self.drawn.iter().map(on).collect()
    }

    /// Label `a` alone.
    pub fn alone(&self, a: usize) -> ContourStack {
        self.united(&[a])
    }

    /// Some labels as one body, of the slices on which all of them are known or have ended, but not all have.
    pub(super) fn united(&self, labels: &[usize]) -> ContourStack {
        let ends = labels.iter().filter_map(|&a| self.given[a].ends());
        let ends = ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let slices = ends.map_or(0..0, |[first, last]| first..last + 1);
        let mut inside = vec![false; self.labels.len() + 1];
        labels.iter().for_each(|&a| inside[a + 1] = true);
        // Where some have ended and the others not begun, a slice of others says nothing.
        let says = |k: usize| labels.iter().any(|&a| self.given[a].knows(k));
        let slice = |k: usize| {
            let mut mask: Vec<bool> = self.drawn[k].iter().map(|&l| inside[l as usize]).collect();
            let under = self.covered[k].iter().filter(|(a, _)| labels.contains(a));
            under.for_each(|(_, stretch)| mask[stretch.clone()].fill(true));
            let Slice { name, z, extra, .. } = &self.stack.slices[k];
            Slice { name: name.clone(), z: *z, extra: *extra, content: SliceContent::Mask(mask.into_iter().collect()) }
        };
        ContourStack {
            slices: slices.filter(|&k| self.settled(labels, k) && says(k)).map(slice).collect(),
            unit: self.stack.unit.clone(),
            ..self.stack
        }
    }

    /// Whether the union of some labels is known on a slice.
    pub(super) fn settled(&self, labels: &[usize], slice: usize) -> bool {
        labels.iter().all(|&a| self.given[a].settles(slice))
    }

    /// For each pair of labels that have pixels side by side somewhere: the slices that both are given, and whether they touch there.
    pub(super) fn contacts(&self) -> Contacts {
        let touching = self.touching();
        let pairs: BTreeSet<LabelPair> = touching.iter().flatten().copied().collect();
        let common = |(a, b): LabelPair| {
            let both = self.given[a].slices.iter().filter(|k| self.given[b].slices.binary_search(k).is_ok());
            both.map(|&k| (k, touching[k].contains(&(a, b)))).collect()
        };
        Contacts { pairs: pairs.into_iter().map(|pair| (pair, common(pair))).collect() }
    }

    /// For each slice the labels that have pixels side by side.
    fn touching(&self) -> Vec<BTreeSet<LabelPair>> {
        let nx = self.stack.dims[0];
        let on = |slice: &Vec<u32>| {
            let mut pairs = BTreeSet::new();
            for (n, &a) in slice.iter().enumerate() {
                let right = if (n + 1) % nx == 0 { 0 } else { slice[n + 1] };
                let below = slice.get(n + nx).copied().unwrap_or(0);
                for b in [right, below] {
                    if a != b && a > 0 && b > 0 {
                        pairs.insert((a.min(b) as usize - 1, a.max(b) as usize - 1));
                    }
                }
            }
            pairs
        };
        self.drawn.iter().map(on).collect()
    }

    /// Slices on which the union of a pair has to be known, that on `common` slices touches or does not: two neighbours on which it touches, or on
    /// the one of which it touches and on the other just one of both is.
    fn needed(&self, painted: &[Vec<bool>], (a, b): LabelPair, common: &[(usize, bool)]) -> Vec<usize> {
        let mut slices = beside(common);
        for k in common.iter().filter(|(_, touches)| *touches).map(|(k, _)| *k) {
            let one_is = |&k: &usize| {
                painted.get(k).is_some_and(|on| on[a] != on[b]) && [a, b].iter().all(|&l| self.given[l].settles(k))
            };
            let neighbours = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
            neighbours.filter(one_is).for_each(|beyond| slices.extend([k, beyond]));
        }
        slices
    }

    /// Labels that touch each other on two neighbouring slices of both, or where one of both ends, or that face each other ([`facing`]), some by way of
    /// others; only groups of more than one. Labels whose union would not be known on those slices stay apart: the pairs come first of which both are known
    /// throughout, then those with more drawn pixels, whatever their numbers. What so stays apart is grouped once more by itself, so that a label may be in
    /// several groups, [`GROUPINGS`] times in all.
    pub(super) fn groups(&self, contacts: &Contacts) -> Vec<Vec<usize>> {
        let ranks: Vec<_> =
            (0..self.labels.len()).map(|a| self.drawn_pixels(a)).map(|(n, k)| (Reverse(n), k)).collect();
        let painted = self.painted();
        let mut needed: BTreeMap<LabelPair, Vec<usize>> = BTreeMap::new();
        for face in facing(self, &painted) {
            needed.entry(face.pair()).or_default().extend(face.slices);
        }
        for (pair, common) in &contacts.pairs {
            needed.entry(*pair).or_default().extend(self.needed(&painted, *pair, common));
        }
        let mut pairs: Vec<PairSlices> = needed.into_iter().filter(|(_, k)| !k.is_empty()).collect();
        let skips = |(a, b): LabelPair| self.given[a].skips() || self.given[b].skips();
        pairs.sort_by_key(|(pair @ (a, b), _)| (skips(*pair), ranks[*a].min(ranks[*b]), ranks[*a].max(ranks[*b])));
        let mut groups = Vec::new();
        for _ in 0..GROUPINGS {
            let grouped = self.grouped(&mut pairs);
            groups.extend(grouped);
        }
        groups.sort_unstable();
        groups
    }

    /// Groups of pairs, as far as their unions are known on the slices that they need; leaves the other pairs.
    fn grouped(&self, pairs: &mut Vec<PairSlices>) -> Vec<Vec<usize>> {
        let mut groups: Vec<(Vec<usize>, BTreeSet<usize>)> =
            (0..self.labels.len()).map(|a| (vec![a], BTreeSet::new())).collect();
        pairs.retain(|((a, b), needed)| {
            let at = |a: &usize| groups.iter().position(|(members, _)| members.contains(a));
            let (Some(into), Some(from)) = (at(a), at(b)) else { return true };
            let mut members = groups[into].0.clone();
            let mut slices = groups[into].1.clone();
            slices.extend(needed);
            if into != from {
                members.extend(&groups[from].0);
                slices.extend(&groups[from].1);
            }
            let known = slices.iter().all(|&k| self.settled(&members, k));
            if known {
                members.sort_unstable();
                groups[into] = (members, slices);
                if into != from {
                    groups.remove(from);
                }
            }
            !known
        });
        groups.into_iter().map(|(members, _)| members).filter(|members| members.len() > 1).collect()
    }
}

/// Keeps what stands at places for which `stays` is true.
fn retain<T>(all: &mut Vec<T>, stays: impl Fn(usize) -> bool) {
    let mut places = 0..;
    all.retain(|_| places.next().is_some_and(&stays));
}
