//! Words of `inspect` about parts that miss each other, and about links.

use std::collections::BTreeSet;

use interslice::contour::parts::{Candidate, candidates, overlaps, parts};
use interslice::grid::components::Components;
use interslice::settings::Link;
use interslice::stack::Slice;
use interslice::{ContourStack, Settings};

/// Parts, pairs and candidates between two slices that are listed, of each kind; of more their number is told.
const LISTED: usize = 24;

/// The first [`LISTED`] of them, and how many more there are.
fn listed(all: &[String]) -> String {
    match all.len().saturating_sub(LISTED) {
        0 => all.join(" "),
        more => format!("{} and {more} more", all[..LISTED].join(" ")),
    }
}

/// Lines about what lies between slice `k`, whose parts are `low`, and the next: overlaps where it is more than one part on one part, parts
/// without partner, links, and candidates for more.
pub fn between(stack: &ContourStack, k: usize, low: &Components, high: &Components, links: &[Link]) -> Vec<String> {
    let mut partners = overlaps(low, high);
    let links: Vec<&Link> = links.iter().filter(|l| l.slice == k).collect();
    if low.count == 1 && high.count == 1 && partners.len() == 1 && links.is_empty() {
        return Vec::new();
    }
    let slices = [&stack.slices[k], &stack.slices[k + 1]];
    let mut lines = Vec::new();
    if !partners.is_empty() {
        let text: Vec<String> = partners.iter().map(|(a, b)| format!("{a}-{b}")).collect();
        lines.push(format!("    parts that overlap: {}", listed(&text)));
    }
    for link in &links {
        let what = if link.join { "linked" } else { "kept apart" };
        lines.push(format!("    {what}: {}-{}", link.from, link.to));
    }
    let pairs = |join: bool| links.iter().filter(move |l| l.join == join).map(|l| (l.from, l.to));
    partners.extend(pairs(true));
    let apart: BTreeSet<(u32, u32)> = pairs(false).collect();
    lines.extend(without_partner(slices, low, high, &partners.difference(&apart).copied().collect()));
    let h = stack.spacing.map(|s| s / stack.spacing[0].max(stack.spacing[1]));
    let of = |solids| parts(solids, stack.dims, h);
    let found = candidates(&of(low), &of(high), &apart, &partners, stack.dims, h);
    lines.extend(proposals(k, found));
    lines
}

fn without_partner(
    slices: [&Slice; 2],
    low: &Components,
    high: &Components,
    partners: &BTreeSet<(u32, u32)>,
) -> Vec<String> {
    let alone = |count: usize, has: &dyn Fn(u32) -> bool| -> Vec<String> {
        (1..=count as u32).filter(|p| !has(*p)).map(|p| p.to_string()).collect()
    };
    let of_low = alone(low.count, &|p| partners.iter().any(|(a, _)| *a == p));
    let of_high = alone(high.count, &|p| partners.iter().any(|(_, b)| *b == p));
    [(of_low, "above", slices[0]), (of_high, "below", slices[1])]
        .into_iter()
        .filter(|(parts, ..)| !parts.is_empty())
        .map(|(parts, place, slice)| {
            format!(
                "    no partner {place}, ends before it unless its motion leads to one: {} of `{}`",
                listed(&parts),
                slice.name
            )
        })
        .collect()
}

/// Lines about candidates: where there are many, about those first that are enough for `--link auto`.
fn proposals(k: usize, mut found: Vec<Candidate>) -> Vec<String> {
    let more = found.len().saturating_sub(LISTED);
    if more > 0 {
        found.sort_by_key(|c| !c.convinces(Settings::default().link_reach));
        found.truncate(LISTED);
    }
    let told = (more > 0).then(|| format!("    and {more} more pairs that might be linked"));
    found.iter().map(|c| proposal(k, c)).chain(told).collect()
}

/// A candidate with its entry for a links file.
fn proposal(k: usize, c: &Candidate) -> String {
    let auto = if c.convinces(Settings::default().link_reach) { "enough" } else { "not enough" };
    let nearest = if c.mutual { "" } else { ", nearest one way only" };
    format!(
        "    perhaps {{\"slice\": {k}, \"from\": {}, \"to\": {}}}: {:.1} radii apart, area x {:.2}, overlap {:.2} when shifted{nearest}; {auto} for `--link auto`",
        c.from, c.to, c.distance, c.area_ratio, c.iou
    )
}
