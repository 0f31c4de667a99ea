//! From slices to level sets on the GPU: anti-aliasing, distance, conditioning.

use super::Gpu;
use super::atlas::{Atlas, batches, padded};
use super::band::{Front, NODE_BYTES, PLACE_BYTES, Room, SPARE_PLACES, crossings, places, with_room};
use super::device::Buffer;
use super::distance::DistanceBuffers;
use super::kernels::{Recorder, Size};
use super::layout::{Params, Rule, Side};
use crate::backend::conditioning::{
    CONDITION_ITERATIONS, CONDITION_WIDER, CONDITIONED, EQ6_ITERATIONS, FIELD_FLOOR, KERNEL_CLIP, MASK_FLOOR,
    gaussian_weights,
};
use crate::backend::{ContourOptions, PaddedSlice};
use crate::error::Result;
use crate::gpu::coalesce::SliceJob;
use crate::grid::field::Field;
use crate::progress::Progress;
use crate::settings::AntiAlias;

/// Bytes per node: the slice, the distance, the exact distance and its three scratch arrays, the band's own.
const BYTES: usize = NODE_BYTES + 24;

/// Level sets of all slices; `inf` where a slice is empty.
pub fn contour_fields(
    gpu: &Gpu,
    slices: &[SliceJob<'_>],
    h: [f64; 2],
    options: ContourOptions,
    progress: &dyn Progress,
) -> Result<Vec<Field>> {
    let values: Vec<(Field, bool)> = slices
        .iter()
        .map(|job| match &*job.slice {
            PaddedSlice::Mask(mask) => {
                (Field { dims: job.dims, data: mask.iter().map(|&m| if m { -0.5 } else { 0.5 }).collect() }, true)
            }
            PaddedSlice::Level(u) => (u.clone(), false),
        })
        .collect();
    let mut out: Vec<Field> = slices.iter().map(|job| Field::filled(job.dims, f64::INFINITY)).collect();
    let share = |k: &usize| {
        let nodes = padded(values[*k].0.data.len());
        let room = places(crossings(&values[*k].0), options.half_width + CONDITION_WIDER, nodes);
        gpu.share(nodes * BYTES + room * PLACE_BYTES, 4 * nodes)
    };
    // Masks and grey slices take different ways.
    for masks in [true, false] {
        let open: Vec<usize> =
            (0..slices.len()).filter(|&k| values[k].1 == masks && values[k].0.has_inside()).collect();
        for batch in batches(open.iter().map(share)) {
            let batch = &open[batch];
            let fields: Vec<&Field> = batch.iter().map(|&k| &values[k].0).collect();
            let smooth = if masks { options.anti_alias } else { AntiAlias::None };
            let result = run(gpu, &fields, h, options, smooth)?;
            for (&k, field) in batch.iter().zip(result) {
                out[k] = field;
            }
            progress.advance(batch.len());
        }
    }
    progress.advance(values.iter().filter(|(f, _)| !f.has_inside()).count());
    Ok(out)
}

fn run(gpu: &Gpu, u: &[&Field], h: [f64; 2], options: ContourOptions, smooth: AntiAlias) -> Result<Vec<Field>> {
    let atlas = Atlas::new(u.iter().map(|f| f.dims));
    let packed = atlas.pack(u.iter().copied(), 1.0);
    let params = Params {
        hx: h[0] as f32,
        hy: h[1] as f32,
        gamma: (options.half_width + CONDITION_WIDER) as f32,
        step_share: 1.0,
        ..Params::default()
    };
    let room_of = |f: &&Field| places(crossings(f), options.half_width + CONDITION_WIDER, f.data.len());
    let room = u.iter().map(room_of).sum::<usize>() + SPARE_PLACES;
    let sides = gpu.device.upload("sides", &packed)?;
    let source = match smooth {
        AntiAlias::None => None,
        AntiAlias::Kernel => Some(kernel(gpu, &atlas, params, &sides, options.sigma)?),
        AntiAlias::Eq6 => {
            let exact = exact_distance(gpu, &atlas, params, &sides)?;
            let exact = gpu.device.read::<f32>(&exact, 0, atlas.node_count())?;
            Some(with_room(room, atlas.node_count(), |room| eq6(gpu, &atlas, params, &exact, &packed, &sides, room))?)
        }
    };
    let tiles =
        DistanceBuffers::new(gpu, atlas.clone(), params, source.unwrap_or(gpu.device.upload("level", &packed)?))?;
    tiles.solve(false)?;
    if smooth == AntiAlias::Kernel {
        let exact = exact_distance(gpu, &atlas, params, &sides)?;
        let rule = gpu.device.uniform("rule", rule(&[]));
        let limit = gpu
            .kernels
            .limit
            .bind(&gpu.device, &[("params", &tiles.params), ("rule", &rule), ("first", &exact), ("result", &tiles.d)]);
        let mut work = Recorder::new(&gpu.device, &gpu.profiler);
        work.run(&limit, tiles.per_node());
        work.submit()?;
    }
    let fields = with_room(room, atlas.node_count(), |room| condition(gpu, &tiles, params, options, room))?;
    Ok(atlas.unpack(&fields))
}

fn rule(weights: &[f64]) -> Rule {
    let mut out = Rule {
        reach: (weights.len() / 2) as u32,
        mask_floor: MASK_FLOOR as f32,
        field_floor: FIELD_FLOOR as f32,
        kernel_clip: KERNEL_CLIP as f32,
        ..Rule::default()
    };
    for (k, &w) in weights.iter().enumerate() {
        out.weights[k / 4][k % 4] = w as f32;
    }
    out
}

/// `2 G - G * G` of the masks, on their sides.
fn kernel(gpu: &Gpu, atlas: &Atlas, params: Params, sides: &Buffer, sigma: f64) -> Result<Buffer> {
    let (device, k) = (&gpu.device, &gpu.kernels);
    let shape = Params { job_count: atlas.jobs.len() as u32, block_count: atlas.block_count() as u32, ..params };
    let params = device.uniform("params", shape);
    let jobs = device.upload("jobs", &atlas.jobs)?;
    let blocks = device.upload("blocks", &atlas.blocks())?;
    let nodes = atlas.node_count();
    let half = device.storage::<f32>("half", nodes)?;
    let once = device.storage::<f32>("once", nodes)?;
    let twice = device.storage::<f32>("twice", nodes)?;
    let weights = rule(&gaussian_weights(sigma));
    let axes = [0, 1].map(|vertical| device.uniform("rule", Rule { vertical, ..weights }));
    let mut work = Recorder::new(device, &gpu.profiler);
    for (axis, from, to) in [(0, sides, &half), (1, &half, &once), (0, &once, &half), (1, &half, &twice)] {
        let bound = k.gaussian.bind(
            device,
            &[
                ("params", &params),
                ("rule", &axes[axis]),
                ("jobs", &jobs),
                ("blocks", &blocks),
                ("first", from),
                ("result", to),
            ],
        );
        work.run(&bound, Size::List(nodes));
    }
    let sharpen = k.sharpen.bind(
        device,
        &[
            ("params", &params),
            ("rule", &axes[0]),
            ("first", &once),
            ("second", &twice),
            ("sides", sides),
            ("result", &half),
        ],
    );
    work.run(&sharpen, Size::List(nodes));
    work.submit()?;
    Ok(half)
}

/// Signed exact distance to the other side of each mask.
pub fn exact_distance(gpu: &Gpu, atlas: &Atlas, params: Params, sides: &Buffer) -> Result<Buffer> {
    let (device, k) = (&gpu.device, &gpu.kernels);
    let params = device.uniform("params", params);
    let jobs = device.upload("jobs", &atlas.jobs)?;
    let nodes = atlas.node_count();
    let (steps, feet) = (device.storage::<f32>("steps", nodes)?, device.storage::<u32>("feet", nodes)?);
    let (begins, distance) = (device.storage::<f32>("begins", nodes)?, device.storage::<f32>("exact", nodes)?);
    let largest = |of: fn(&super::layout::Job) -> u32| atlas.jobs.iter().map(of).max().unwrap_or(0) as usize;
    let mut work = Recorder::new(device, &gpu.profiler);
    for inside in [1u32, 0] {
        let side = device.uniform("side", Side { inside, ..Side::default() });
        let columns =
            k.exact_columns.bind(device, &[("side", &side), ("jobs", &jobs), ("u", sides), ("steps", &steps)]);
        let rows = k.exact_rows.bind(
            device,
            &[
                ("params", &params),
                ("side", &side),
                ("jobs", &jobs),
                ("u", sides),
                ("steps", &steps),
                ("feet", &feet),
                ("begins", &begins),
                ("distance", &distance),
            ],
        );
        work.run(&columns, Size::Rows(largest(|j| j.nx), atlas.jobs.len()));
        work.run(&rows, Size::Rows(largest(|j| j.ny), atlas.jobs.len()));
    }
    work.submit()?;
    Ok(distance)
}

/// The paper's way: Eq. 6 on the binary field in a band around the masks' edges.
fn eq6(
    gpu: &Gpu,
    atlas: &Atlas,
    params: Params,
    exact: &[f32],
    binary: &[f32],
    sides: &Buffer,
    room: usize,
) -> Result<Room<Buffer>> {
    let front = Front::new(gpu, atlas.clone(), params, Some(exact), room)?;
    let mut work = Recorder::new(&gpu.device, &gpu.profiler);
    front.begin(&mut work);
    work.submit()?;
    if let Some(wanted) = front.overflow()? {
        return Ok(Room::Short(wanted));
    }
    front.replace_phi(binary);
    let result = gpu.device.storage::<f32>("smooth", atlas.node_count())?;
    let rule = gpu.device.uniform("rule", rule(&[]));
    let hold = gpu.kernels.hold_sides.bind(
        &gpu.device,
        &[("params", &front.params), ("rule", &rule), ("first", &front.phi), ("sides", sides), ("result", &result)],
    );
    let mut work = Recorder::new(&gpu.device, &gpu.profiler);
    front.reinit(&mut work, EQ6_ITERATIONS);
    work.run(&hold, Size::List(atlas.node_count()));
    work.submit()?;
    Ok(Room::Enough(result))
}

/// Brings distances to the fixed point of the sweeps' own reinitialisation near their contours.
fn condition(
    gpu: &Gpu,
    tiles: &DistanceBuffers<'_>,
    params: Params,
    options: ContourOptions,
    room: usize,
) -> Result<Room<Vec<f32>>> {
    let device = &gpu.device;
    let nodes = tiles.atlas.node_count();
    let front = Front::new(gpu, tiles.atlas.clone(), params, None, room)?;
    let result = device.storage::<f32>("result", nodes)?;
    let rule = Rule { conditioned: (options.half_width + CONDITIONED) as f32, ..rule(&[]) };
    let rule = device.uniform("rule", rule);
    let buffers = [
        ("params", &front.params),
        ("rule", &rule),
        ("blocks", &front.blocks),
        ("first", &front.phi),
        ("second", &tiles.d),
        ("result", &result),
    ];
    let put = gpu.kernels.put_conditioned.bind(device, &buffers);
    let mut work = Recorder::new(device, &gpu.profiler);
    work.copy(&tiles.d, &front.phi, 4 * nodes as u64);
    front.begin(&mut work);
    front.reinit(&mut work, CONDITION_ITERATIONS);
    work.run(&put, Size::List(nodes));
    work.submit()?;
    match front.overflow()? {
        Some(wanted) => Ok(Room::Short(wanted)),
        None => Ok(Room::Enough(device.read(&result, 0, nodes)?)),
    }
}
