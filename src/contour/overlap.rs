//! Correspondence of the parts of two neighbouring contours: the overlap graph, its groups, and the events it tells of.

use std::collections::BTreeMap;

use crate::grid::components::Components;
use crate::grid::field::Field;
use crate::report::Event;

/// Components of two neighbouring contours that morph together: a connected part of the overlap graph with members on both sides.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Group {
    /// Components below, increasing.
    pub low: Vec<u32>,
    /// Components above, increasing.
    pub high: Vec<u32>,
    /// One node for each pair that overlaps, where the overlap is deepest: the result is inside there at every height between, so
    /// that what overlaps is connected.
    pub anchors: Vec<usize>,
}

/// The overlap graph of an interval.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Matching {
    /// Groups by their first component below.
    pub groups: Vec<Group>,
    /// Components below without partner above.
    pub deaths: Vec<u32>,
    /// Components above without partner below.
    pub births: Vec<u32>,
}

/// Pairs of components about which something is known beforehand.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DecidedPairs {
    /// Pairs that belong together, whether they overlap or not.
    pub joined: Vec<(u32, u32)>,
    /// Pairs that do not, though they overlap. Others may still bring them into one group.
    pub parted: Vec<(u32, u32)>,
}

impl DecidedPairs {
    /// Only pairs that belong together.
    pub fn joining(pairs: &[(u32, u32)]) -> Self {
        DecidedPairs { joined: pairs.to_vec(), parted: Vec::new() }
    }

    /// Only pairs that do not.
    pub fn parting(pairs: Vec<(u32, u32)>) -> Self {
        DecidedPairs { joined: Vec::new(), parted: pairs }
    }
}

/// Builds the overlap graph of two labelled contours on the same pixels.
pub fn match_components(low: (&Components, &Field), high: (&Components, &Field), decided: &DecidedPairs) -> Matching {
    // Deepest pixel of each overlapping pair; the first in row order where several are equally deep.
    let mut pairs: BTreeMap<(u32, u32), (f64, usize)> = BTreeMap::new();
    for (node, (&a, &b)) in low.0.labels.iter().zip(&high.0.labels).enumerate() {
        if a > 0 && b > 0 {
            let shallow = low.1.data[node].max(high.1.data[node]);
            let deepest = pairs.entry((a, b)).or_insert((shallow, node));
            if shallow < deepest.0 {
                *deepest = (shallow, node);
            }
        }
    }
    pairs.retain(|pair, _| !decided.parted.contains(pair));
    // Union-find over components below (1..) and above (after them).
    let mut parent: Vec<usize> = (0..low.0.count + high.0.count + 1).collect();
    fn root(parent: &mut [usize], mut k: usize) -> usize {
        while parent[k] != k {
            parent[k] = parent[parent[k]];
            k = parent[k];
        }
        k
    }
    for &(a, b) in pairs.keys().chain(&decided.joined) {
        let (ra, rb) = (root(&mut parent, a as usize), root(&mut parent, low.0.count + b as usize));
        parent[ra.max(rb)] = ra.min(rb);
    }
    let mut groups: BTreeMap<usize, Group> = BTreeMap::new();
    for a in 1..=low.0.count {
        groups.entry(root(&mut parent, a)).or_default().low.push(a as u32);
    }
    for b in 1..=high.0.count {
        groups.entry(root(&mut parent, low.0.count + b)).or_default().high.push(b as u32);
    }
    for ((a, _), (_, node)) in pairs {
        groups.entry(root(&mut parent, a as usize)).or_default().anchors.push(node);
    }
    let mut out = Matching::default();
    for group in groups.into_values() {
        match (group.low.is_empty(), group.high.is_empty()) {
            (false, true) => out.deaths.extend(group.low),
            (true, false) => out.births.extend(group.high),
            _ => out.groups.push(group),
        }
    }
    out
}

impl Matching {
    /// Events of solid parts, seen from below.
    pub fn events(&self) -> Vec<Event> {
        let numbers = |ids: &[u32]| ids.iter().map(|&k| k as usize).collect::<Vec<_>>();
        let mut events = Vec::new();
        for g in &self.groups {
            let (from, to) = (numbers(&g.low), numbers(&g.high));
            if from.len() > 1 {
                events.push(Event::Merge { from: from.clone(), to: to.clone() });
            }
            if to.len() > 1 {
                events.push(Event::Split { from, to });
            }
        }
        events.extend(self.births.iter().map(|&k| Event::Birth { component: k as usize }));
        events.extend(self.deaths.iter().map(|&k| Event::Death { component: k as usize }));
        events
    }
}
