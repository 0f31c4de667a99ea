//! Layers of an interval of a moving stack on the GPU, some times at once.

use std::ops::Range;

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::{Image, Part, Span, TILE};
use super::moving::{bounded, image, tile_count};
use super::recorder::{Recorder, Size};
use super::resident::scaled;
use super::trajectories::{paths, trajectories};
use super::work;
use crate::backend::requests::LayerRequest;
use crate::error::{Error, Result};
use crate::grid::sparse_image::{SQUARE, SparseImage};
use crate::reference::moving_layer::reach;
use crate::registration::cells::{CELL, cells_of_square};
use crate::registration::lone_parts::LoneParts;
use crate::registration::motion_field::MotionField;

shader! {
    moving_layer = "common/job.wgsl" + "common/moving.wgsl" + "common/sample.wgsl" + "common/spline.wgsl"
        + "common/layer_value.wgsl" + twin "src/reference/moving_layer.rs";

    /// Tiles that are far from every contour.
    FindFar for find_far, "moving_layer_far" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        far: Write [f32],
    }

    /// Layers, pixel by pixel.
    Interpolate for interpolate, "moving_layer" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        far: Write [f32],
        tasks: Read [u32],
        layers: Write [f32],
    }

    /// Tiles of which only probes count.
    Probe for probe, "moving_layer_probe" {
        image: Uniform Image,
        span: Uniform Span,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        times: Read [f32],
        parts: Read [Part],
        far: Write [f32],
        tasks: Read [u32],
        layers: Write [f32],
    }
}

/// Pixels of a tile, which is a cell.
const OF_TILE: usize = TILE * TILE;
const _: () = assert!(TILE == CELL);

/// Layers of all intervals, as many in one go as fit; where there is no memory for so many, half as many.
pub fn layers(gpu: &Gpu, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> {
    let mut most: usize = requests.iter().map(|of| of.times.len()).sum();
    loop {
        match layers_at_once(gpu, requests, most) {
            Err(Error::GpuMemory(_)) if most > 1 => {
                gpu.release()?;
                most = most.div_ceil(2);
            }
            done => return done,
        }
    }
}

/// Layers of all intervals, as many in one go as fit, and at most so many.
fn layers_at_once(gpu: &Gpu, requests: &[LayerRequest<'_>], most: usize) -> Result<Vec<Vec<SparseImage<f32>>>> {
    let mut out: Vec<Vec<SparseImage<f32>>> = requests.iter().map(|of| Vec::with_capacity(of.times.len())).collect();
    let mut flight = Flight::new(gpu);
    for (q, of) in requests.iter().enumerate() {
        let nodes = of.moving.fields[of.interval].data.len();
        let vectors = of.moving.displacements[0].vectors.len();
        let parts = || of.lone.low.iter().chain(&of.lone.high);
        let lone: usize = parts().map(|part| part.field.data.len()).sum();
        // Fields lie there twice when they are new, and layers while they are read back.
        let fixed = gpu.share(4 * (8 * nodes + lone) + 16 * vectors, 0);
        let tiles = tile_count(of.moving.fields[of.interval].dims);
        let asked = (0..of.times.len()).map(|k| asked(of, k, tiles).filter(|asked| *asked).count()).max().unwrap_or(0);
        let values = OF_TILE * asked;
        let each = gpu.share(8 * values + 16 * vectors + 16 * tiles, 0);
        let work = gpu.share_of_work((work::LAYER_PIXEL + work::LONE_PART * parts().count()) * nodes);
        let at_once = (1.0 / gpu.share(0, 4 * values.max(tiles)).max(work)) as usize;
        let mut first = 0;
        while first < of.times.len() {
            let room = ((1.0 - flight.filled - fixed) / each).max(0.0) as usize;
            let room = room.min(most - flight.wanted.len().min(most));
            if room == 0 && flight.filled > 0.0 {
                flight.land(&mut out)?;
                continue;
            }
            let end = (first + room.min(at_once).max(1)).min(of.times.len());
            flight.add(q, of, first..end)?;
            flight.filled += fixed + (end - first) as f64 * each;
            first = end;
        }
    }
    flight.land(&mut out)?;
    Ok(out)
}

/// Whether each tile of the layer at the `k`-th time is asked for.
fn asked<'a>(of: &LayerRequest<'a>, k: usize, tiles: usize) -> impl Iterator<Item = bool> + use<'a> {
    let cells = of.wanted.map(|cells| cells[k].chosen());
    (0..tiles).map(move |tile| cells.is_none_or(|cells| cells[tile]))
}

/// Layers that are computed in one go.
struct Flight<'g, 'r> {
    gpu: &'g Gpu,
    recorder: Recorder<'g>,
    /// The request of each layer and its number there, and where its tiles will be: those asked for, and what probes say of the others.
    wanted: Vec<(usize, &'r LayerRequest<'r>, usize, [Wanted<f32>; 2])>,
    /// Share of the device that is taken.
    filled: f64,
}

impl<'g, 'r> Flight<'g, 'r> {
    fn new(gpu: &'g Gpu) -> Self {
        Flight { gpu, recorder: Recorder::new(&gpu.device, &gpu.profiler), wanted: Vec::new(), filled: 0.0 }
    }

    /// Records some layers of request `q`.
    fn add(&mut self, q: usize, of: &'r LayerRequest<'r>, some: Range<usize>) -> Result<()> {
        let (gpu, device) = (self.gpu, &self.gpu.device);
        let (low, high) = (&of.moving.fields[of.interval], &of.moving.fields[of.interval + 1]);
        let nodes = low.data.len();
        let tiles = tile_count(low.dims);
        // Tiles that are asked for, and the others, of all layers.
        let mut tasks: [Vec<u32>; 2] = Default::default();
        let mut counts: Vec<[usize; 2]> = Vec::with_capacity(some.len());
        for (layer, k) in some.clone().enumerate() {
            let before = tasks.each_ref().map(Vec::len);
            for (tile, asked) in asked(of, k, tiles).enumerate() {
                tasks[usize::from(!asked)].push((layer * tiles + tile) as u32);
            }
            counts.push([0, 1].map(|other| tasks[other].len() - before[other]));
        }
        let (lone, parts) = lone_tiles(of.lone, 4 * nodes);
        let span = Span {
            asked: tasks[0].len() as u32,
            others: tasks[1].len() as u32,
            ..span(of.moving, of.lone, of.limit, of.h)
        };
        let span = device.uniform("span", span);
        let fields = device.storage("fields", 4 * nodes + lone.len())?;
        device.write_from(&fields, 4 * nodes, &lone);
        let parts = device.upload("parts", &parts)?;
        let gap = of.moving.gap(of.interval);
        let slopes = of.slopes.map(|slopes| (slopes, gap, of.moving.px));
        let images = [(low, 1.0, 1.0), (high, 1.0, 1.0), slopes[0], slopes[1]];
        for (k, image) in images.into_iter().enumerate() {
            gpu.place(&mut self.recorder, image, (&fields, k * nodes))?;
        }
        let layers = record(gpu, &mut self.recorder, of, &of.times[some.clone()], (&span, &fields, &parts), &tasks)?;
        let mut first = [0, 0];
        for (k, count) in some.zip(counts) {
            let [own, others] = [OF_TILE, 1];
            let wanted = [
                self.recorder.read(&layers[0], own * first[0], own * count[0]),
                self.recorder.read(&layers[1], others * first[1], others * count[1]),
            ];
            self.wanted.push((q, of, k, wanted));
            first = [0, 1].map(|other| first[other] + count[other]);
        }
        Ok(())
    }

    /// Computes what is recorded and puts each layer to those of its request.
    fn land(&mut self, out: &mut [Vec<SparseImage<f32>>]) -> Result<()> {
        let Flight { recorder, wanted, .. } = std::mem::replace(self, Flight::new(self.gpu));
        if wanted.is_empty() {
            return Ok(());
        }
        let landed = recorder.submit()?.wait()?;
        let made = wanted.par_iter().map(|(q, of, k, [own, others])| {
            let made = landed.taken(own, |own| landed.taken(others, |others| layer(of, *k, [own, others])))?;
            Ok((*q, made?))
        });
        for (q, layer) in made.collect::<Result<Vec<_>>>()? {
            out[q].push(layer);
        }
        Ok(())
    }
}

/// The layer at the `k`-th time from the values of its tiles and what probes say of the others.
fn layer(of: &LayerRequest<'_>, k: usize, [own, others]: [&[f32]; 2]) -> SparseImage<f32> {
    let dims = of.moving.fields[of.interval].dims;
    let mut next = [0, 0];
    let place = |asked: bool| {
        let next = &mut next[usize::from(!asked)];
        *next += 1;
        (asked, *next - 1)
    };
    let places: Vec<(bool, usize)> = asked(of, k, tile_count(dims)).map(place).collect();
    let columns = dims[0].div_ceil(CELL);
    let [out] = SparseImage::of_squares(dims, |square, [out]| {
        for [left, top] in cells_of_square(square, dims) {
            let (asked, place) = places[top / CELL * columns + left / CELL];
            let rows = out[top % SQUARE * SQUARE..].chunks_mut(SQUARE).take(CELL);
            for (y, row) in rows.map(|row| &mut row[left % SQUARE..][..CELL]).enumerate() {
                match asked {
                    true => row.copy_from_slice(&own[OF_TILE * place + CELL * y..][..CELL]),
                    false => row.fill(others[place]),
                }
            }
        }
        [None]
    });
    out
}

/// Records some layers: the values of the tiles of the first tasks, and what probes say of those of the second.
fn record(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    of: &LayerRequest<'_>,
    times: &[f64],
    (span, fields, parts): (&Buffer<Span>, &Buffer<[f32]>, &Buffer<[Part]>),
    [own, others]: &[Vec<u32>; 2],
) -> Result<[Buffer<[f32]>; 2]> {
    let device = &gpu.device;
    let (dims, grid) = (of.moving.fields[0].dims, of.moving.displacements[0].grid);
    let followed = &trajectories(gpu, of.moving, of.interval)?;
    let vectors = &paths(gpu, recorder, followed, (grid, dims), times, of.h, None)?;
    let image = &device.uniform("image", image(dims, grid, of.h, times.len()));
    let table: Vec<f32> = times.iter().map(|t| *t as f32).collect();
    let table = &device.upload("times", &table)?;
    let tiles = tile_count(dims) * times.len();
    let far = &device.storage("far", tiles)?;
    let layers = [device.storage("layers", OF_TILE * own.len())?, device.storage("sides", others.len())?];
    let find_far = FindFar { image, span, fields, vectors, far }.bind(gpu);
    recorder.run(&find_far, Size::List(tiles));
    if !own.is_empty() {
        let (tasks, layers) = (&device.upload("tiles", own)?, &layers[0]);
        let interpolate = Interpolate { image, span, fields, vectors, times: table, parts, far, tasks, layers };
        recorder.run(&interpolate.bind(gpu), Size::List(OF_TILE * own.len()));
    }
    if !others.is_empty() {
        let (tasks, layers) = (&device.upload("other tiles", others)?, &layers[1]);
        let probe = Probe { image, span, fields, vectors, times: table, parts, far, tasks, layers };
        recorder.run(&probe.bind(gpu), Size::List(others.len()));
    }
    Ok(layers)
}

/// What the layers of an interval share.
pub fn span(moving: &MotionField, lone: &LoneParts, limit: f64, h: [f64; 2]) -> Span {
    Span {
        limit: limit as f32,
        reach: reach(h) as f32,
        lower_parts: lone.low.len() as u32,
        all_parts: (lone.low.len() + lone.high.len()) as u32,
        relief: moving.relief as f32,
        empty: u32::from(lone.empty),
        ..Span::default()
    }
}

/// Tiles of the lone parts, one after the other, the lower slice's first, and where they are among values of which so many come before.
pub fn lone_tiles(lone: &LoneParts, before: usize) -> (Vec<f32>, Vec<Part>) {
    let mut values: Vec<f32> = Vec::new();
    let parts = lone.low.iter().chain(&lone.high).map(|part| {
        let first = before + values.len();
        values.extend(scaled(&part.field, 1.0));
        Part {
            first: first as u32,
            nx: part.tile.dims[0] as u32,
            ny: part.tile.dims[1] as u32,
            x: part.tile.origin[0] as i32,
            y: part.tile.origin[1] as i32,
            depth: part.depth as f32,
            height: bounded(part.height),
            shrinking: part.profile.shrinking() as f32,
            farthest: bounded(part.farthest),
            open: u32::from(part.open),
            hole: u32::from(part.hole),
        }
    });
    // A binding must not be empty.
    let parts: Vec<Part> = parts.collect();
    (values, if parts.is_empty() { vec![Part::default()] } else { parts })
}
