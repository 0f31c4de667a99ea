//! Layers of morphed intervals on the GPU: from the fronts of the sweeps to packed layers, without a way over the host.
//!
//! Where the sweeps of an interval do not fit the device together, its slices come back and are sent again, bit for bit.

use rayon::prelude::*;

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::atlas::{Atlas, in_batches, padded};
use super::compose::SweptPairs;
use super::device::{Buffer, failure};
use super::distance::{self, DistanceBuffers};
use super::kernels::shader;
use super::layout::{BLOCK, Body, Image, Morph, NONE, OF_ENDS, OF_SHAPES, OF_SLICES, Part, Span};
use super::moving::{image, per_pixel, tile_count, vectors};
use super::moving_layer::{lone_tiles, span};
use super::propagate;
use super::recorder::{Recorder, Size};
use super::resident::scaled;
use super::trace::morph_params;
use super::trajectories::paths;
use super::work;
use crate::backend::Backend;
use crate::backend::blend::is_broken;
use crate::backend::interval_morph::{IntervalMorph, LayerImage, MorphFrame, Morphed};
use crate::backend::jobs::{Filled, SweepPair, Swept};
use crate::backend::requests::MorphRequest;
use crate::contour::caps::Cap;
use crate::contour::direction::Direction;
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::{AREA, SQUARE, SparseImage};
use crate::grid::tile::Tile;
use crate::progress::Progress;
use crate::reference::Reference;
use crate::reference::morph_layer as twin;
use crate::registration::displacement::BLOCK as STRIDE;
use crate::stack::heights::BESIDE;

shader! {
    morph_layer = "common/job.wgsl" + "common/moving.wgsl" + "common/sample.wgsl" + "common/spline.wgsl"
        + "common/layer_value.wgsl" + twin "src/reference/morph_layer.rs";

    /// Bodies united.
    Unite for unite, "morph_unite" {
        image: Uniform Image,
        bodies: Read [Body],
        slices: Read [f32],
        shapes: Read [f32],
        contours: Read [f32],
        nearest: Write [u32],
        morph: Uniform Morph,
    }

    /// Ways to the mid frame.
    FindMiddle for find_middle, "morph_middle" {
        image: Uniform Image,
        vectors: Read [[f32; 2]],
        morph: Uniform Morph,
        to_middle: Write [[f32; 2]],
    }

    /// What the way to the mid frame and back loses of the slices.
    Lose for lose, "morph_lose" {
        image: Uniform Image,
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        fields_mut: Write [f32],
    }

    /// Tiles that are beyond the limit.
    FindSides for find_sides, "morph_sides" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        sides: Write [f32],
    }

    /// Layers, tile by tile.
    Warp for warp, "morph_warp" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        seen: Read [u32],
        morph: Uniform Morph,
        middle: Read [[f32; 2]],
        sides: Write [f32],
        layers: Write [u32],
    }

    /// Squares of the layers on the image.
    Pack for pack, "morph_pack" {
        image: Uniform Image,
        morph: Uniform Morph,
        dense: Read [u32],
        used: Write [u32],
        squares: Write [[u32; 2]],
        packed: Write [f32],
    }

    /// Values of slices at some places.
    Take for take, "morph_take" {
        slices: Read [f32],
        morph: Uniform Morph,
        places: Read [u32],
        taken: Write [f32],
    }
}

/// Images of an interval's fields on the device: slices, slopes, and what the way to the frame loses.
const FIELDS: usize = 6;
/// Images of the ground: either contour, and the layer beside it.
const GROUNDS: usize = 4;

/// Layers of all intervals, as many together as fit.
pub fn morph_layers(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    // Images larger than an adapter's arrays are left to the reference path, as by the field method.
    if !request.intervals.iter().all(|of| gpu.holds_images(of.image.padded())) {
        return on_host(gpu, request, progress);
    }
    let shares: Vec<f64> = request.intervals.iter().map(|of| share(gpu, of, request)).collect();
    in_batches(gpu, shares.iter().copied(), |batch| {
        let alone = batch.len() == 1;
        let some = MorphRequest { intervals: &request.intervals[batch.clone()], ..*request };
        if alone && shares[batch.start] > 1.0 {
            return apart(gpu, &some, progress);
        }
        match together(gpu, &some, progress) {
            Err(Error::GpuMemory(_)) if alone => {
                gpu.release()?;
                apart(gpu, &some, progress)
            }
            done => done,
        }
    })
}

/// Layers that the reference path composes of the device's slices.
fn on_host(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let pairs: Vec<&SweepPair<'_>> = pairs(request.intervals).collect();
    let filled = propagate::propagate(gpu, &pairs, request.h, &request.options, progress)?;
    twin::layers(request, filled, &|requests| match requests
        .iter()
        .all(|of| gpu.holds_images(of.moving.fields[of.interval].dims))
    {
        true => super::moving_layer::layers(gpu, requests),
        false => Reference.moving_layers(requests),
    })
}

/// Layers of an interval whose sweeps do not fit the device together: its slices come back and are sent again.
fn apart(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let pairs: Vec<&SweepPair<'_>> = pairs(request.intervals).collect();
    let filled = propagate::propagate(gpu, &pairs, request.h, &request.options, progress)?;
    composed(gpu, request, &Origin::Host(&filled))
}

/// Layers of intervals whose sweeps fit the device together.
fn together(gpu: &Gpu, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, options, .. } = request;
    let pairs: Vec<&SweepPair<'_>> = pairs(intervals).collect();
    if pairs.is_empty() {
        return composed(gpu, request, &Origin::Host(&[]));
    }
    let room = pairs.iter().map(|pair| propagate::share(gpu, pair, options).0).sum();
    let (swept, copies) = propagate::sweep(gpu, &pairs, *h, options, room)?;
    let params = morph_params(*h, options);
    let swept = SweptPairs { pairs: &pairs, swept, copies, params, sweep: options.sweep };
    let made = composed(gpu, request, &Origin::Device(&swept))?;
    progress.advance(2 * pairs.len());
    Ok(made)
}

fn pairs<'p, 'a>(intervals: &'p [IntervalMorph<'a>]) -> impl Iterator<Item = &'p SweepPair<'a>> {
    intervals.iter().flat_map(|of| of.pairs.iter().map(|(_, pair)| pair))
}

/// Share of the device that the sweeps of an interval take together.
fn share(gpu: &Gpu, of: &IntervalMorph<'_>, request: &MorphRequest<'_>) -> f64 {
    of.pairs.iter().map(|(_, pair)| propagate::share(gpu, pair, &request.options).1).sum()
}

/// Share of the device that an interval keeps until its last layer is there.
fn fixed_share(gpu: &Gpu, of: &IntervalMorph<'_>) -> f64 {
    let Some(frame) = &of.frame else { return 0.0 };
    let nodes: usize = of.image.padded().iter().product();
    let caps: usize = of.solids.iter().map(|(cap, _)| cap.field.data.len()).sum();
    let images = FIELDS * nodes + frame.part_pixels;
    // Fields lie there twice when they are new.
    let bytes = 4 * (images + 4 * nodes + GROUNDS * nodes + caps) + 32 * nodes / (STRIDE * STRIDE);
    gpu.share(bytes, 4 * images)
}

/// Share of the device that a layer takes while it is made.
fn layer_share(gpu: &Gpu, of: &IntervalMorph<'_>) -> f64 {
    let slices: usize = of.pairs.iter().map(|(tile, _)| padded(tile.len())).sum();
    let nodes: usize = of.image.padded().iter().product();
    let squares: usize = of.image.dims.iter().map(|n| n.div_ceil(SQUARE)).product();
    let blocks = if of.frame.is_some() { nodes / (STRIDE * STRIDE) } else { 0 };
    // In the frame, at its place, packed and read back.
    let bytes = slices * (distance::NODE_BYTES + 4) + 8 * nodes + squares * (8 * AREA + 16) + 24 * blocks;
    let largest = (4 * slices).max(4 * squares * AREA).max(4 * nodes);
    let share = gpu.share(bytes, largest).max(gpu.share_of_work(work::DISTANCE_PIXEL * slices));
    // An interval's layers are warped in one dispatch.
    let parts = of.frame.as_ref().map_or(0, |frame| frame.parts);
    let warp = gpu.share_of_work((2 * work::LAYER_PIXEL + work::LONE_PART * parts) * nodes);
    if warp * of.times.len() as f64 > 1.0 { share.max(warp) } else { share }
}

/// Slices of the groups that layers are composed of.
enum Origin<'s> {
    /// Fronts on the device.
    Device(&'s SweptPairs<'s>),
    /// Slices on the host, pair by pair.
    Host(&'s [Filled]),
}

/// Layers of intervals from the slices of their pairs.
fn composed(gpu: &Gpu, request: &MorphRequest<'_>, origin: &Origin<'_>) -> Result<Vec<Morphed>> {
    let MorphRequest { intervals, h, .. } = request;
    let mut courses: Box<dyn Iterator<Item = [Swept; 2]>> = match origin {
        Origin::Device(swept) => Box::new(swept.swept.chunks_exact(2).map(|s| [s[0].clone(), s[1].clone()])),
        Origin::Host(filled) => Box::new(filled.iter().map(|f| [f.up.clone(), f.down.clone()])),
    };
    let mut out: Vec<Morphed> = Vec::with_capacity(intervals.len());
    let mut composing: Vec<Composing<'_, '_>> = Vec::with_capacity(intervals.len());
    let mut first_pair = 0;
    for of in *intervals {
        let swept = courses.by_ref().take(of.pairs.len()).collect();
        out.push(Morphed { layers: vec![SparseImage::default(); of.times.len()], swept });
        composing.push(Composing { of, first_pair, h: *h, ground: None });
        first_pair += of.pairs.len();
    }
    let steps = steps(intervals);
    // What an interval keeps beside the layers that are being made.
    let fixed = intervals.iter().map(|of| fixed_share(gpu, of)).fold(0.0, f64::max);
    let share = |(i, layers): &(usize, Vec<usize>)| {
        let of = &intervals[*i];
        fixed_share(gpu, of) + layers.len() as f64 * layer_share(gpu, of) / (1.0 - fixed).max(0.1)
    };
    let made = in_batches(gpu, steps.iter().map(share), |batch| {
        let first = Attempt { gpu, origin, steps: &steps[batch], mended: None };
        let lost = match first.layers(&mut composing)? {
            Made::Layers(layers) => return Ok(layers),
            Made::Lost(lost) => lost,
        };
        let Origin::Device(swept) = origin else { return Err(failure("a slice of the host's has lost an overlap")) };
        let (atlas, values) = &swept.mended(gpu, &lost)?;
        let again = Attempt { mended: Some(Mended { wanted: &lost, atlas, values }), ..first };
        match again.layers(&mut composing)? {
            Made::Layers(layers) => Ok(layers),
            Made::Lost(_) => Err(failure("an overlap that was put back is lost")),
        }
    })?;
    for ((i, numbers), layers) in steps.iter().zip(made) {
        for (k, layer) in numbers.iter().zip(layers) {
            out[*i].layers[*k] = layer;
        }
    }
    Ok(out)
}

/// Layers of all intervals by their numbers, in the order in which they are made: those beside the contours first, as others need them.
fn steps(intervals: &[IntervalMorph<'_>]) -> Vec<(usize, Vec<usize>)> {
    let mut out = Vec::new();
    for (i, of) in intervals.iter().enumerate() {
        let mut first: Vec<usize> = Vec::new();
        if of.frame.is_some() {
            first.extend(beside(of).into_iter().flatten());
            first.sort_unstable();
            first.dedup();
            out.push((i, first.clone()));
        }
        out.extend((0..of.times.len()).filter(|k| !first.contains(k)).map(|k| (i, vec![k])));
    }
    out
}

/// Layers beside the lower and the upper contour.
fn beside(of: &IntervalMorph<'_>) -> [Option<usize>; 2] {
    [Direction::Up, Direction::Down].map(|from| twin::beside(&of.times, from))
}

/// An interval whose layers are being composed.
struct Composing<'p, 'a> {
    of: &'p IntervalMorph<'a>,
    /// Number of its first pair.
    first_pair: usize,
    h: [f64; 2],
    /// What its layers share, from the first step on.
    ground: Option<Ground>,
}

/// What the layers of an interval in its frame share.
struct Ground {
    frame: MorphFrame,
    fields: Buffer<[f32]>,
    parts: Buffer<[Part]>,
    span: Buffer<Span>,
    /// Ways off the slices, and the particles.
    behind: Vec<[f32; 2]>,
}

/// Layers of each step, or slices that have lost an overlap, each a pair and the number of its time.
enum Made {
    Layers(Vec<Vec<SparseImage<f32>>>),
    Lost(Vec<(usize, usize)>),
}

/// Steps that are made together.
#[derive(Clone, Copy)]
struct Attempt<'g, 's> {
    gpu: &'g Gpu,
    origin: &'s Origin<'s>,
    steps: &'s [(usize, Vec<usize>)],
    mended: Option<Mended<'s>>,
}

/// Slices that have been mended, each a pair and the number of its time, with their values.
#[derive(Clone, Copy)]
struct Mended<'s> {
    wanted: &'s [(usize, usize)],
    atlas: &'s Atlas,
    values: &'s [f32],
}

/// Slices of the groups on the device.
struct Slices {
    /// Each a pair and the number of its time.
    wanted: Vec<(usize, usize)>,
    atlas: Atlas,
    values: Buffer<[f32]>,
}

impl Slices {
    fn first(&self, slot: usize) -> u32 {
        self.atlas.jobs[slot].offset
    }
}

/// Layers of an interval that are on their way to the host.
struct Packed {
    image: LayerImage,
    layers: usize,
    used: Wanted<u32>,
    squares: Wanted<[u32; 2]>,
    values: Buffer<[f32]>,
}

impl<'g> Attempt<'g, '_> {
    /// Makes the layers of all steps.
    fn layers(&self, composing: &mut [Composing<'_, '_>]) -> Result<Made> {
        let gpu = self.gpu;
        // Steps of an interval follow each other.
        let together: Vec<(usize, Vec<usize>)> = self
            .steps
            .chunk_by(|a, b| a.0 == b.0)
            .map(|steps| (steps[0].0, steps.iter().flat_map(|(_, layers)| layers.iter().copied()).collect()))
            .collect();
        let begun = |(i, _): &(usize, Vec<usize>)| {
            let source = composing[*i].of.frame.as_ref().filter(|_| composing[*i].ground.is_none());
            source.map(|source| source.read().map(Begun::new)).transpose()
        };
        let begun: Vec<Option<Begun>> = together.par_iter().map(begun).collect::<Result<_>>()?;
        let (mut recorder, slices) = self.slices(composing, &together)?;
        let anchors = match (self.mended, self.origin) {
            (None, Origin::Device(swept)) => self.anchors(&mut recorder, swept, &slices)?,
            _ => None,
        };
        let (mut packed, mut grounds, mut slot) = (Vec::new(), Vec::new(), 0);
        for ((i, layers), begun) in together.iter().zip(begun) {
            let own = &composing[*i];
            let (done, ground) = own.record(gpu, &mut recorder, self.origin, layers, (&slices, slot), begun)?;
            packed.push(done);
            grounds.push(ground);
            slot += layers.len() * own.of.pairs.len();
        }
        let landed = recorder.submit()?.wait()?;
        if let (Some(anchors), Origin::Device(swept)) = (&anchors, self.origin) {
            let lost = lost(swept, &slices, &landed.values(anchors)?);
            if !lost.is_empty() {
                return Ok(Made::Lost(lost));
            }
        }
        let mut images = unpacked(gpu, &landed, &packed)?.into_iter();
        for ((i, _), ground) in together.iter().zip(grounds) {
            if ground.is_some() {
                composing[*i].ground = ground;
            }
        }
        // Steps come interval by interval: what the last one of these shares may still be needed.
        let last = together.last().map_or(0, |(i, _)| *i);
        composing[..last].iter_mut().for_each(|done| done.ground = None);
        Ok(Made::Layers(self.steps.iter().map(|(_, layers)| images.by_ref().take(layers.len()).collect()).collect()))
    }

    /// Records the slices of the groups for these layers: blended, mended where that is known to be needed, continued outwards.
    fn slices(
        &self,
        composing: &[Composing<'_, '_>],
        together: &[(usize, Vec<usize>)],
    ) -> Result<(Recorder<'g>, Slices)> {
        let gpu = self.gpu;
        let mut wanted = Vec::new();
        for (i, layers) in together {
            let pairs = composing[*i].first_pair..composing[*i].first_pair + composing[*i].of.pairs.len();
            wanted.extend(layers.iter().flat_map(|k| pairs.clone().map(|p| (p, *k))));
        }
        let swept = match self.origin {
            Origin::Device(swept) if !wanted.is_empty() => swept,
            Origin::Device(_) => return self.sent(wanted, &[]),
            Origin::Host(filled) => return self.sent(wanted, filled),
        };
        let atlas = swept.atlas(&wanted);
        let (mut recorder, blended) = swept.blend(gpu, &wanted, &atlas)?;
        if let Some(mended) = self.mended {
            let values = gpu.device.upload("mended", mended.values)?;
            for (slice, from) in mended.wanted.iter().zip(&mended.atlas.jobs) {
                let Some(slot) = wanted.iter().position(|other| other == slice) else { continue };
                let bytes = 4 * u64::from(from.block_count) * BLOCK as u64;
                let to = atlas.jobs[slot].offset;
                recorder.copy_part((&values, 4 * u64::from(from.offset)), (&blended, 4 * u64::from(to)), bytes);
            }
        }
        let tiles = DistanceBuffers::new(gpu, atlas, swept.params, blended)?;
        let recorder = tiles.solve(recorder, true)?;
        let DistanceBuffers { atlas, d: values, .. } = tiles;
        Ok((recorder, Slices { wanted, atlas, values }))
    }

    /// The same of slices that the host has.
    fn sent(&self, wanted: Vec<(usize, usize)>, filled: &[Filled]) -> Result<(Recorder<'g>, Slices)> {
        let gpu = self.gpu;
        let slice = |&(p, k): &(usize, usize)| &filled[p].slices[k];
        let atlas = Atlas::new(wanted.iter().map(|of| slice(of).dims()));
        let mut values = Vec::with_capacity(atlas.node_count());
        for own in wanted.iter().map(slice) {
            values.extend(own.unpack());
            values.resize(padded(values.len()), 0.0);
        }
        let values = gpu.device.upload("slices", &values)?;
        Ok((Recorder::new(&gpu.device, &gpu.profiler), Slices { wanted, atlas, values }))
    }

    /// Records that the values at the anchors of all slices are read.
    fn anchors(
        &self,
        recorder: &mut Recorder<'_>,
        swept: &SweptPairs<'_>,
        slices: &Slices,
    ) -> Result<Option<Wanted<f32>>> {
        let (gpu, device) = (self.gpu, &self.gpu.device);
        let of = |(slot, &(p, _)): (usize, &(usize, usize))| {
            let first = slices.first(slot);
            swept.pairs[p].anchors.iter().map(move |anchor| first + *anchor as u32)
        };
        let places: Vec<u32> = slices.wanted.iter().enumerate().flat_map(of).collect();
        if places.is_empty() {
            return Ok(None);
        }
        let count = places.len();
        let morph = &device.uniform("morph", Morph { places: count as u32, ..Morph::default() });
        let (places, taken) = (&device.upload("places", &places)?, &device.storage("taken", count)?);
        recorder.run(&Take { slices: &slices.values, morph, places, taken }.bind(gpu), Size::List(count));
        Ok(Some(recorder.read(taken, 0, count)))
    }
}

/// Slices that have lost an overlap, by the values at their anchors.
fn lost(swept: &SweptPairs<'_>, slices: &Slices, values: &[f32]) -> Vec<(usize, usize)> {
    let mut next = 0;
    let mut out = Vec::new();
    for &(p, k) in &slices.wanted {
        let pair = swept.pairs[p];
        let own = &values[next..next + pair.anchors.len()];
        next += own.len();
        let value = |pixel: usize| pair.anchors.iter().position(|anchor| *anchor == pixel).map(|n| own[n]);
        if is_broken(pair, |pixel| value(pixel).is_some_and(|v| v >= 0.0)) {
            out.push((p, k));
        }
    }
    out
}

impl Composing<'_, '_> {
    /// Records some layers of the interval, whose slices begin with number `slot`; what its layers share where that was not there.
    fn record(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        origin: &Origin<'_>,
        layers: &[usize],
        (slices, slot): (&Slices, usize),
        begun: Option<Begun>,
    ) -> Result<(Packed, Option<Ground>)> {
        let (device, of) = (&gpu.device, self.of);
        let (padded, count) = (of.image.padded(), layers.len());
        let nodes: usize = padded.iter().product();
        let known = self.ground.as_ref().map(|ground| &ground.frame);
        let frame = begun.as_ref().map(|begun| &begun.frame).or(known);
        let grid = frame.map_or([0; 2], |frame| frame.moving.displacements[0].grid);
        let empty = frame.map_or([true; 2], |frame| frame.empty);
        let begins = begun.is_some();
        let mut bodies = Bodies::default();
        for (n, k) in layers.iter().enumerate() {
            bodies.add_slices(of, n, slices, slot + n * of.pairs.len());
            for (cap, from) in of.solids.iter() {
                bodies.add_cap(cap, from.away(of.times[*k]), n);
            }
        }
        let beside = beside(of);
        if begins {
            for (end, from) in [Direction::Up, Direction::Down].into_iter().enumerate() {
                let contour = count + 2 * end;
                self.add_contour(&mut bodies, origin, from, contour);
                if let Some(n) = beside[end].and_then(|k| layers.iter().position(|other| *other == k)) {
                    bodies.add_slices(of, contour + 1, slices, slot + n * of.pairs.len());
                }
                for (cap, _) in of.solids.iter().filter(|(_, way)| *way == from) {
                    bodies.add_cap(cap, 0.0, contour);
                    bodies.add_cap(cap, BESIDE, contour + 1);
                }
            }
        }
        let images = count + if begins { GROUNDS } else { 0 };
        let [low_own, high_own] = empty.map(|empty| u32::from(!empty));
        let [low_beside, high_beside] = beside.map(|k| u32::from(k.is_some()));
        let morph = Morph {
            limit: of.image.limit as f32,
            pad_x: of.image.pad[0] as u32,
            pad_y: of.image.pad[1] as u32,
            nx: of.image.dims[0] as u32,
            ny: of.image.dims[1] as u32,
            layers: count as u32,
            bodies: bodies.bodies.len() as u32,
            groups: bodies.groups as u32,
            halvings: usize::BITS - bodies.bodies.len().leading_zeros(),
            low_own,
            high_own,
            low_beside,
            high_beside,
            places: 0,
        };
        let morph = &device.uniform("morph", morph);
        let image = &device.uniform("image", image(padded, grid, self.h, count));
        let united = &device.storage("united", images * nodes)?;
        recorder.clear(united);
        if !bodies.bodies.is_empty() {
            let shapes = &device.upload("shapes", &bodies.shapes)?;
            let contours = match origin {
                Origin::Device(swept) => swept.copies.end(0).0.unwrap_or(shapes),
                Origin::Host(_) => shapes,
            };
            let listed = &device.upload("bodies", &bodies.bodies)?;
            let (slices, nearest) = (&slices.values, united);
            let unite = Unite { image, bodies: listed, slices, shapes, contours, nearest, morph };
            recorder.run(&unite.bind(gpu), Size::List(bodies.groups * BLOCK));
        }
        let ground = begun.map(|begun| Ground::new(gpu, recorder, begun, of.image.limit, self.h)).transpose()?;
        let warped = match self.ground.as_ref().or(ground.as_ref()) {
            None => None,
            Some(Ground { frame, fields, parts, span, behind }) => {
                // The ways from the layers, then those from the slices.
                let times: Vec<f64> = layers.iter().map(|k| of.times[*k]).chain([0.0, 1.0]).collect();
                let vectors = &paths(gpu, recorder, &frame.moving, 0, &times, self.h, behind)?;
                let middle = &device.storage("middle", times.len() * grid[0] * grid[1])?;
                let find_middle = FindMiddle { image, vectors, morph, to_middle: middle };
                recorder.run(&find_middle.bind(gpu), Size::List(times.len() * grid[0] * grid[1]));
                if begins {
                    let lose = Lose { image, seen: united, morph, middle, fields_mut: fields };
                    recorder.run(&lose.bind(gpu), Size::List(2 * nodes));
                }
                let table: Vec<f32> = times.iter().map(|t| *t as f32).collect();
                let times = &device.upload("times", &table)?;
                let tiles = count * tile_count(padded);
                let (sides, layers) = (&device.storage("sides", tiles)?, device.storage("layers", count * nodes)?);
                if count > 0 {
                    let seen = united;
                    let find_sides =
                        FindSides { image, span, fields, vectors, times, parts, seen, morph, middle, sides };
                    recorder.run(&find_sides.bind(gpu), Size::List(tiles));
                    let warp = Warp {
                        image,
                        span,
                        fields,
                        vectors,
                        times,
                        parts,
                        seen,
                        morph,
                        middle,
                        sides,
                        layers: &layers,
                    };
                    recorder.run(&warp.bind(gpu), per_pixel(padded, count));
                }
                Some(layers)
            }
        };
        let dense = warped.as_ref().unwrap_or(united);
        let tasks = count * square_count(of.image);
        let (used, squares) = (&device.zeroed("used", 1)?, &device.storage("squares", tasks)?);
        let values = device.storage("packed", tasks * AREA)?;
        if count > 0 {
            let pack = Pack { image, morph, dense, used, squares, packed: &values };
            recorder.run(&pack.bind(gpu), Size::List(tasks * super::kernels::WORKGROUP as usize));
        }
        let (used, squares) = (recorder.read(used, 0, 1), recorder.read(squares, 0, tasks));
        Ok((Packed { image: of.image, layers: count, used, squares, values }, ground))
    }

    /// The ends of all groups at the contour from which `from` goes, without holes.
    fn add_contour(&self, bodies: &mut Bodies, origin: &Origin<'_>, from: Direction, image: usize) {
        for (n, (tile, pair)) in self.of.pairs.iter().enumerate() {
            let holes: Vec<&Cap> = pair.holes.iter().filter(|(_, way)| *way == from).map(|(cap, _)| cap).collect();
            let (end, goes_there) = match from {
                Direction::Up => (&pair.up.source, 1),
                Direction::Down => (&pair.down.source, 0),
            };
            match origin {
                Origin::Device(swept) if holes.is_empty() => {
                    let first = swept.copies.end(2 * (self.first_pair + n) + goes_there).1;
                    bodies.add(tile, (OF_ENDS, first), 0.0, image);
                }
                _ => {
                    let without = |n: usize| holes.iter().fold(end.data[n], |v, hole| v.max(-hole.field.data[n]));
                    let field = Field { dims: end.dims, data: (0..end.data.len()).map(without).collect() };
                    bodies.add_shape(tile, &field, 0.0, image);
                }
            }
        }
    }
}

/// Bodies that the device unites, and the values of those that the host has made.
#[derive(Default)]
struct Bodies {
    bodies: Vec<Body>,
    shapes: Vec<f32>,
    /// Groups of pixels that they take.
    groups: usize,
}

impl Bodies {
    fn add(&mut self, tile: &Tile, (source, first): (u32, u32), offset: f64, image: usize) {
        self.bodies.push(Body {
            first,
            source,
            nx: tile.dims[0] as u32,
            ny: tile.dims[1] as u32,
            x: tile.origin[0] as i32,
            y: tile.origin[1] as i32,
            offset: super::moving::bounded(offset),
            layer: image as u32,
            first_group: self.groups as u32,
            padding: 0,
        });
        self.groups += tile.len().div_ceil(BLOCK);
    }

    /// Slices of all groups of an interval, which begin with number `slot`.
    fn add_slices(&mut self, of: &IntervalMorph<'_>, image: usize, slices: &Slices, slot: usize) {
        for (n, (tile, _)) in of.pairs.iter().enumerate() {
            self.add(tile, (OF_SLICES, slices.first(slot + n)), 0.0, image);
        }
    }

    fn add_cap(&mut self, cap: &Cap, away: f64, image: usize) {
        self.add_shape(&cap.tile, &cap.field, cap.offset(away), image);
    }

    fn add_shape(&mut self, tile: &Tile, field: &Field, offset: f64, image: usize) {
        let first = self.shapes.len() as u32;
        self.shapes.extend(scaled(field, 1.0));
        self.add(tile, (OF_SHAPES, first), offset, image);
    }
}

/// A frame, and what follows from it on the host.
struct Begun {
    frame: MorphFrame,
    /// Ways off the slices, and the particles.
    behind: Vec<[f32; 2]>,
}

impl Begun {
    fn new(frame: MorphFrame) -> Self {
        let MorphFrame { moving, trust, .. } = &frame;
        let off = moving.off_slices(0, 0.5, &moving.paths(0, 0.5));
        let behind = vectors(off.iter().chain([trust.particles()]));
        Begun { frame, behind }
    }
}

impl Ground {
    /// The ground of an interval in its frame, but for what the way there loses.
    fn new(
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        Begun { frame, behind }: Begun,
        limit: f64,
        h: [f64; 2],
    ) -> Result<Self> {
        let device = &gpu.device;
        let MorphFrame { moving, slopes, lone, .. } = &frame;
        let nodes = moving.fields[0].data.len();
        let (lone_values, parts) = lone_tiles(lone, FIELDS * nodes);
        let span = device.uniform("span", span(moving, lone, limit, h));
        let fields = device.storage("fields", FIELDS * nodes + lone_values.len())?;
        device.write_from(&fields, FIELDS * nodes, &lone_values);
        let gap = moving.gap(0);
        let images = [(&moving.fields[0], 1.0), (&moving.fields[1], 1.0), (&slopes[0], gap), (&slopes[1], gap)];
        for (k, image) in images.into_iter().enumerate() {
            gpu.place(recorder, image, (&fields, k * nodes))?;
        }
        let parts = device.upload("parts", &parts)?;
        Ok(Ground { frame, fields, parts, span, behind })
    }
}

/// Squares of an image.
fn square_count(image: LayerImage) -> usize {
    image.dims.iter().map(|n| n.div_ceil(SQUARE)).product()
}

/// All layers that were packed, one after the other.
fn unpacked(gpu: &Gpu, landed: &Landed<'_>, packed: &[Packed]) -> Result<Vec<SparseImage<f32>>> {
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    let mut wanted = Vec::with_capacity(packed.len());
    for own in packed {
        let used = landed.value(&own.used)? as usize;
        wanted.push(recorder.read::<f32>(&own.values, 0, used * AREA));
    }
    let values = recorder.submit()?.wait()?;
    let mut out = Vec::new();
    for (own, wanted) in packed.iter().zip(&wanted) {
        let (squares, count) = (landed.values(&own.squares)?, square_count(own.image));
        let made = values.taken(wanted, |values| {
            let layer = |k: usize| image_of(own.image.dims, &squares[k * count..][..count], values);
            (0..own.layers).into_par_iter().map(layer).collect::<Result<Vec<_>>>()
        })?;
        out.extend(made?);
    }
    Ok(out)
}

/// The image of these squares.
fn image_of(dims: [usize; 2], squares: &[[u32; 2]], values: &[f32]) -> Result<SparseImage<f32>> {
    let mut next = squares.iter();
    SparseImage::read_squares(dims, |_, out| {
        let missing = || failure("the layers that came back are too short");
        match next.next().ok_or_else(missing)? {
            [NONE, bits] => Ok(Some(f32::from_bits(*bits))),
            [place, _] => {
                let own =
                    values.get(*place as usize * AREA..).and_then(|rest| rest.first_chunk()).ok_or_else(missing)?;
                *out = *own;
                Ok(None)
            }
        }
    })
}
