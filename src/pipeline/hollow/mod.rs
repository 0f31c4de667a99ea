//! Walls of hollow parts that miss each other where what they enclose does not.
//!
//! A wall is thin. Where a tube leans, its wall is in one slice where the hole of the next is, or beyond it, and neither overlaps nor particles nor a displacement say
//! which piece of the wall becomes which: the wall is torn between the slices. Filled the sections overlap well, and so do the holes. So where walls overlap by far less
//! than what they enclose layers are made of both: filled sections and holes as the field method has them where nothing moves, the one less the other.
//! They are drawn into the layers before fairing, whatever the method; the wall that is there stays, but for what lies within the hole.

pub(super) mod slice;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use self::slice::{HollowSlice, HollowSlices};
use super::context::{Context, time};
use super::links::IntervalLinks;
use super::section::NEIGHBOURS;
use crate::backend::jobs::PartJob;
use crate::backend::requests::{LayerRequest, PartRequest, SlopeRequest};
use crate::contour::Contour;
use crate::contour::overlap::{DecidedPairs, Group, match_components};
use crate::error::Result;
use crate::grid::field::{Field, position};
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::grid::union::{take_out, unite_packed};
use crate::progress::Silent;
use crate::registration::displacement::Displacement;
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;
use crate::registration::motion_stack::MotionStack;
use crate::storage::spill::SpillVec;
use crate::surface::Layer;

/// Walls miss each other if their Dice coefficient is less than this times that of what they enclose. What 26 bodies (coils, guts, airways, leaning tubes, tori,
/// a bottle, a shell, trabeculae, gyroids, pores) gain in Dice every 2nd and 6th slice: .0002 and .0255 with .8, .0002 and .0270 with .9, -.0004 and .0272
/// with 1.
const MISSES: f64 = 0.9;
/// Share of what a tube encloses that its largest hole has, at least: of a sponge each hole has little. Without it a gyroid every 6th slice loses .008, and
/// airways gain .005 and .012 more.
const LUMEN: f64 = 0.5;
/// Share of the smaller one of both largest holes that they have in common, at least. Without it a hollow torus that lies flat, every 4th slice, loses .014:
/// above both walls lies their roof.
const MEET: f64 = 0.1;
/// Filled parts and holes end as their distances say.
static NOTHING_ENDS: LoneParts = LoneParts { low: Vec::new(), high: Vec::new(), empty: false };

/// Hollow parts of a stack whose walls miss each other, drawn into layers that come in order of height.
pub(super) struct Hollows<'r, 'b> {
    run: &'r Context<'b>,
    contours: &'r SpillVec<'b, Contour>,
    moving: &'r MotionStack<'b>,
    /// Pairs of parts of every interval that are kept apart.
    parted: Vec<Vec<(u32, u32)>>,
    /// Those of the interval of the layers that come.
    current: Vec<Hollow>,
}

impl<'r, 'b> Hollows<'r, 'b> {
    pub fn new(
        run: &'r Context<'b>,
        links: &[IntervalLinks],
        contours: &'r SpillVec<'b, Contour>,
        moving: &'r MotionStack<'b>,
    ) -> Self {
        let parted = links.iter().map(IntervalLinks::parted).collect();
        Hollows { run, contours, moving, parted, current: Vec::new() }
    }

    /// Draws into the next layer what is hollow there.
    ///
    /// # Errors
    /// The errors of the backend and of the shelves.
    pub fn draw(&mut self, layer: &mut Layer, slices: &mut HollowSlices<'_, '_>) -> Result<()> {
        if let Some(i) = layer.contour {
            self.current = self.interval(i, slices)?;
            return Ok(());
        }
        let Some(hollow) = self.current.first() else { return Ok(()) };
        let times = [time(layer.z, hollow.z[0], hollow.z[1])];
        let requests = self.current.iter().flat_map(|hollow| &hollow.bodies).map(|body| body.request(self.run, &times));
        let made = self.run.backend.moving_layers(&requests.collect::<Vec<_>>())?;
        let bodies: Vec<SparseImage<f32>> = made.into_iter().flatten().collect();
        for (hollow, bodies) in self.current.iter().zip(bodies.chunks_exact(2)) {
            hollow.draw(self.run, bodies, &mut layer.phi);
        }
        Ok(())
    }

    /// The hollow parts between contour `i` and the next whose walls miss each other.
    fn interval(&self, i: usize, slices: &mut HollowSlices<'_, '_>) -> Result<Vec<Hollow>> {
        let has_holes = |k: usize| self.contours.light(k).holes > 0;
        if i + 1 == self.contours.len() || !has_holes(i) || !has_holes(i + 1) {
            return Ok(Vec::new());
        }
        let contours = [self.contours.get(i)?, self.contours.get(i + 1)?];
        let own = [slices.get(i)?, slices.get(i + 1)?];
        let [low, high] = [0, 1].map(|k| (&own[k].filled, &contours[k].phi));
        let groups = match_components(low, high, &DecidedPairs::parting(self.parted[i].clone())).groups;
        let at_slices = self.moving.at_slices(i)?;
        let sides = [0, 1].map(|k| (&*contours[k], &*own[k]));
        let tile = |group: &Group, margin: [usize; 2]| {
            contours[0].tile_of(&group.low, margin).joined(contours[1].tile_of(&group.high, margin))
        };
        let torn = groups.into_iter().filter(|group| miss(sides, &at_slices, group, tile(group, [0; 2])));
        let torn: Vec<Group> = torn.collect();
        torn.iter().map(|group| self.hollow(i, group, tile(group, self.run.margin), slices)).collect()
    }

    /// A group of the parts of contour `i` and the next, as filled sections and holes.
    fn hollow(&self, i: usize, group: &Group, tile: Tile, slices: &mut HollowSlices<'_, '_>) -> Result<Hollow> {
        let mut parts = BTreeMap::new();
        for (k, of) in [(i, &group.low), (i + 1, &group.high)] {
            parts.insert(k, of.iter().copied().collect::<BTreeSet<u32>>());
        }
        // What they come from and become.
        for (from, to) in self.beyond(i) {
            let own = match parts.get(&from) {
                Some(own) if self.contours.light(to).solids.count > 0 => own,
                _ => continue,
            };
            let found = over(own, &slices.get(from)?.filled.labels, &slices.get(to)?.filled.labels);
            if !found.is_empty() {
                parts.insert(to, found);
            }
        }
        let mut bodies = [BTreeMap::new(), BTreeMap::new()];
        for (k, parts) in parts {
            let (contour, slice) = (self.contours.get(k)?, slices.get(k)?);
            let filled = job(&contour.phi, &slice.filled.labels, &parts, tile, 1.0);
            let holes = job(&contour.phi, &slice.holes.labels, &slice.holes_of(&parts), tile, -1.0);
            for (body, job) in bodies.iter_mut().zip([filled, holes]) {
                body.extend(job.map(|job| (k, job)));
            }
        }
        let [filled, holes] = bodies;
        let z = [i, i + 1].map(|k| self.contours.light(k).z);
        Ok(Hollow { tile, z, bodies: [self.body(i, filled)?, self.body(i, holes)?] })
    }

    /// Slices beyond interval `i` that its layers read, each after the one that it lies beside.
    fn beyond(&self, i: usize) -> Vec<(usize, usize)> {
        let below = (i.saturating_sub(NEIGHBOURS)..i).rev().map(|k| (k + 1, k));
        let above = (i + 2..(i + 2 + NEIGHBOURS).min(self.contours.len())).map(|k| (k - 1, k));
        below.chain(above).collect()
    }

    /// A body of the parts of some slices, of which those that lie beside each other and interval `i` count.
    fn body(&self, i: usize, mut jobs: BTreeMap<usize, PartJob>) -> Result<Body> {
        let first = (0..=i).rev().take_while(|k| jobs.contains_key(k)).last().unwrap_or(i);
        let end = (i + 1..).take_while(|k| jobs.contains_key(k)).last().unwrap_or(i + 1) + 1;
        let jobs: Vec<PartJob> = (first..end).filter_map(|k| jobs.remove(&k)).collect();
        let fields = self.run.backend.part_fields(&PartRequest { jobs: &jobs, h: self.run.h })?;
        let still = Arc::new(Displacement::zero(jobs.first().map_or([0; 2], |job| job.whole.dims)));
        let both = Arc::new([(); 2].map(|()| (*still).clone()));
        let slices: Range<usize> = first..end;
        let moving = MotionField {
            fields: fields.into_iter().map(Arc::new).collect(),
            displacements: vec![still.clone(); slices.len() - 1],
            at_slices: vec![both.clone(); slices.len() - 1],
            through_middle: vec![both; slices.len() - 1],
            rates: vec![still; slices.len()],
            ..self.moving.frame(slices)?
        };
        let interval = i - first;
        let wanted = interval..interval + 2;
        let slopes = self.run.backend.moving_slopes(&SlopeRequest { moving: &moving, wanted }, &Silent)?;
        Ok(Body { moving, interval, slopes: slopes.into_iter().map(Arc::new).collect() })
    }
}

/// A question for the distances of some parts on a tile, of a contour that is turned inside out by a `sign` of -1; none where they do not reach the tile, as
/// nothing is finite there.
fn job(phi: &Field, labels: &[u32], parts: &BTreeSet<u32>, tile: Tile, sign: f64) -> Option<PartJob> {
    let inside: Vec<bool> = tile.nodes(phi.dims[0]).map(|n| parts.contains(&labels[n])).collect();
    inside.contains(&true).then(|| {
        let mut whole = tile.cut(phi);
        whole.data.iter_mut().for_each(|v| *v *= sign);
        PartJob { whole, inside }
    })
}

/// The parts that lie over some others.
fn over(own: &BTreeSet<u32>, from: &[u32], to: &[u32]) -> BTreeSet<u32> {
    from.iter().zip(to).filter(|(a, b)| **b > 0 && own.contains(a)).map(|(_, b)| *b).collect()
}

/// Whether both sides of a group are tubes whose walls miss each other, where motion brings them, beside what they enclose.
fn miss(sides: [(&Contour, &HollowSlice); 2], at_slices: &[Displacement; 2], group: &Group, tile: Tile) -> bool {
    let parts: [BTreeSet<u32>; 2] = [&group.low, &group.high].map(|parts| parts.iter().copied().collect());
    let holes = [0, 1].map(|k| sides[k].1.holes_of(&parts[k]));
    if holes.iter().any(BTreeSet::is_empty) {
        return false;
    }
    let nx = sides[0].0.phi.dims[0];
    let (mut filled, mut enclosed, mut walls) = (Shared::default(), Shared::default(), Shared::default());
    // Pixels of every hole, and of every pair.
    let mut areas = [BTreeMap::new(), BTreeMap::new()];
    let mut common = BTreeMap::new();
    for n in tile.nodes(nx) {
        filled.count([0, 1].map(|k| parts[k].contains(&sides[k].1.filled.labels[n])));
        let hole = [0, 1].map(|k| sides[k].1.holes.labels[n]);
        let within = [0, 1].map(|k| holes[k].contains(&hole[k]));
        enclosed.count(within);
        (0..2).filter(|k| within[*k]).for_each(|k| *areas[k].entry(hole[k]).or_insert(0usize) += 1);
        if within == [true; 2] {
            *common.entry(hole).or_insert(0usize) += 1;
        }
        for (k, sign) in [(0, 1.0), (1, -1.0)] {
            let (own, slice) = sides[k];
            if own.phi.data[n] < 0.0 && parts[k].contains(&slice.filled.labels[n]) {
                let x = position(n, nx);
                let there = x + sign * at_slices[k].at(x);
                walls.all += 1;
                walls.both += usize::from(sides[1 - k].0.phi.sample(there) < 0.0);
            }
        }
    }
    let largest = areas.map(|areas| areas.into_iter().max_by_key(|(hole, area)| (*area, u32::MAX - hole)));
    let [Some(low), Some(high)] = largest else { return false };
    let lumen = |areas: usize, of_side: usize| areas as f64 >= LUMEN * of_side as f64;
    let meet = common.get(&[low.0, high.0]).copied().unwrap_or(0) as f64 >= MEET * low.1.min(high.1) as f64;
    lumen(low.1, enclosed.each[0])
        && lumen(high.1, enclosed.each[1])
        && meet
        && walls.dice() < MISSES * filled.dice().min(enclosed.dice())
}

/// Pixels of two slices, and those that both have.
#[derive(Default)]
struct Shared {
    each: [usize; 2],
    all: usize,
    both: usize,
}

impl Shared {
    /// A pixel that is of the one slice and of the other or not.
    fn count(&mut self, of: [bool; 2]) {
        let both = of == [true; 2];
        (0..2).filter(|k| of[*k]).for_each(|k| {
            self.each[k] += 1;
            self.all += 1;
            self.both += usize::from(both);
        });
    }

    /// The Dice coefficient: the share of pixels that the other slice has, too.
    fn dice(&self) -> f64 {
        self.both as f64 / self.all.max(1) as f64
    }
}

/// A body between two slices on a tile.
struct Body {
    moving: MotionField,
    /// Number of the interval.
    interval: usize,
    slopes: Vec<Arc<Field>>,
}

impl Body {
    /// Asks for its distances at these times, px.
    fn request<'b>(&'b self, run: &Context<'_>, times: &'b [f64]) -> LayerRequest<'b> {
        LayerRequest {
            moving: &self.moving,
            interval: self.interval,
            slopes: [&self.slopes[0], &self.slopes[1]],
            lone: &NOTHING_ENDS,
            times,
            limit: run.settings.margin() as f64,
            h: run.h,
            wanted: None,
        }
    }
}

/// Hollow parts of two slices.
struct Hollow {
    tile: Tile,
    /// Heights of the slices.
    z: [f64; 2],
    /// The parts filled, and the holes.
    bodies: [Body; 2],
}

impl Hollow {
    /// Unites a layer with what is filled there less the holes, of both `bodies`.
    fn draw(&self, run: &Context<'_>, bodies: &[SparseImage<f32>], phi: &mut SparseImage<f32>) {
        let [filled, holes] = bodies else { return };
        let (tile, dims, px) = (self.tile, phi.dims(), run.px as f32);
        let offset = [0, 1].map(|a| run.pad[a] as isize - tile.origin[a] as isize);
        let covered: [Range<usize>; 2] = [0, 1].map(|a| {
            let from = tile.origin[a].saturating_sub(run.pad[a]).min(dims[a]);
            from..(tile.origin[a] + tile.dims[a]).saturating_sub(run.pad[a]).clamp(from, dims[a])
        });
        let change = |v: f32| if v * px == 0.0 { f32::MIN_POSITIVE } else { v * px };
        unite_packed(phi, covered.clone(), offset, filled, change);
        take_out(phi, covered, |from, out| {
            let [i, j] = [0, 1].map(|a| (from[a] as isize + offset[a]) as usize);
            holes.read(i, j, out);
            out.iter_mut().for_each(|v| *v = change(*v));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    const DIMS: [usize; 2] = [80, 60];

    /// Discs with holes of these radii.
    fn contour(discs: &[([f64; 2], f64)], holes: &[([f64; 2], f64)]) -> Contour {
        let value = |i: usize, j: usize| {
            let away = |[x, y]: [f64; 2]| libm::hypot(i as f64 - x, j as f64 - y);
            let solid = discs.iter().fold(f64::INFINITY, |v, (at, r)| v.min(away(*at) - r));
            holes.iter().fold(solid, |v, (at, r)| v.max(r - away(*at)))
        };
        Contour::new(0.0, Field::from_fn(DIMS, value), [1.0; 2], 1.0)
    }

    fn ring(x: f64, wall: f64) -> Contour {
        contour(&[([x, 30.0], 16.0)], &[([x, 30.0], 16.0 - wall)])
    }

    /// Whether the walls of two contours, each of one part, miss each other where this brings the one to the other.
    fn missed(low: &Contour, high: &Contour, moves: DVec2) -> bool {
        let v = Displacement::zero(DIMS).map(|_, _, _| moves);
        let slices = [low, high].map(HollowSlice::new);
        let group = Group { low: vec![1], high: vec![1], anchors: Vec::new() };
        let sides = [(low, &slices[0]), (high, &slices[1])];
        miss(sides, &[v.clone(), v], &group, Tile::all(DIMS))
    }

    #[test]
    fn walls_miss_each_other_that_lie_beside_by_more_than_their_width_unless_motion_brings_them_together() {
        let (low, high) = (ring(34.0, 2.5), ring(41.0, 2.5));
        assert!(missed(&low, &high, DVec2::ZERO) && missed(&high, &low, DVec2::ZERO));
        assert!(!missed(&low, &high, DVec2::new(7.0, 0.0)));
        assert!(!missed(&ring(34.0, 9.0), &ring(41.0, 9.0), DVec2::ZERO), "thick");
        assert!(!missed(&ring(34.0, 2.5), &ring(34.2, 2.5), DVec2::ZERO), "near");
        assert!(!missed(&low, &contour(&[([41.0, 30.0], 16.0)], &[]), DVec2::ZERO), "the hole ends");
    }

    #[test]
    fn what_does_not_reach_a_tile_is_not_asked_for() {
        let low = ring(34.0, 2.5);
        let slice = HollowSlice::new(&low);
        let job = |x: usize, parts: &BTreeSet<u32>, labels: &[u32]| {
            job(&low.phi, labels, parts, Tile { origin: [x, 20], dims: [8, 20] }, 1.0)
        };
        let own = BTreeSet::from([1]);
        assert!(job(30, &own, &slice.filled.labels).is_some() && job(60, &own, &slice.filled.labels).is_none());
        assert!(job(44, &own, &slice.holes.labels).is_some() && job(49, &own, &slice.holes.labels).is_none());
        assert!(job(30, &BTreeSet::new(), &slice.filled.labels).is_none());
    }

    #[test]
    fn walls_of_a_sponge_and_around_another_hole_do_not_miss() {
        let cells = |off: f64| {
            [[-7.0, -7.0], [7.0, -7.0], [-7.0, 7.0], [7.0, 7.0]].map(|[x, y]| ([34.0 + off + x, 30.0 + y], 5.8))
        };
        let sponge = |off: f64| contour(&[([34.0 + off, 30.0], 17.0)], &cells(off));
        assert!(!missed(&sponge(0.0), &sponge(5.0), DVec2::ZERO));
        // A torus that lies flat: two walls around each other, and above them their roof.
        let value = |i: usize, j: usize, walls: &[[f64; 2]]| {
            let r = libm::hypot(i as f64 - 40.0, j as f64 - 30.0);
            walls.iter().map(|[from, to]| (r - to).max(from - r)).fold(f64::INFINITY, f64::min)
        };
        let rings =
            |walls: &[[f64; 2]]| Contour::new(0.0, Field::from_fn(DIMS, |i, j| value(i, j, walls)), [1.0; 2], 1.0);
        let (walls, roof) = (rings(&[[14.5, 16.6], [24.2, 26.4]]), rings(&[[17.0, 23.8]]));
        assert!(!missed(&walls, &roof, DVec2::ZERO) && !missed(&roof, &walls, DVec2::ZERO), "holes that do not meet");
    }
}
