//! Links: what is known of pairs of parts before the slices are compared, and what becomes of it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;

use super::context::Context;
use crate::contour::Contour;
use crate::contour::parts::{candidates, overlaps, parts_seen};
use crate::error::{Error, Result};
use crate::grid::field::{Field, position};
use crate::grid::spline::smoothstep;
use crate::pipeline::rigid_frames;
use crate::pipeline::slits::taken_apart;
use crate::reference::exact::exact_distance;
use crate::registration::displacement::Displacement;
use crate::registration::mid_frame::Frame;
use crate::registration::motion_stack::MotionStack;
use crate::report::{LinkReport, LinkedBy, Report};
use crate::settings::{Link, Linking, Motion};
use crate::storage::spill::SpillVec;

/// Fairing keeps off parts that are kept apart by this much and is whole beyond the other, px.
const UNFAIRED: [f64; 2] = [8.0, 16.0];

/// A link can be followed if half way this share of its parts' pixels has its motion: others may be in the way.
const FOLLOWED: f64 = 0.5;

/// The links of one interval.
#[derive(Debug, Clone, Default)]
pub(super) struct IntervalLinks {
    /// Links as the report tells them.
    pub told: Vec<LinkReport>,
}

impl IntervalLinks {
    /// Pairs that belong together.
    pub fn joined(&self) -> Vec<(u32, u32)> {
        self.told.iter().filter(|l| l.join).map(|l| (l.from, l.to)).collect()
    }

    /// Pairs that do not.
    pub fn parted(&self) -> Vec<(u32, u32)> {
        self.told.iter().filter(|l| !l.join).map(|l| (l.from, l.to)).collect()
    }

    /// Pairs of which the user says so.
    pub fn told_apart(&self) -> Vec<(u32, u32)> {
        self.told.iter().filter(|l| !l.join && l.by == LinkedBy::File).map(|l| (l.from, l.to)).collect()
    }
}

/// The user's links and those that are found.
pub(super) fn find_links(run: &Context<'_>, contours: &SpillVec<'_, Contour>) -> Result<Vec<IntervalLinks>> {
    for link in &run.settings.links {
        let count = |k: usize| contours.light(k).solids.count as u32;
        if link.from > count(link.slice) || link.to > count(link.slice + 1) {
            let message = format!("a part of link {link:?} was lost");
            return Err(Error::Numerics { stage: "distance", message });
        }
    }
    let of = |i: usize, pair: [&Contour; 2]| {
        let links = run.settings.links.iter().filter(|l| l.slice == i);
        let link = |l: &Link| (l.from, l.to, l.join, LinkedBy::File);
        let mut found: Vec<_> = links.map(link).collect();
        if run.settings.link == Linking::Auto {
            let auto = alike(run, pair, &found.iter().map(|l| ((l.0, l.1), l.2)).collect());
            found.extend(auto.into_iter().map(|(from, to)| (from, to, true, LinkedBy::Auto)));
        }
        let told = |(from, to, join, by)| LinkReport { from, to, join, by, meet: 0.0 };
        IntervalLinks { told: found.into_iter().map(told).collect() }
    };
    match run.settings.links.is_empty() && run.settings.link != Linking::Auto {
        true => Ok(vec![IntervalLinks::default(); contours.len() - 1]),
        false => run.of_pairs(contours, of),
    }
}

/// Pairs of parts without partner that look like one and the same and can be followed all at once; `known` pairs count as partners or
/// are left out.
fn alike(run: &Context<'_>, pair: [&Contour; 2], known: &BTreeMap<(u32, u32), bool>) -> Vec<(u32, u32)> {
    let dims = pair[0].phi.dims;
    let [low, high] = [0, 1].map(|k| parts_seen(&pair[k].solids, dims, run.h, &run.seen));
    let pairs = |join: bool| known.iter().filter(move |(_, j)| **j == join).map(|(pair, _)| *pair);
    let mut partners: BTreeSet<(u32, u32)> = overlaps(&pair[0].solids, &pair[1].solids);
    partners.extend(pairs(true));
    let mut found: Vec<(u32, u32)> = candidates(&low, &high, &pairs(false).collect(), &partners, dims, run.h)
        .into_iter()
        .filter(|c| c.convinces(run.settings.link_reach))
        .map(|c| (c.from, c.to))
        .collect();
    // What is in the way of a link, another link or a part that stands still, excludes it; of links that are as much in each other's way all go.
    while !found.is_empty() {
        let all: Vec<(u32, u32)> = pairs(true).chain(found.iter().copied()).collect();
        let followed = rigid_frames::linked(pair[0], pair[1], &all, run.h).followed;
        let shares = &followed[all.len() - found.len()..];
        let worst = shares.iter().copied().fold(f64::INFINITY, f64::min);
        if worst >= FOLLOWED {
            break;
        }
        let mut shares = shares.iter();
        found.retain(|_| shares.next().is_some_and(|share| *share > worst));
    }
    found
}

/// The displacements of linked parts, or of all that have a rigid frame; warns of links that cannot be followed.
pub(super) fn frames<'a>(
    run: &Context<'a>,
    links: &[IntervalLinks],
    contours: &SpillVec<'a, Contour>,
    report: &mut Report,
) -> Result<SpillVec<'a, Displacement>> {
    let frames = if run.settings.motion == Motion::Rigid { rigid_frames::rigid } else { rigid_frames::linked };
    let of = |i: usize, [low, high]: [&Contour; 2]| {
        let joined = links[i].joined();
        let found = frames(low, high, &joined, run.h);
        let unfollowed = joined.into_iter().zip(&found.followed).filter(|(_, share)| **share < FOLLOWED);
        let [below, above] = [0, 1].map(|k| &run.stack.slices[i + k].name);
        let warning = |((from, to), _): ((u32, u32), &f64)| {
            format!(
                "part {from} of `{below}` and part {to} of `{above}` are linked, but something else is in the way between them"
            )
        };
        let warnings: Vec<String> = unfollowed.map(warning).collect();
        (found.displacement, warnings)
    };
    let (mut displacements, mut warnings) = (SpillVec::new(run.budget), Vec::new());
    run.for_pairs(contours, of, |(displacement, mut of_pair)| {
        warnings.append(&mut of_pair);
        displacements.push(displacement)
    })?;
    report.warnings.append(&mut warnings);
    Ok(displacements)
}

/// Adds what the moving frame, if there is one, takes apart, and finds out how far linked parts meet in it.
pub(super) fn see_links(
    run: &Context<'_>,
    links: &mut [IntervalLinks],
    contours: &SpillVec<'_, Contour>,
    moving: Option<&MotionStack<'_>>,
) -> Result<()> {
    if let Some(moving) = moving.filter(|_| run.bonds.cores) {
        let several = |k: usize| contours.light(k).solids.count > 1;
        for (i, links) in links.iter_mut().enumerate().filter(|(i, _)| several(*i) && several(i + 1)) {
            let [low, high] = [contours.get(i)?, contours.get(i + 1)?];
            let known: BTreeSet<(u32, u32)> = links.told.iter().map(|l| (l.from, l.to)).collect();
            let apart = taken_apart([&low, &high], &*moving.at_slices(i)?, run.h)
                .into_iter()
                .filter(|pair| !known.contains(pair));
            let told = |(from, to)| LinkReport { from, to, join: false, by: LinkedBy::Motion, meet: 0.0 };
            links.told.extend(apart.map(told));
        }
    }
    for (i, links) in links.iter_mut().enumerate().filter(|(_, links)| !links.told.is_empty()) {
        let [low, high] = [contours.get(i)?, contours.get(i + 1)?];
        let at_slices = moving.map(|m| m.at_slices(i)).transpose()?;
        for link in &mut links.told {
            link.meet = rigid_frames::meeting(&low, &high, (link.from, link.to), at_slices.as_deref());
        }
    }
    Ok(())
}

/// Signed distance of every pixel to parts that are kept apart, on either contour, px.
fn away_from(parted: &[(u32, u32)], pair: [&Contour; 2], h: [f64; 2]) -> Field {
    let labels = pair.map(|contour| &contour.solids.labels);
    let apart = |n: usize| parted.iter().any(|(a, b)| *a == labels[0][n] || *b == labels[1][n]);
    let dims = pair[0].phi.dims;
    let mask: Vec<bool> = (0..dims[0] * dims[1]).map(apart).collect();
    exact_distance(&mask, dims, h)
}

/// Share of the fairing's strength in every interval where parts are kept apart.
pub(super) fn fairing_shares(
    run: &Context<'_>,
    links: &[IntervalLinks],
    contours: &SpillVec<'_, Contour>,
) -> Result<Vec<Option<Vec<f32>>>> {
    let share = |(i, links): (usize, &IntervalLinks)| {
        let parted = links.told_apart();
        if parted.is_empty() {
            return Ok(None);
        }
        let away = away_from(&parted, [&*contours.get(i)?, &*contours.get(i + 1)?], run.h);
        let [none, all] = UNFAIRED;
        let [nx, ny] = run.stack.dims;
        let padded = |n: usize| (n / nx + run.pad[1]) * away.dims[0] + n % nx + run.pad[0];
        let part = |n| smoothstep((away.data[padded(n)] - none) / (all - none)) as f32;
        Ok(Some((0..nx * ny).map(part).collect()))
    };
    links.iter().enumerate().map(share).collect()
}

/// Pairs of parts of two slices under the numbers that the parts have in the mid frame.
pub(super) fn in_frame(
    pairs: &[(u32, u32)],
    own: [&Contour; 2],
    seen: [&Contour; 2],
    frame: &Frame,
) -> Vec<(u32, u32)> {
    if pairs.is_empty() {
        return Vec::new();
    }
    let low = origins(seen[0], own[0], |x| frame.down(x));
    let high = origins(seen[1], own[1], |x| frame.up(x));
    let numbers = |of: &[u32], wanted: u32| -> Vec<u32> {
        (0..).zip(of).filter(|(_, origin)| **origin == wanted).map(|(number, _)| number).collect()
    };
    let of = |&(a, b): &(u32, u32)| -> Vec<(u32, u32)> {
        let (from, to) = (numbers(&low, a), numbers(&high, b));
        from.iter().flat_map(|&a| to.iter().map(move |&b| (a, b))).collect()
    };
    pairs.iter().flat_map(of).collect()
}

/// For each part that the mid frame sees the part of the slice that most of its pixels come from, by number; 0 where there is none.
pub(super) fn origins(seen: &Contour, own: &Contour, back: impl Fn(DVec2) -> DVec2) -> Vec<u32> {
    let [nx, ny] = own.phi.dims;
    let mut counts: Vec<BTreeMap<u32, usize>> = vec![BTreeMap::new(); seen.solids.count + 1];
    for (n, &label) in seen.solids.labels.iter().enumerate().filter(|(_, label)| **label > 0) {
        let x = back(position(n, nx)).round().max(DVec2::ZERO);
        let [i, j] = [(x.x as usize).min(nx - 1), (x.y as usize).min(ny - 1)];
        let origin = own.solids.labels[j * nx + i];
        if origin > 0 {
            *counts[label as usize].entry(origin).or_default() += 1;
        }
    }
    // The lowest number where two are equally frequent.
    let most = |counts: &BTreeMap<u32, usize>| counts.iter().rev().max_by_key(|(_, count)| **count).map_or(0, |c| *c.0);
    counts.iter().map(most).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_either_contour_that_are_kept_apart_are_not_faired() {
        let contour = |middles: &[f64]| {
            let value = |i: usize, j: usize| {
                let away = middles.iter().map(|x| libm::hypot(i as f64 - x, j as f64 - 10.0) - 4.5);
                away.fold(f64::INFINITY, f64::min)
            };
            Contour::new(0.0, Field::from_fn([100, 20], value), [1.0; 2], 1.0)
        };
        // The right one of two below, and the left one of two above.
        let away = away_from(&[(2, 1)], [&contour(&[12.0, 48.0]), &contour(&[80.0, 92.0])], [1.0; 2]);
        let at = |x: usize| away.data[10 * 100 + x];
        assert!(at(48) < -4.0 && at(80) < -4.0, "{} {}", at(48), at(80));
        assert!(at(12) > 30.0 && at(92) > 5.0, "{} {}", at(12), at(92));
    }
}
