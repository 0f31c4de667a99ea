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
    let at = |n: usize| (low.0.labels[n], high.0.labels[n]);
    let (mut begin, count) = (0, low.0.labels.len());
    while begin < count {
        let pair @ (a, b) = at(begin);
        let end = (begin + 1..count).find(|n| at(*n) != pair).unwrap_or(count);
        if a > 0 && b > 0 {
            let shallow = (begin..end).map(|n| (low.1.data[n].max(high.1.data[n]), n));
            let least = |p: (f64, usize), q: (f64, usize)| if q.0 < p.0 { q } else { p };
            let deepest = pairs.entry(pair).or_insert((f64::INFINITY, begin));
            *deepest = shallow.fold(*deepest, least);
        }
        begin = end;
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
    /// The same with groups as one whose components touch at a corner of pixels, on either contour: there both have one contour, of which each
    /// alone would have but a part. A line one pixel wide that runs at an angle is many such components.
    pub fn joined_at_corners(mut self, contours: [&Components; 2], nx: usize) -> Self {
        let mut parent: Vec<usize> = (0..self.groups.len()).collect();
        fn root(parent: &[usize], mut k: usize) -> usize {
            while parent[k] != k {
                k = parent[k];
            }
            k
        }
        for (side, components) in contours.into_iter().enumerate() {
            let mut group_of = vec![None; components.count + 1];
            for (g, group) in self.groups.iter().enumerate() {
                let members = if side == 0 { &group.low } else { &group.high };
                members.iter().for_each(|&k| group_of[k as usize] = Some(g));
            }
            let labels = &components.labels;
            // Squares of four pixels, but for those that would go around the image's edge.
            let squares = labels.windows(nx + 2).enumerate().filter(|(n, _)| (n + 1) % nx != 0);
            for (_, row) in squares {
                for (a, b) in [(row[0], row[nx + 1]), (row[1], row[nx])] {
                    if a == b || a == 0 || b == 0 {
                        continue;
                    }
                    if let (Some(a), Some(b)) = (group_of[a as usize], group_of[b as usize]) {
                        let (a, b) = (root(&parent, a), root(&parent, b));
                        parent[a.max(b)] = a.min(b);
                    }
                }
            }
        }
        for g in (0..self.groups.len()).rev() {
            let first = root(&parent, g);
            if first < g {
                let Group { low, high, anchors } = self.groups.remove(g);
                let into = &mut self.groups[first];
                into.low.extend(low);
                into.high.extend(high);
                into.anchors.extend(anchors);
            }
        }
        for group in &mut self.groups {
            group.low.sort_unstable();
            group.high.sort_unstable();
        }
        self
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::components::label4;

    /// Components of rows of `#` and others, and their field.
    fn drawn(rows: &[&str]) -> (Components, Field) {
        let inside: Vec<bool> = rows.iter().flat_map(|row| row.bytes().map(|c| c == b'#')).collect();
        let dims = [rows[0].len(), rows.len()];
        let data = inside.iter().map(|inside| if *inside { -0.5 } else { 0.5 }).collect();
        (label4(&inside, dims), Field { dims, data })
    }

    #[test]
    fn groups_that_touch_at_a_corner_on_either_contour_are_one() {
        let (low, high) = (drawn(&["#...#", ".#...", "....#"]), drawn(&["#...#", ".....", ".#..#"]));
        let lone = drawn(&["#...#", ".#...", ".#..#"]);
        let joined = |a: &(Components, Field), b: &(Components, Field)| {
            let found = match_components((&a.0, &a.1), (&b.0, &b.1), &DecidedPairs::default());
            let joined = found.joined_at_corners([&a.0, &b.0], 5);
            let groups =
                joined.groups.iter().map(|g| (g.low.clone(), g.high.clone(), g.anchors.len())).collect::<Vec<_>>();
            (groups, joined.deaths, joined.births)
        };
        // The pixel at the left end of a row does not touch that at the right end of the one above.
        let [a, b, c] = [(vec![1], vec![1], 1), (vec![2], vec![2], 1), (vec![4], vec![4], 1)];
        assert_eq!(joined(&low, &high), (vec![a, b, c], vec![3], vec![3]));
        let (groups, deaths, births) = joined(&low, &lone);
        assert_eq!(groups, [(vec![1, 3], vec![1, 3], 2), (vec![2], vec![2], 1), (vec![4], vec![4], 1)]);
        assert!(deaths.is_empty() && births.is_empty());
        assert_eq!(joined(&lone, &low).0, groups);
    }
}
