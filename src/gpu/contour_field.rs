//! Level sets of slices on the GPU: anti-aliasing, distance, conditioning.

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::{Atlas, bits, in_batches, padded};
use super::band::{
    Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, sides_that_differ, with_room,
};
use super::blocks::blocks;
use super::buffer::Buffer;
use super::distance::{DistanceBuffers, Rounds, settled, settled_by};
use super::exact::exact_distance;
use super::kernels::shader;
use super::layout::{Block, Job, Params, Rule};
use super::recorder::{Recorder, Size};
use super::work;
use crate::backend::conditioning::{
    AREA_SIGMA, CONDITION_ITERATIONS, CONDITION_WIDER, CONDITIONED, EQ6_ITERATIONS, FIELD_FLOOR, FLAT, KERNEL_CLIP,
    LEAST_LENGTH, MASK_FLOOR, MOST_SHIFT, gaussian_weights,
};
use crate::backend::{ContourOptions, PaddedSlice};
use crate::error::Result;
use crate::gpu::coalesce::SliceJob;
use crate::grid::field::Field;
use crate::progress::Progress;
use crate::settings::AntiAlias;

shader! {
    contour_field = "common/job.wgsl" + twin "src/reference/contour_field.rs";

    /// Half a pixel to either side of `mask`.
    Spread for spread, "spread" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        result: Write [f32],
        mask: Read [u32],
    }

    /// One axis of a Gaussian of `first`.
    Gaussian for gaussian, "gaussian" {
        params: Uniform Params,
        rule: Uniform Rule,
        jobs: Read [Job],
        blocks: Read [Block],
        first: Read [f32],
        result: Write [f32],
    }

    /// `2 first - second` on the mask's side.
    Sharpen for sharpen, "sharpen" {
        params: Uniform Params,
        rule: Uniform Rule,
        first: Read [f32],
        second: Read [f32],
        sides: Read [f32],
        result: Write [f32],
    }

    /// `first` on the mask's side.
    HoldSides for hold_sides, "hold_sides" {
        params: Uniform Params,
        rule: Uniform Rule,
        first: Read [f32],
        sides: Read [f32],
        result: Write [f32],
    }

    /// `result` near the exact distance `first`.
    Limit for limit, "limit" {
        params: Uniform Params,
        rule: Uniform Rule,
        first: Read [f32],
        result: Write [f32],
    }

    /// The distance `second`, near the contour the conditioned field `first`.
    PutConditioned for put_conditioned, "put_conditioned" {
        params: Uniform Params,
        rule: Uniform Rule,
        blocks: Read [Block],
        first: Read [f32],
        second: Read [f32],
        result: Write [f32],
    }

    /// What pixels lack of their mask in the level set `first`, and the length of contour in them.
    MeasureArea for measure_area, "measure_area" {
        params: Uniform Params,
        rule: Uniform Rule,
        jobs: Read [Job],
        blocks: Read [Block],
        first: Read [f32],
        sides: Read [f32],
        result: Write [f32],
        lengths: Write [f32],
    }

    /// `result` moved by the area `first` that it lacks per length `second`.
    RestoreArea for restore_area, "restore_area" {
        params: Uniform Params,
        rule: Uniform Rule,
        first: Read [f32],
        second: Read [f32],
        sides: Read [f32],
        result: Write [f32],
    }
}

/// Bytes per node: the slice, the distance, the exact distance and its three scratch arrays, area and length with one of their axes, the band's
/// own.
const BYTES: usize = NODE_BYTES + 36;

/// Level sets of all slices; `inf` where a slice is empty.
pub fn contour_fields(
    gpu: &Gpu,
    slices: &[SliceJob<'_>],
    h: [f64; 2],
    options: ContourOptions,
    progress: &dyn Progress,
) -> Result<Vec<Field>> {
    let mut out: Vec<Option<Field>> = slices.iter().map(|_| None).collect();
    let rooms: Vec<usize> =
        slices.par_iter().map(|job| places(crossings_of(job), width(options), pixels(job))).collect();
    let share = |&k: &usize| {
        let (nodes, room) = (padded(pixels(&slices[k])), rooms[k]);
        let share = gpu.share(nodes * BYTES + room * PLACE_BYTES, 4 * nodes);
        share.max(gpu.share_of_work((work::CONTOUR_PIXEL * nodes).max(work::BAND_PLACE * room)))
    };
    // Masks and grey slices take different ways.
    for masks in [true, false] {
        let open = |&k: &usize| is_mask(&slices[k]) == masks && has_inside(&slices[k]);
        let open: Vec<usize> = (0..slices.len()).into_par_iter().filter(open).collect();
        let fields = in_batches(gpu, open.iter().map(share), |batch| {
            let room = open[batch.clone()].iter().map(|&k| rooms[k]).sum::<usize>() + SPARE_PLACES;
            let batch: Vec<&SliceJob<'_>> = open[batch].iter().map(|&k| &slices[k]).collect();
            let result = settled(|rounds| run(gpu, &batch, h, options, (room, rounds)))?;
            progress.advance(batch.len());
            Ok(result)
        })?;
        for (k, field) in open.into_iter().zip(fields) {
            out[k] = Some(field);
        }
    }
    progress.advance(out.iter().filter(|field| field.is_none()).count());
    let empty = |job: &SliceJob<'_>| Field::filled(job.dims, f64::INFINITY);
    Ok(out.into_iter().zip(slices).map(|(field, job)| field.unwrap_or_else(|| empty(job))).collect())
}

fn is_mask(job: &SliceJob<'_>) -> bool {
    matches!(&*job.slice, PaddedSlice::Mask(_))
}

fn has_inside(job: &SliceJob<'_>) -> bool {
    match &*job.slice {
        PaddedSlice::Mask(mask) => mask.contains(&true),
        PaddedSlice::Level(u) => u.has_inside(),
    }
}

fn crossings_of(job: &SliceJob<'_>) -> usize {
    match &*job.slice {
        PaddedSlice::Mask(mask) => sides_that_differ(mask, job.dims[0], |inside| *inside),
        PaddedSlice::Level(u) => crossings(u),
    }
}

fn pixels(job: &SliceJob<'_>) -> usize {
    job.dims.iter().product()
}

/// Half width of the band in which contours are conditioned, px.
fn width(options: ContourOptions) -> f64 {
    options.half_width + CONDITION_WIDER
}

/// Level sets of some slices, all of which are masks or none; nothing where the distances have not settled.
fn run(
    gpu: &Gpu,
    slices: &[&SliceJob<'_>],
    h: [f64; 2],
    options: ContourOptions,
    (room, rounds): (usize, Rounds),
) -> Result<Option<Vec<Field>>> {
    let (mut masks, mut levels): (Vec<&[bool]>, Vec<&Field>) = Default::default();
    for job in slices {
        match &*job.slice {
            PaddedSlice::Mask(mask) => masks.push(mask),
            PaddedSlice::Level(u) => levels.push(u),
        }
    }
    let atlas = Atlas::new(slices.iter().map(|job| job.dims));
    let params =
        Params { hx: h[0] as f32, hy: h[1] as f32, gamma: width(options) as f32, step_share: 1.0, ..Params::default() };
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    // The masks are asked for again where their level sets were smoothed by a kernel.
    let (source, sides) = if masks.is_empty() {
        (atlas.send(&gpu.device, "level", levels, 1.0)?, None)
    } else {
        let tables = Tables::new(gpu, &atlas, params)?;
        let sides = tables.spread(gpu, &mut recorder, &masks)?;
        match options.anti_alias {
            AntiAlias::None => (sides, None),
            AntiAlias::Kernel => (tables.kernel(gpu, &mut recorder, &sides, options.sigma)?, Some(sides)),
            AntiAlias::Eq6 => {
                let exact = &exact_distance(gpu, &mut recorder, &atlas, params, &sides)?;
                recorder.submit()?;
                recorder = Recorder::new(&gpu.device, &gpu.profiler);
                let smooth = |room| eq6(gpu, &atlas, params, exact, &sides, room);
                (with_room(room, atlas.node_count(), smooth)?, None)
            }
        }
    };
    let tiles = DistanceBuffers::new(gpu, atlas.clone(), params, source)?;
    let mut recorder = tiles.solve(recorder, false, rounds)?;
    if let Some(sides) = &sides {
        let exact = exact_distance(gpu, &mut recorder, &atlas, params, sides)?;
        let rule = &gpu.device.uniform("rule", rule(&[]));
        let limit = Limit { params: &tiles.params, rule, first: &exact, result: &tiles.d }.bind(gpu);
        recorder.run(&limit, tiles.per_node());
    }
    recorder.submit()?;
    with_room(room, atlas.node_count(), |room| condition(gpu, &tiles, params, options, sides.as_ref(), room))
}

fn rule(weights: &[f64]) -> Rule {
    let mut out = Rule {
        reach: (weights.len() / 2) as u32,
        mask_floor: MASK_FLOOR as f32,
        field_floor: FIELD_FLOOR as f32,
        kernel_clip: KERNEL_CLIP as f32,
        least_length: LEAST_LENGTH as f32,
        most_shift: MOST_SHIFT as f32,
        flat_square: FLAT as f32,
        ..Rule::default()
    };
    for (k, &w) in weights.iter().enumerate() {
        out.weights[k / 4][k % 4] = w as f32;
    }
    out
}

/// Rules of both axes of a Gaussian.
fn axes(gpu: &Gpu, sigma: f64) -> [Buffer<Rule>; 2] {
    let weights = rule(&gaussian_weights(sigma));
    [0, 1].map(|vertical| gpu.device.uniform("rule", Rule { vertical, ..weights }))
}

/// Tables of the tiles of some masks.
struct Tables {
    nodes: usize,
    params: Buffer<Params>,
    jobs: Buffer<[Job]>,
    blocks: Buffer<[Block]>,
}

impl Tables {
    fn new(gpu: &Gpu, atlas: &Atlas, params: Params) -> Result<Self> {
        let device = &gpu.device;
        let shape = Params { job_count: atlas.jobs.len() as u32, block_count: atlas.block_count() as u32, ..params };
        let (params, jobs) = (device.uniform("params", shape), device.upload("jobs", &atlas.jobs)?);
        Ok(Tables { nodes: atlas.node_count(), blocks: blocks(gpu, atlas, &params, &jobs)?, params, jobs })
    }

    /// Records half a pixel to either side of masks.
    fn spread(&self, gpu: &Gpu, recorder: &mut Recorder<'_>, masks: &[&[bool]]) -> Result<Buffer<[f32]>> {
        let Tables { nodes, params, jobs, blocks } = self;
        let (mask, result) = (&gpu.device.upload("mask", &bits(masks))?, gpu.device.storage("sides", *nodes)?);
        recorder.run(&Spread { params, jobs, blocks, mask, result: &result }.bind(gpu), Size::List(*nodes));
        Ok(result)
    }

    /// Records `2 G - G * G` of the masks, on their sides.
    fn kernel(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        sides: &Buffer<[f32]>,
        sigma: f64,
    ) -> Result<Buffer<[f32]>> {
        let Tables { nodes, params, jobs, blocks } = self;
        let storage = |label| gpu.device.storage(label, *nodes);
        let (half, once, twice) = (storage("half")?, &storage("once")?, &storage("twice")?);
        let axes = axes(gpu, sigma);
        for (axis, first, result) in [(0, sides, &half), (1, &half, once), (0, once, &half), (1, &half, twice)] {
            let gaussian = Gaussian { params, rule: &axes[axis], jobs, blocks, first, result }.bind(gpu);
            recorder.run(&gaussian, Size::List(*nodes));
        }
        let sharpen = Sharpen { params, rule: &axes[0], first: once, second: twice, sides, result: &half }.bind(gpu);
        recorder.run(&sharpen, Size::List(*nodes));
        Ok(half)
    }
}

/// The paper's way: Eq. 6 on the binary field `sides` in a band around the masks' edges, from the distances to them.
fn eq6(
    gpu: &Gpu,
    atlas: &Atlas,
    params: Params,
    exact: &Buffer<[f32]>,
    sides: &Buffer<[f32]>,
    room: usize,
) -> Result<Room<Buffer<[f32]>>> {
    let (nodes, bytes) = (atlas.node_count(), 4 * atlas.node_count() as u64);
    let phi = gpu.device.storage("phi", nodes)?;
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    recorder.copy(exact, &phi, bytes);
    let front = Front::new(gpu, atlas.clone(), params, Some(phi), room)?;
    front.begin(&mut recorder);
    let look = front.look(&mut recorder);
    let landed = recorder.submit()?.wait()?;
    if let Some(wanted) = front.overflow(&landed, &look)? {
        return Ok(Room::Short(wanted));
    }
    let result = gpu.device.storage("smooth", nodes)?;
    let rule = &gpu.device.uniform("rule", rule(&[]));
    let hold = HoldSides { params: &front.params, rule, first: &front.phi, sides, result: &result }.bind(gpu);
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    [&front.phi, &front.other].into_iter().for_each(|phi| recorder.copy(sides, phi, bytes));
    front.reinit(&mut recorder, EQ6_ITERATIONS);
    recorder.run(&hold, Size::List(nodes));
    recorder.submit()?;
    Ok(Room::Enough(result))
}

/// Records that level sets get back the area that they lack of their masks.
fn restore_area(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    Front { params, jobs, blocks, atlas, .. }: &Front<'_>,
    sides: &Buffer<[f32]>,
    result: &Buffer<[f32]>,
) -> Result<()> {
    let nodes = atlas.node_count();
    let storage = |name| gpu.device.storage(name, nodes);
    let (lack, lengths, half) = (&storage("lack")?, &storage("lengths")?, &storage("half")?);
    let axes = axes(gpu, AREA_SIGMA);
    let measure = MeasureArea { params, rule: &axes[0], jobs, blocks, first: result, sides, result: lack, lengths };
    recorder.run(&measure.bind(gpu), Size::List(nodes));
    for (axis, first, result) in [(0, lack, half), (1, half, lack), (0, lengths, half), (1, half, lengths)] {
        let gaussian = Gaussian { params, rule: &axes[axis], jobs, blocks, first, result }.bind(gpu);
        recorder.run(&gaussian, Size::List(nodes));
    }
    let restore = RestoreArea { params, rule: &axes[0], first: lack, second: lengths, sides, result };
    recorder.run(&restore.bind(gpu), Size::List(nodes));
    Ok(())
}

/// Brings distances to the fixed point of the sweeps' own reinitialisation near their contours, and gives them the area of their masks back, if they
/// have some. Nothing where the distances have not settled.
fn condition(
    gpu: &Gpu,
    tiles: &DistanceBuffers<'_>,
    params: Params,
    options: ContourOptions,
    mask: Option<&Buffer<[f32]>>,
    room: usize,
) -> Result<Room<Option<Vec<Field>>>> {
    let device = &gpu.device;
    let nodes = tiles.atlas.node_count();
    let front = Front::new(gpu, tiles.atlas.clone(), params, None, room)?;
    let result = device.storage("result", nodes)?;
    let rule = Rule { conditioned: (options.half_width + CONDITIONED) as f32, ..rule(&[]) };
    let rule = &device.uniform("rule", rule);
    let Front { params, blocks, phi, .. } = &front;
    let put = PutConditioned { params, rule, blocks, first: phi, second: &tiles.d, result: &result }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.copy(&tiles.d, phi, 4 * nodes as u64);
    front.begin(&mut recorder);
    front.reinit(&mut recorder, CONDITION_ITERATIONS);
    recorder.run(&put, Size::List(nodes));
    if let Some(sides) = mask {
        restore_area(gpu, &mut recorder, &front, sides, &result)?;
    }
    let (look, changes) = (front.look(&mut recorder), tiles.ask(&mut recorder));
    let wanted: Wanted<f32> = recorder.read(&result, 0, nodes);
    let landed = recorder.submit()?.wait()?;
    if !settled_by(&landed, &changes)? {
        return Ok(Room::Enough(None));
    }
    if let Some(wanted) = front.overflow(&landed, &look)? {
        return Ok(Room::Short(wanted));
    }
    let fields = landed.taken(&wanted, |values| tiles.atlas.unpack(values))?;
    gpu.keep_tiles(result, &tiles.atlas, &fields);
    Ok(Room::Enough(Some(fields)))
}
