//! Level sets of slices on the GPU: anti-aliasing, distance, conditioning.

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::{Atlas, in_batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::buffer::Buffer;
use super::distance::DistanceBuffers;
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
    let values: Vec<(Field, bool)> = slices
        .par_iter()
        .map(|job| match &*job.slice {
            PaddedSlice::Mask(mask) => {
                (Field { dims: job.dims, data: mask.iter().map(|&m| if m { -0.5 } else { 0.5 }).collect() }, true)
            }
            PaddedSlice::Level(u) => (u.clone(), false),
        })
        .collect();
    let mut out: Vec<Option<Field>> = slices.iter().map(|_| None).collect();
    let share = |k: &usize| {
        let nodes = padded(values[*k].0.data.len());
        let room = places(crossings(&values[*k].0), options.half_width + CONDITION_WIDER, nodes);
        let share = gpu.share(nodes * BYTES + room * PLACE_BYTES, 4 * nodes);
        share.max(gpu.share_of_work((work::CONTOUR_PIXEL * nodes).max(work::BAND_PLACE * room)))
    };
    // Masks and grey slices take different ways.
    for masks in [true, false] {
        let open: Vec<usize> =
            (0..slices.len()).into_par_iter().filter(|&k| values[k].1 == masks && values[k].0.has_inside()).collect();
        let shares: Vec<f64> = open.par_iter().map(share).collect();
        let fields = in_batches(gpu, shares, |batch| {
            let batch = &open[batch];
            let fields: Vec<&Field> = batch.iter().map(|&k| &values[k].0).collect();
            let smooth = if masks { options.anti_alias } else { AntiAlias::None };
            let result = run(gpu, &fields, h, options, smooth)?;
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

fn run(gpu: &Gpu, u: &[&Field], h: [f64; 2], options: ContourOptions, smooth: AntiAlias) -> Result<Vec<Field>> {
    let atlas = Atlas::new(u.iter().map(|f| f.dims));
    let params = Params {
        hx: h[0] as f32,
        hy: h[1] as f32,
        gamma: (options.half_width + CONDITION_WIDER) as f32,
        step_share: 1.0,
        ..Params::default()
    };
    let room_of = |f: &&Field| places(crossings(f), options.half_width + CONDITION_WIDER, f.data.len());
    let room = u.par_iter().map(room_of).sum::<usize>() + SPARE_PLACES;
    let sent = |label| atlas.send(&gpu.device, label, u.iter().copied(), 1.0);
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    // The masks are asked for again where their level sets were smoothed by a kernel.
    let (source, sides) = match smooth {
        AntiAlias::None => (sent("level")?, None),
        AntiAlias::Kernel => {
            let sides = sent("sides")?;
            (kernel(gpu, &mut recorder, &atlas, params, &sides, options.sigma)?, Some(sides))
        }
        AntiAlias::Eq6 => {
            let sides = &sent("sides")?;
            let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
            let exact = exact_distance(gpu, &mut recorder, &atlas, params, sides)?;
            let wanted: Wanted<f32> = recorder.read(&exact, 0, atlas.node_count());
            let exact = recorder.submit()?.wait()?.values(&wanted)?;
            let packed = atlas.pack(u.iter().copied(), 1.0);
            (with_room(room, atlas.node_count(), |room| eq6(gpu, &atlas, params, &exact, &packed, sides, room))?, None)
        }
    };
    let tiles = DistanceBuffers::new(gpu, atlas.clone(), params, source)?;
    let mut recorder = tiles.solve(recorder, false)?;
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

/// Records `2 G - G * G` of the masks, on their sides.
fn kernel(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    atlas: &Atlas,
    params: Params,
    sides: &Buffer<[f32]>,
    sigma: f64,
) -> Result<Buffer<[f32]>> {
    let device = &gpu.device;
    let shape = Params { job_count: atlas.jobs.len() as u32, block_count: atlas.block_count() as u32, ..params };
    let params = &device.uniform("params", shape);
    let jobs = &device.upload("jobs", &atlas.jobs)?;
    let blocks = &atlas.send_blocks(device)?;
    let nodes = atlas.node_count();
    let half = device.storage("half", nodes)?;
    let once = &device.storage("once", nodes)?;
    let twice = &device.storage("twice", nodes)?;
    let axes = axes(gpu, sigma);
    for (axis, first, result) in [(0, sides, &half), (1, &half, once), (0, once, &half), (1, &half, twice)] {
        let gaussian = Gaussian { params, rule: &axes[axis], jobs, blocks, first, result }.bind(gpu);
        recorder.run(&gaussian, Size::List(nodes));
    }
    let sharpen = Sharpen { params, rule: &axes[0], first: once, second: twice, sides, result: &half }.bind(gpu);
    recorder.run(&sharpen, Size::List(nodes));
    Ok(half)
}

/// The paper's way: Eq. 6 on the binary field in a band around the masks' edges.
fn eq6(
    gpu: &Gpu,
    atlas: &Atlas,
    params: Params,
    exact: &[f32],
    binary: &[f32],
    sides: &Buffer<[f32]>,
    room: usize,
) -> Result<Room<Buffer<[f32]>>> {
    let exact = gpu.device.upload("phi", exact)?;
    let front = Front::new(gpu, atlas.clone(), params, Some(exact), room)?;
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    front.begin(&mut recorder);
    let look = front.look(&mut recorder);
    let landed = recorder.submit()?.wait()?;
    if let Some(wanted) = front.overflow(&landed, &look)? {
        return Ok(Room::Short(wanted));
    }
    front.replace_phi(binary);
    let result = gpu.device.storage("smooth", atlas.node_count())?;
    let rule = &gpu.device.uniform("rule", rule(&[]));
    let hold = HoldSides { params: &front.params, rule, first: &front.phi, sides, result: &result }.bind(gpu);
    let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
    front.reinit(&mut recorder, EQ6_ITERATIONS);
    recorder.run(&hold, Size::List(atlas.node_count()));
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
/// have some.
fn condition(
    gpu: &Gpu,
    tiles: &DistanceBuffers<'_>,
    params: Params,
    options: ContourOptions,
    mask: Option<&Buffer<[f32]>>,
    room: usize,
) -> Result<Room<Vec<Field>>> {
    let device = &gpu.device;
    let nodes = tiles.atlas.node_count();
    let front = Front::new(gpu, tiles.atlas.clone(), params, None, room)?;
    let result = &device.storage("result", nodes)?;
    let rule = Rule { conditioned: (options.half_width + CONDITIONED) as f32, ..rule(&[]) };
    let rule = &device.uniform("rule", rule);
    let Front { params, blocks, phi, .. } = &front;
    let put = PutConditioned { params, rule, blocks, first: phi, second: &tiles.d, result }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.copy(&tiles.d, phi, 4 * nodes as u64);
    front.begin(&mut recorder);
    front.reinit(&mut recorder, CONDITION_ITERATIONS);
    recorder.run(&put, Size::List(nodes));
    if let Some(sides) = mask {
        restore_area(gpu, &mut recorder, &front, sides, result)?;
    }
    let look = front.look(&mut recorder);
    let wanted: Wanted<f32> = recorder.read(result, 0, nodes);
    let landed = recorder.submit()?.wait()?;
    match front.overflow(&landed, &look)? {
        Some(wanted) => Ok(Room::Short(wanted)),
        None => Ok(Room::Enough(landed.taken(&wanted, |values| tiles.atlas.unpack(values))?)),
    }
}
