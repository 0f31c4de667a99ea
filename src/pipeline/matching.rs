//! The match stage: for every interval the groups that morph together, each with its tile, its level sets below and above, and the
//! parts that begin or end there.

use rayon::prelude::*;

use crate::backend::jobs::PartJob;
use crate::contour::Contour;
use crate::contour::direction::Direction;
use crate::contour::open_part::OpenPart;
use crate::contour::overlap::{DecidedPairs, Group, match_components};
use crate::contour::unmatched::LonePart;
use crate::grid::components::label8;
use crate::grid::field::Field;
use crate::grid::seen::Seen;
use crate::grid::tile::Tile;
use crate::pipeline::hole_tiles::HoleTiles;
use crate::report::Event;
use crate::storage::spill::{Array, Large};

/// Bytes of the tiles of parts and holes that are asked for together; those of groups are as large as their parts and count by the image.
pub(crate) const ASKED_BYTES: usize = 64 << 20;

/// Bytes that a small part or hole takes while its distances are asked for: a tile with twice the margin, the contour's field, the part's pixels and the
/// answer on it.
pub(crate) fn asked_bytes(margin: [usize; 2]) -> usize {
    margin.iter().map(|m| 1 + 4 * m).product::<usize>() * (2 * size_of::<f64>() + size_of::<bool>())
}

/// Bytes that it takes afterwards: its distances on a tile with the margin.
pub(crate) fn kept_bytes(margin: [usize; 2]) -> usize {
    margin.iter().map(|m| 1 + 2 * m).product::<usize>() * size_of::<f64>()
}

/// An interval's groups and unmatched parts.
#[derive(Debug, Clone, Default)]
pub struct Interval {
    /// Groups that morph.
    pub groups: Vec<GroupFields>,
    /// Solid parts without partner.
    pub lone: Vec<LonePart>,
    /// Changes of the topology on the way up.
    pub events: Vec<Event>,
}

impl Large for Interval {
    fn arrays(&mut self) -> Vec<Array<'_>> {
        let mut arrays: Vec<Array<'_>> = Vec::new();
        let mut lone: Vec<&mut LonePart> = self.lone.iter_mut().collect();
        for group in &mut self.groups {
            for end in [&mut group.low, &mut group.high] {
                arrays.extend([&mut end.phi.data as Array<'_>, &mut end.seeds]);
            }
            lone.extend(&mut group.holes);
        }
        arrays.extend(lone.into_iter().flat_map(|part| [&mut part.field.data as Array<'_>, &mut part.seeds]));
        arrays
    }
}

/// A group on its tile.
#[derive(Debug, Clone)]
pub struct GroupFields {
    /// Members and anchors (nodes of the padded image).
    pub group: Group,
    /// Tile on which it lies.
    pub tile: Tile,
    /// Level set below, of the two that morph into each other: the group's components with all dying holes filled.
    pub low: MorphEnd,
    /// Its counterpart above.
    pub high: MorphEnd,
    /// Holes that open or close between the contours; their fields are negative inside the hole.
    pub holes: Vec<LonePart>,
}

impl GroupFields {
    /// The anchors in the tile's own pixels; the padded image is `nx` wide.
    pub fn local_anchors(&self, nx: usize) -> Vec<usize> {
        self.group.anchors.iter().filter_map(|&anchor| self.tile.local_node(anchor, nx)).collect()
    }
}

/// One end of a group's morph.
#[derive(Debug, Clone)]
pub struct MorphEnd {
    /// Level set on the tile.
    pub phi: Field,
    /// Seeds of the contour that take part, by number.
    pub seeds: Vec<u32>,
}

/// Questions of one group to the backend, before it has answered.
struct Plan {
    group: Group,
    tile: Tile,
    seeds: [Vec<u32>; 2],
    holes: Vec<(Direction, HolePlan)>,
    jobs: Vec<PartJob>,
}

/// A hole that ends, before the backend has answered.
struct HolePlan {
    /// Its seeds, by number.
    seeds: Vec<u32>,
    tiles: HoleTiles,
}

impl HolePlan {
    /// The hole of the distances on its tile, in a group on `tile`.
    fn finish(self, answer: &Field, tile: Tile, direction: Direction) -> LonePart {
        LonePart::new(self.tiles.kept.placed(tile), self.tiles.of_answer(answer), self.seeds, direction)
    }
}

/// Questions of an interval to the backend: its groups and its lone parts.
#[derive(Default)]
pub struct IntervalPlan {
    plans: Vec<Plan>,
    lone: [LonePlan; 2],
    events: Vec<Event>,
}

impl IntervalPlan {
    /// Matches the components of two neighbouring contours. Tiles have `margin` pixels around the parts, in means what is `known` counts.
    pub fn new(low: &Contour, high: &Contour, decided: &DecidedPairs, margin: [usize; 2], known: &Seen) -> Self {
        let matching = match_components((&low.solids, &low.phi), (&high.solids, &high.phi), decided);
        let events = matching.events();
        // Pairs that are kept apart may touch at a corner.
        let matching = match decided.parted.is_empty() {
            true => matching.joined_at_corners([&low.solids, &high.solids], low.phi.dims[0]),
            false => matching,
        };
        let plans = matching.groups.into_par_iter().map(|group| plan_group(low, high, group, margin)).collect();
        let lone = [
            LonePlan::new(low, &matching.deaths, margin, Direction::Up, known),
            LonePlan::new(high, &matching.births, margin, Direction::Down, known),
        ];
        IntervalPlan { plans, lone, events }
    }

    /// Takes the jobs out, in the order in which [`IntervalPlan::finish`] wants their fields.
    pub fn take_jobs(&mut self) -> Vec<PartJob> {
        let groups = self.plans.iter_mut().flat_map(|p| std::mem::take(&mut p.jobs));
        let lone = self.lone.iter_mut().flat_map(|l| std::mem::take(&mut l.jobs));
        groups.chain(lone).collect()
    }

    /// The interval, from the fields of its jobs.
    pub fn finish(self, fields: &mut impl Iterator<Item = Field>) -> Interval {
        let mut groups = Vec::new();
        for plan in self.plans {
            let (Some(low_phi), Some(high_phi)) = (fields.next(), fields.next()) else { continue };
            let holes: Vec<LonePart> = fields
                .take(plan.holes.len())
                .zip(plan.holes)
                .map(|(field, (direction, hole))| hole.finish(&field, plan.tile, direction))
                .collect();
            let [low_seeds, high_seeds] = plan.seeds;
            groups.push(GroupFields {
                group: plan.group,
                tile: plan.tile,
                low: MorphEnd { phi: low_phi, seeds: low_seeds },
                high: MorphEnd { phi: high_phi, seeds: high_seeds },
                holes,
            });
        }
        let lone = self.lone.into_iter().flat_map(|l| l.finish(fields)).collect();
        Interval { groups, lone, events: self.events }
    }
}

/// Solid part of a contour, by itself on its own tile.
struct LoneTile {
    tile: Tile,
    /// Its seeds; those that count in means come first.
    seeds: Vec<u32>,
    /// How many of them count.
    counted: usize,
    open: Option<OpenPart>,
}

/// Solid parts of a contour, each by itself on its own tile, before the backend has answered.
#[derive(Default)]
pub(super) struct LonePlan {
    direction: Direction,
    parts: Vec<LoneTile>,
    jobs: Vec<PartJob>,
    known: Seen,
}

impl LonePlan {
    /// The given parts of a contour.
    pub fn new(contour: &Contour, parts: &[u32], margin: [usize; 2], direction: Direction, known: &Seen) -> Self {
        let nx = contour.phi.dims[0];
        let plan = |&part: &u32| {
            let tile = contour.tile_of(&[part], margin);
            let inside: Vec<bool> = tile.map(&contour.solids.labels, nx, |label| *label == part);
            let open = OpenPart::of(&inside, &tile, known);
            let inside = open.as_ref().map(|open| open.opened(&inside)).unwrap_or(inside);
            let seeds = (0..).zip(&contour.seeds).filter(|(_, s)| contour.solids.labels[s.inside] == part);
            let pixel = |seed: u32| contour.seeds[seed as usize].inside;
            let (seeds, counted) = known.first(seeds.map(|(k, _)| k).collect(), nx, pixel);
            (LoneTile { tile, seeds, counted, open }, PartJob { whole: tile.cut(&contour.phi), inside })
        };
        let (parts, jobs) = parts.par_iter().map(plan).unzip();
        LonePlan { direction, parts, jobs, known: known.clone() }
    }

    /// What the backend is asked for; once.
    pub fn take_jobs(&mut self) -> Vec<PartJob> {
        std::mem::take(&mut self.jobs)
    }

    /// The parts with the backend's answers, the next of `fields`.
    pub fn finish(self, fields: &mut impl Iterator<Item = Field>) -> Vec<LonePart> {
        let part = |(LoneTile { tile, seeds, counted, open }, mut field): (LoneTile, Field)| {
            let Some(open) = open else {
                return LonePart { counted, ..LonePart::new(tile, field, seeds, self.direction) };
            };
            open.end(&mut field);
            let seen = -self.known.on(&tile, &field.data).fold(0.0, f64::min);
            let part = LonePart::new(tile, field, seeds, self.direction);
            LonePart { counted, open: true, depth: if seen > 0.0 { seen } else { part.depth }, ..part }
        };
        let fields = fields.take(self.parts.len());
        self.parts.into_iter().zip(fields).map(part).collect()
    }
}

fn plan_group(low: &Contour, high: &Contour, group: Group, margin: [usize; 2]) -> Plan {
    let tile = low.tile_of(&group.low, margin).joined(high.tile_of(&group.high, margin));
    let nx = low.phi.dims[0];
    let members = |c: &Contour, ids: &[u32]| -> Vec<bool> {
        let mut wanted = vec![false; c.solids.count + 1];
        ids.iter().for_each(|&k| wanted[k as usize] = true);
        tile.map(&c.solids.labels, nx, |label| wanted[*label as usize])
    };
    let (low_inside, high_inside) = (members(low, &group.low), members(high, &group.high));
    let (low_end, low_holes) = fill_dying_holes(low, &group.low, &tile, margin, &low_inside, &high_inside);
    let (high_end, high_holes) = fill_dying_holes(high, &group.high, &tile, margin, &high_inside, &low_inside);
    let mut jobs = vec![low_end.job, high_end.job];
    let mut holes = Vec::new();
    for (direction, parts) in [(Direction::Up, low_holes), (Direction::Down, high_holes)] {
        for (job, hole) in parts {
            jobs.push(job);
            holes.push((direction, hole));
        }
    }
    Plan { group, tile, seeds: [low_end.seeds, high_end.seeds], holes, jobs }
}

struct EndPlan {
    job: PartJob,
    seeds: Vec<u32>,
}

/// A group's end with those holes filled that meet no background of the other end, and these holes.
fn fill_dying_holes(
    contour: &Contour,
    ids: &[u32],
    tile: &Tile,
    margin: [usize; 2],
    inside: &[bool],
    other: &[bool],
) -> (EndPlan, Vec<(PartJob, HolePlan)>) {
    let outside: Vec<bool> = inside.iter().map(|m| !m).collect();
    let background = label8(&outside, tile.dims);
    let mut lives = vec![false; background.count + 1];
    for (label, other) in background.labels.iter().zip(other) {
        lives[*label as usize] |= !other;
    }
    let dies = |label: u32| label > 0 && !lives[label as usize];
    let mut seeds = Vec::new();
    let mut hole_seeds: Vec<Vec<u32>> = vec![Vec::new(); background.count + 1];
    for (k, seed) in (0..).zip(&contour.seeds) {
        if ids.binary_search(&contour.solids.labels[seed.inside]).is_err() {
            continue;
        }
        let hole = tile.local_node(seed.outside, contour.phi.dims[0]).map_or(0, |n| background.labels[n]);
        if dies(hole) {
            hole_seeds[hole as usize].push(k);
        } else {
            seeds.push(k);
        }
    }
    let whole = tile.cut(&contour.phi);
    let filled = inside.iter().zip(&background.labels).map(|(&m, &l)| m || dies(l)).collect();
    let tiles = HoleTiles::of(&background, tile.dims, margin, [0; 2]);
    let holes = (1..=background.count as u32)
        .filter(|&l| dies(l))
        .map(|l| {
            let (tiles, seeds) = (tiles[l as usize], std::mem::take(&mut hole_seeds[l as usize]));
            (tiles.job(&whole, |n| background.labels[n] == l), HolePlan { seeds, tiles })
        })
        .collect();
    (EndPlan { job: PartJob { whole, inside: filled }, seeds }, holes)
}
