//! Slices that a label is given: those on which it is painted, and those that say that it is not there.

use std::collections::BTreeMap;

/// Meaning of painted slices for labels that are not on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Completeness {
    /// What the label's own slices say: one that is not painted on some slice between its first and its last has slices of its own, and nothing is known
    /// of it on those of others; one that is painted on all of them has ended on the next slice of such a row ([`completed`]). Where
    /// labels are painted on every slice there is nothing left to be interpolated, and a slice without one says so (`Given::own`).
    Own,
    /// The labels are not there: each slice counts for each label, from the first to the last.
    Complete,
}

/// The slices of one label, by their places in the stack.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Given {
    /// Slices that its body is made of, increasing: painted ones, and those between them on which it is known not to be.
    pub slices: Vec<usize>,
    /// Slices beyond its first and last on which it is known not to be: its ends do not reach there.
    pub shut: Vec<usize>,
    /// Whether others are painted between its slices on some that are not given.
    pub crossed: bool,
    /// Whether it is painted slice by slice.
    pub dense: bool,
    /// Numbers of the unpainted slices beside which it is painted slice by slice: first and last of each stretch.
    pub holes: Vec<[usize; 2]>,
}

/// Share of a label's gaps that are no wider than a slice where it is painted slice by slice; slices painted in pairs with gaps between have half
/// of them and one.
const DENSE: f64 = 0.75;

/// A slice beyond a label's first or last one is of the same row if it is this many times as far from it, as the nearest and as the farthest of the label's
/// own are from each other.
const SAME_ROW: [f64; 2] = [0.75, 1.5];

/// Adds slices at which labels have ended: a label on two slices at least, and on all that are painted between its first and its last, was looked for on each,
/// and is not on the next slice of that row. What others have there in its place goes on in their unions (`ended.rs`).
pub fn completed(given: Vec<Given>, z: &[f64]) -> Vec<Given> {
    let complete = |mut given: Given| {
        let (Some([first, last]), false) = (given.ends(), given.crossed || given.dense) else { return given };
        let gaps = || given.slices.windows(2).map(|pair| z[pair[1]] - z[pair[0]]);
        let Some((least, most)) = gaps().map(|gap| (gap, gap)).reduce(|(a, b), (c, d)| (a.min(c), b.max(d))) else {
            return given;
        };
        let row = SAME_ROW[0] * least..=SAME_ROW[1] * most;
        let is_next = |on: usize, beyond: &usize| row.contains(&(z[on] - z[*beyond]).abs());
        let below = first.checked_sub(1).filter(|beyond| is_next(first, beyond));
        let above = Some(last + 1).filter(|k| *k < z.len() && is_next(last, k));
        given.slices = below.into_iter().chain(given.slices).chain(above).collect();
        given
    };
    given.into_iter().map(complete).collect()
}

impl Given {
    /// The slices of a label, from those on which the label is painted, of those with these numbers on which anything is.
    pub fn new(painted: &[bool], numbers: &[usize], completeness: Completeness) -> Self {
        let own: Vec<usize> = (0..painted.len()).filter(|&k| painted[k]).collect();
        match completeness {
            _ if own.is_empty() => Given::default(),
            Completeness::Own => Given::own(&own, numbers),
            Completeness::Complete => Given { slices: (0..painted.len()).collect(), ..Given::default() },
        }
    }

    /// A label that is painted slice by slice ([`DENSE`]) is not there where others are, without a slice between that has no paint at all.
    fn own(own: &[usize], numbers: &[usize]) -> Self {
        let gap = |pair: &[usize]| numbers[pair[1]] - numbers[pair[0]];
        let beside = own.windows(2).filter(|pair| gap(pair) == 1).count();
        let dense = own.len() > 1 && beside as f64 >= DENSE * (own.len() - 1) as f64;
        let mut given = Given { slices: own[..1].to_vec(), dense, ..Given::default() };
        for pair in own.windows(2) {
            let between = pair[0] + 1..pair[1];
            match dense && gap(pair) > 1 {
                true if between.len() + 1 == gap(pair) => given.slices.extend(between),
                true => given.holes.push([numbers[pair[0]] + 1, numbers[pair[1]] - 1]),
                false => given.crossed |= !between.is_empty(),
            }
            given.slices.push(pair[1]);
        }
        if dense {
            let [first, last] = [own[0], own[own.len() - 1]];
            let below = (0..first).rev().take_while(|&k| numbers[k] + (first - k) == numbers[first]);
            let above = (last + 1..numbers.len()).take_while(|&k| numbers[k] == numbers[last] + (k - last));
            given.shut = below.chain(above).collect();
            given.shut.sort_unstable();
        }
        given
    }

    /// Whether the label is known on a slice, to be there or not to be.
    pub(super) fn knows(&self, slice: usize) -> bool {
        self.slices.binary_search(&slice).is_ok() || self.shuts(slice)
    }

    /// Whether the label cannot be on a slice beyond its ends.
    pub(super) fn shuts(&self, slice: usize) -> bool {
        self.shut.binary_search(&slice).is_ok()
    }

    /// Whether it is not known on some slice between its first and its last.
    pub(super) fn skips(&self) -> bool {
        self.ends().is_some_and(|[first, last]| self.slices.len() <= last - first)
    }

    /// Why a label with these slices cannot be reconstructed.
    pub fn too_few(&self) -> Option<String> {
        match self.slices.len() {
            0 => Some("is drawn on none of the slices, at least 2 are needed".into()),
            1 => Some(format!("is drawn on 1 of the slices, at least 2 are needed{OTHERS}")),
            _ => None,
        }
    }

    /// First and last slice.
    pub(super) fn ends(&self) -> Option<[usize; 2]> {
        Some([*self.slices.first()?, *self.slices.last()?])
    }

    /// Whether a union with this label is known on a slice: the label is, or it has ended.
    pub(super) fn settles(&self, slice: usize) -> bool {
        self.knows(slice) || self.ends().is_none_or(|[first, last]| slice < first || slice > last)
    }

    /// Distance of a height from the nearest slice on which the label is known.
    pub(super) fn distance(&self, z: f64, slices: &[f64]) -> f64 {
        let nearest = |known: &[usize]| {
            let above = known.partition_point(|&k| slices[k] < z);
            let around = known[above.saturating_sub(1)..].iter().take(2);
            around.map(|&k| (slices[k] - z).abs()).fold(f64::INFINITY, f64::min)
        };
        nearest(&self.slices).min(nearest(&self.shut))
    }
}

/// What gives a label that is drawn on one slice others on which it has ended.
const OTHERS: &str = "; with `--complete-slices` it ends towards those on which it is not";
/// Most labels that a message names.
const NAMED: usize = 8;

/// Labels by their numbers, for people.
pub fn listed(labels: &[i64]) -> String {
    let named: Vec<String> = labels.iter().take(NAMED).map(i64::to_string).collect();
    let s = if labels.len() == 1 { "" } else { "s" };
    match labels.len().saturating_sub(NAMED) {
        0 => format!("label{s} {}", named.join(", ")),
        more => format!("labels {} and {more} more", named.join(", ")),
    }
}

/// Way in which slices were read on which others are painted than some labels that go on beyond them.
pub fn reading(labels: &[i64], given: &[Given]) -> Option<String> {
    let crossing = labels.iter().zip(given).filter(|(_, given)| given.crossed);
    let crossing: Vec<i64> = crossing.map(|(label, _)| *label).collect();
    let message = "interpolated across slices on which only others are painted; `--complete-slices` ends them there";
    (!crossing.is_empty()).then(|| format!("{}: {message}", listed(&crossing)))
}

/// Notes for a person on the labels' slices.
pub fn notes(labels: &[i64], given: &[Given]) -> Vec<String> {
    // Labels often have the same holes, where nothing at all is painted.
    let mut alike: BTreeMap<&[[usize; 2]], Vec<i64>> = BTreeMap::new();
    for (label, given) in labels.iter().zip(given).filter(|(_, given)| !given.holes.is_empty()) {
        alike.entry(&given.holes).or_default().push(*label);
    }
    let more = alike.len().saturating_sub(NAMED);
    let mut notes: Vec<String> =
        alike.into_iter().take(NAMED).filter_map(|(holes, labels)| hole(&listed(&labels), holes)).collect();
    if more > 0 {
        notes.push(format!("other labels have unpainted slices too, in {more} ways"));
    }
    notes
}

/// Note on unpainted slices beside slices that are painted one by one.
pub fn hole(who: &str, holes: &[[usize; 2]]) -> Option<String> {
    let said =
        |&[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first} to {last}") };
    let listed: Vec<String> = holes.iter().take(NAMED).map(said).collect();
    let more = holes.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more stretches") } else { String::new() };
    let message = "interpolated across; `--keep 1` takes unpainted slices as empty";
    (!listed.is_empty())
        .then(|| format!("{who}: painted slice by slice, but not on {}{more}: {message}", listed.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The slices of a label on some of those that are painted.
    fn given(own: &[usize], numbers: &[usize], completeness: Completeness) -> Given {
        let painted: Vec<bool> = numbers.iter().map(|k| own.contains(k)).collect();
        let mut given = Given::new(&painted, numbers, completeness);
        (given.slices, given.shut) =
            (given.slices.iter().map(|k| numbers[*k]).collect(), given.shut.iter().map(|k| numbers[*k]).collect());
        given
    }

    #[test]
    fn p12_slices_of_a_label_are_its_own() {
        let numbers = [0, 5, 10, 15, 20, 25, 30];
        let own = given(&[0, 10, 20, 30], &numbers, Completeness::Own);
        assert_eq!((own.slices, own.shut, own.crossed), (vec![0, 10, 20, 30], vec![], true));
        let inner = given(&[5, 15], &numbers, Completeness::Complete);
        assert_eq!((inner.slices, inner.shut, inner.crossed), (numbers.to_vec(), vec![], false));
        assert_eq!(given(&[], &numbers, Completeness::Complete), Given::default());
    }

    #[test]
    fn p12_where_all_is_painted_slice_by_slice_a_hole_is_one() {
        let numbers: Vec<usize> = (0..=30).collect();
        let bodies = [3, 4, 5, 6, 20, 21, 22];
        let dense = given(&bodies, &numbers, Completeness::Own);
        assert_eq!(dense.slices, (3..=22).collect::<Vec<_>>());
        assert_eq!(dense.shut, (0..3).chain(23..=30).collect::<Vec<_>>());
        assert!(!dense.crossed && dense.holes.is_empty());
        // A single unpainted slice in the hole, and nothing is known of the hole.
        let numbers: Vec<usize> = (0..=30).filter(|k| *k != 12 && *k != 25).collect();
        let open = given(&bodies, &numbers, Completeness::Own);
        assert_eq!((open.slices, &open.holes[..]), (bodies.to_vec(), &[[7, 19]][..]));
        assert_eq!(open.shut, [0, 1, 2, 23, 24]);
        // Slices in pairs are not painted slice by slice.
        let pairs = [0, 1, 10, 11, 20, 21];
        assert_eq!(given(&pairs, &(0..=30).collect::<Vec<_>>(), Completeness::Own).slices, pairs);
    }
}
