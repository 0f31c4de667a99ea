//! The parts of the first or last contour, and their areas in the contours next to it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use glam::DVec2;
use rayon::prelude::*;

use crate::backend::Backend;
use crate::backend::jobs::PartJob;
use crate::backend::requests::PartRequest;
use crate::contour::Contour;
use crate::contour::offsets::{OUT, Offsets, area};
use crate::contour::open_part::OpenPart;
use crate::error::Result;
use crate::grid::components::{Components, label8};
use crate::grid::field::{Field, VALUES_OF_A_THREAD, position};
use crate::grid::seen::Seen;
use crate::grid::tile::{Tile, samples};
use crate::pipeline::hole_tiles::HoleTiles;
use crate::registration::displacement::Displacement;

/// Region that a closed line encloses: a part with its holes filled, or one of its holes.
#[derive(Debug, Clone)]
pub struct Region {
    /// Tile on which it lies: the part's, a hole's own.
    pub tile: Tile,
    /// Signed distance on it, negative within; far off where the course of a contour ends that goes on beyond what is known.
    pub field: Field,
    /// Its areas once the line is drawn in or out.
    pub offsets: Offsets,
    /// Seeds on the line, by number; those that count in means come first.
    pub seeds: Vec<u32>,
    /// Number of those.
    counted: usize,
    /// Its area in the end contour and in those farther inward that have a say, as long as there is a counterpart that is its alone, px squared; 0 in the
    /// contour behind which a hole begins.
    pub areas: Vec<f64>,
}

impl Region {
    /// Seeds that count in means.
    pub fn counted(&self) -> &[u32] {
        &self.seeds[..self.counted]
    }
}

/// A part of an end contour.
#[derive(Debug, Clone)]
pub struct EndPart {
    /// Component number.
    pub number: u32,
    /// Tile on which it lies.
    pub tile: Tile,
    /// Part without its holes.
    pub outline: Region,
    /// Its holes.
    pub holes: Vec<Region>,
}

/// The end contour, outermost, and those next to it.
pub struct Levels<'a> {
    /// At least the outermost.
    pub contours: Vec<Arc<Contour>>,
    /// Which of them have a say in how the body ends.
    pub says: Vec<bool>,
    /// Way from each contour but the last to the next one inward: displacement at its pixels, with a sign. None where nothing moves.
    pub ways: Vec<Option<(Displacement, f64)>>,
    /// Pixel sides.
    pub h: [f64; 2],
    /// Margin of tiles, px.
    pub margin: [usize; 2],
    /// Pixels that count in areas: those in which contours are known. What goes on beyond them is drawn in from its contours alone.
    pub known: &'a Seen,
    /// Pixels that count in areas of a part that has no contour in these.
    pub seen: &'a Seen,
    /// Backend that computes distances.
    pub backend: &'a dyn Backend,
    /// Bytes of the parts whose distances are asked for together, but for those of one contour: see [`TOGETHER`].
    pub together: usize,
}

/// Bytes of the parts whose distances are asked for together where memory is not bounded: the contour's distances, the part's pixels and the answer.
pub(crate) const TOGETHER: usize = 16 << 20;
const BYTES_OF_PIXEL: usize = 2 * size_of::<f64>() + size_of::<bool>();

/// Pairs of what meets, in order.
type Met = Vec<(u32, u32)>;

/// A part with its holes told apart.
struct Told {
    number: u32,
    tile: Tile,
    /// Number for each of the tile's pixels: 0 for the part and what is around it, else the hole.
    holes: Vec<u32>,
    count: usize,
    /// The part without holes, then its holes: their tiles, and distances on them.
    tiles: Vec<Tile>,
    fields: Vec<Field>,
    /// Nothing but what closes the part beyond what is known is a contour of it.
    walled: bool,
}

impl Told {
    /// Area of one of its lines.
    fn area(&self, line: usize, seen: &Seen) -> f64 {
        area(seen.on(&self.tiles[line], &self.fields[line].data))
    }
}

impl Levels<'_> {
    /// All parts of the end contour.
    ///
    /// # Errors
    /// The errors of the backend.
    pub fn parts(&self) -> Result<Vec<EndPart>> {
        let own = &self.contours[0];
        let (asked, solids_met) = self.followed();
        let mut known = VecDeque::new();
        let mut told = self.told(0, &asked, &mut known)?;
        // Of what lies beyond the border alone nothing is seen.
        told.retain(|part| part.area(0, self.known) > 0.0);
        let mut parts: Vec<EndPart> = told.par_iter().map(|part| self.part(part)).collect();
        // The parts of the contour at hand that each end part has come to; none from where others have a share in them.
        let mut now: Vec<Vec<u32>> = parts.iter().map(|part| vec![part.number]).collect();
        // The holes of the contour at hand, by the pixels of the padded image, and which hole of which end part each is.
        let mut holes = HoleMap::new(own, &told, self.known);
        let counts: Vec<&Seen> = told.iter().map(|part| self.counts(part)).collect();
        let mut traced: Vec<(usize, usize)> =
            parts.iter().enumerate().flat_map(|(p, part)| (0..part.holes.len()).map(move |k| (p, k))).collect();
        for (level, pair) in self.contours.windows(2).enumerate() {
            now.iter_mut().for_each(|of| *of = alone(of, &solids_met[level]));
            let mut told = self.told(level + 1, &asked, &mut known)?;
            let numbers: Vec<u32> = now.iter().flatten().copied().collect();
            told.retain(|part| numbers.contains(&part.number));
            let inner: BTreeMap<u32, &Told> = told.iter().map(|part| (part.number, part)).collect();
            let traced_on = parts.iter_mut().zip(&now).zip(&counts).filter(|((_, numbers), _)| !numbers.is_empty());
            let says = self.says[level + 1];
            for ((part, numbers), counts) in traced_on.filter(|_| says) {
                part.outline.areas.push(numbers.iter().map(|n| inner[n].area(0, counts)).sum());
            }
            let next = HoleMap::new(&pair[1], &told, self.known);
            let met = self.met(level, |a| holes.at(a), |b| next.at(b));
            // Holes that meet no matter everywhere.
            let solids = &pair[1].solids.labels;
            let open = self.met(level, |a| holes.at(a), |b| u32::from(solids[b] == 0));
            let mut found = vec![(usize::MAX, 0); next.areas.len()];
            for (number, &(p, k)) in (1..).zip(&traced).filter(|(_, hole)| hole.0 != usize::MAX) {
                let mut area = None;
                if let [counterpart] = alone(&[number], &met)[..] {
                    area = Some(next.areas[counterpart as usize - 1]);
                    found[counterpart as usize - 1] = (p, k);
                } else if !now[p].is_empty() && open.binary_search(&(number, 1)).is_err() {
                    // It begins behind the part's next contour.
                    area = Some(0.0);
                }
                parts[p].holes[k].areas.extend(area.filter(|_| says));
            }
            (holes, traced) = (next, found);
        }
        Ok(parts)
    }

    /// Pixels that count in areas of a part.
    fn counts(&self, part: &Told) -> &Seen {
        if part.walled { self.seen } else { self.known }
    }

    /// Pairs that meet on known pixels, from contour `level` to the next one inward: pairs of what `here` and `there` say of their pixels, but none
    /// with 0, in order.
    fn met(
        &self,
        level: usize,
        here: impl Fn(usize) -> u32 + Sync,
        there: impl Fn(usize) -> u32 + Sync,
    ) -> Vec<(u32, u32)> {
        let [nx, ny] = self.contours[level].phi.dims;
        let row = |mut pairs: BTreeSet<(u32, u32)>, row: usize| {
            let known = (row * nx..(row + 1) * nx).filter(|node| self.known.has(*node, nx));
            for (node, a) in known.map(|node| (node, here(node))).filter(|(_, a)| *a > 0) {
                let x = position(node, nx);
                let DVec2 { x: i, y: j } =
                    self.ways[level].as_ref().map_or(x, |(way, sign)| (x + *sign * way.at(x)).round());
                if i >= 0.0 && j >= 0.0 && i < nx as f64 && j < ny as f64 {
                    let to = j as usize * nx + i as usize;
                    let b = there(to);
                    if b > 0 && self.known.has(to, nx) {
                        pairs.insert((a, b));
                    }
                }
            }
            pairs
        };
        let both = |mut pairs: BTreeSet<(u32, u32)>, mut more| {
            pairs.append(&mut more);
            pairs
        };
        let rows = (0..ny).into_par_iter().with_min_len(VALUES_OF_A_THREAD.div_ceil(nx.max(1)));
        rows.fold(BTreeSet::new, row).reduce(BTreeSet::new, both).into_iter().collect()
    }

    /// The parts of the end contour, and contour by contour those that they come to; and which parts of each contour meet those of the next one inward.
    fn followed(&self) -> (Vec<Vec<u32>>, Vec<Met>) {
        let mut now: Vec<Vec<u32>> = (1..=self.contours[0].solids.count as u32).map(|number| vec![number]).collect();
        let mut followed = vec![now.iter().flatten().copied().collect()];
        let mut all_met = Vec::new();
        for (level, pair) in self.contours.windows(2).enumerate() {
            let met = self.met(level, |a| pair[0].solids.labels[a], |b| pair[1].solids.labels[b]);
            now.iter_mut().for_each(|of| *of = alone(of, &met));
            followed.push(now.iter().flatten().copied().collect());
            all_met.push(met);
        }
        (followed, all_met)
    }

    /// The parts `followed` on contour `level` with the distances to all of their lines. The backend is asked for those of some contours together, which are
    /// `known` then.
    fn told(&self, level: usize, followed: &[Vec<u32>], known: &mut VecDeque<Vec<Told>>) -> Result<Vec<Told>> {
        if known.is_empty() {
            let bytes = |level: usize| -> usize {
                let pixels =
                    |number: &u32| self.contours[level].tile_of(&[*number], self.margin).dims.iter().product::<usize>();
                followed[level].iter().map(pixels).sum::<usize>() * BYTES_OF_PIXEL
            };
            let mut sum = bytes(level);
            let more = (level + 1..followed.len()).take_while(|more| {
                sum += bytes(*more);
                sum <= self.together
            });
            let end = level + 1 + more.count();
            known.extend(self.told_together(&followed[level..end], level)?);
        }
        Ok(known.pop_front().unwrap_or_default())
    }

    /// Parts of the contours from number `first` on.
    fn told_together(&self, followed: &[Vec<u32>], first: usize) -> Result<Vec<Vec<Told>>> {
        let of_level = |(level, numbers): (usize, &Vec<u32>)| numbers.iter().map(|number| (level, *number)).collect();
        let asked: Vec<(usize, u32)> = followed.iter().enumerate().flat_map::<Vec<_>, _>(of_level).collect();
        let (told, jobs): (Vec<_>, Vec<_>) =
            asked.par_iter().map(|&(level, number)| self.asked(first + level, number)).unzip();
        let jobs: Vec<PartJob> = jobs.into_iter().flatten().collect();
        let mut fields = self.backend.part_fields(&PartRequest { jobs: &jobs, h: self.h })?.into_iter();
        let mut all: Vec<Vec<Told>> = followed.iter().map(|_| Vec::new()).collect();
        for ((level, _), (mut part, open, own)) in asked.into_iter().zip(told) {
            part.fields.extend(fields.next().map(|mut field| {
                open.iter().for_each(|open| open.end(&mut field));
                field
            }));
            part.fields.extend(own.iter().zip(&mut fields).map(|(own, answer)| own.of_answer(&answer)));
            all[level].push(part);
        }
        Ok(all)
    }

    /// A part of a contour with its holes told apart, and the question for the distances to its lines.
    fn asked(&self, level: usize, number: u32) -> ((Told, Option<OpenPart>, Vec<HoleTiles>), Vec<PartJob>) {
        let contour = &self.contours[level];
        let nx = contour.phi.dims[0];
        let tile = contour.tile_of(&[number], self.margin);
        let outside: Vec<bool> = tile.map(&contour.solids.labels, nx, |label| *label != number);
        let background = label8(&outside, tile.dims);
        let own = HoleTiles::of(&background, tile.dims, self.margin, samples(OUT as usize, self.h));
        let Components { labels, count } = background;
        // The margin is around every part: what the first pixel belongs to is the outside.
        let around = labels[0];
        let holes: Vec<u32> = labels.iter().map(|&l| if l == around { 0 } else { l - u32::from(l > around) }).collect();
        let count = count - 1;
        let whole = tile.cut(&contour.phi);
        let own: Vec<HoleTiles> = (1..own.len()).filter(|l| *l as u32 != around).map(|l| own[l]).collect();
        let of_holes: Vec<PartJob> = (1..).zip(&own).map(|(k, tiles)| tiles.job(&whole, |n| holes[n] == k)).collect();
        let inside: Vec<bool> = labels.iter().map(|&l| l != around).collect();
        let open = OpenPart::of(&inside, &tile, self.known);
        let walled = open.is_none() && OpenPart::going_on(&inside, &tile, self.known).is_some();
        let inside = open.as_ref().map(|open| open.opened(&inside)).unwrap_or(inside);
        let filled = PartJob { whole, inside };
        let tiles = std::iter::once(tile).chain(own.iter().map(|own| own.kept.placed(tile))).collect();
        let jobs: Vec<PartJob> = std::iter::once(filled).chain(of_holes).collect();
        ((Told { number, tile, holes, count, tiles, fields: Vec::new(), walled }, open, own), jobs)
    }

    /// A part of the end contour.
    fn part(&self, told: &Told) -> EndPart {
        let contour = &self.contours[0];
        let mut seeds = vec![Vec::new(); told.count + 1];
        for (k, seed) in (0..).zip(&contour.seeds) {
            if contour.solids.labels[seed.inside] == told.number {
                let hole = told.tile.local_node(seed.outside, contour.phi.dims[0]).map_or(0, |n| told.holes[n]);
                seeds[hole as usize].push(k);
            }
        }
        let counts = self.counts(told);
        let region = |((field, tile), seeds): ((&Field, &Tile), Vec<u32>)| {
            let inside = |seed: u32| contour.seeds[seed as usize].inside;
            let (seeds, counted) = self.known.first(seeds, contour.phi.dims[0], inside);
            let values = || counts.on(tile, &field.data);
            let (areas, offsets) = (vec![area(values())], Offsets::new(values()));
            Region { areas, offsets, tile: *tile, field: field.clone(), seeds, counted }
        };
        let mut regions = told.fields.iter().zip(&told.tiles).zip(seeds).map(region);
        let outline = regions.next().unwrap_or_else(|| region(((&Field::default(), &told.tile), Vec::new())));
        EndPart { number: told.number, tile: told.tile, outline, holes: regions.collect() }
    }
}

/// Parts that some meet, where nothing else meets them; nothing where something does.
fn alone(some: &[u32], met: &[(u32, u32)]) -> Vec<u32> {
    let mut theirs: Vec<u32> = met.iter().filter(|(a, _)| some.contains(a)).map(|(_, b)| *b).collect();
    theirs.sort_unstable();
    theirs.dedup();
    let shared = met.iter().any(|(a, b)| theirs.binary_search(b).is_ok() && !some.contains(a));
    if shared { Vec::new() } else { theirs }
}

/// The holes of some parts of a contour, numbered from 1 over all.
struct HoleMap {
    /// Number for each of the padded image's pixels.
    pixels: Vec<u32>,
    areas: Vec<f64>,
}

impl HoleMap {
    fn new(contour: &Contour, told: &[Told], seen: &Seen) -> Self {
        let mut map = HoleMap { pixels: Vec::new(), areas: Vec::new() };
        for part in told.iter().filter(|part| part.count > 0) {
            map.pixels.resize(contour.phi.data.len(), 0);
            let before = map.areas.len() as u32;
            for (node, &hole) in part.tile.nodes(contour.phi.dims[0]).zip(&part.holes) {
                // The islands in a hole are parts of their own, and so are their holes: the outer one was there first.
                if hole > 0 && map.pixels[node] == 0 {
                    map.pixels[node] = before + hole;
                }
            }
            map.areas.extend((1..part.fields.len()).map(|line| part.area(line, seen)));
        }
        map
    }

    fn at(&self, node: usize) -> u32 {
        self.pixels.get(node).copied().unwrap_or(0)
    }
}
