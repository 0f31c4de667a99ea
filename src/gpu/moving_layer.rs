//! Layers of an interval of a moving stack on the GPU, some times at once.

use super::Gpu;
use super::answers::Wanted;
use super::device::Buffer;
use super::kernels::shader;
use super::layout::{Image, Part, Span};
use super::moving::{bounded, image, per_pixel, tile_count};
use super::recorder::{Recorder, Size};
use super::resident::scaled;
use super::trajectories::paths;
use super::work;
use crate::backend::requests::LayerRequest;
use crate::error::{Error, Result};
use crate::reference::moving_layer::reach;

shader! {
    moving_layer = "common/job.wgsl" + "common/moving.wgsl" + "common/sample.wgsl" + "common/spline.wgsl"
        + twin "src/reference/moving_layer.rs";

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
        layers: Write [f32],
    }
}

/// Layers of all intervals, as many in one go as fit; where there is no memory for so many, half as many.
pub fn layers(gpu: &Gpu, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<Vec<f32>>>> {
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
fn layers_at_once(gpu: &Gpu, requests: &[LayerRequest<'_>], most: usize) -> Result<Vec<Vec<Vec<f32>>>> {
    let mut out: Vec<Vec<Vec<f32>>> = requests.iter().map(|of| Vec::with_capacity(of.times.len())).collect();
    let mut flight = Flight::new(gpu);
    for (q, of) in requests.iter().enumerate() {
        let nodes = of.moving.fields[of.interval].data.len();
        let vectors = of.moving.displacements[0].vectors.len();
        let parts = || of.lone.low.iter().chain(&of.lone.high);
        let lone: usize = parts().map(|part| part.field.data.len()).sum();
        // Fields lie there twice when they are new, and layers while they are read back.
        let fixed = gpu.share(4 * (8 * nodes + lone) + 16 * vectors, 0);
        let each = gpu.share(8 * nodes + 16 * vectors + 4 * tile_count(of.moving.fields[of.interval].dims), 0);
        let work = gpu.share_of_work((work::LAYER_PIXEL + work::LONE_PART * parts().count()) * nodes);
        let at_once = (1.0 / gpu.share(0, 4 * nodes).max(work)) as usize;
        let mut first = 0;
        while first < of.times.len() {
            let room = ((1.0 - flight.filled - fixed) / each).max(0.0) as usize;
            let room = room.min(most - flight.wanted.len().min(most));
            if room == 0 && flight.filled > 0.0 {
                flight.land(&mut out)?;
                continue;
            }
            let end = (first + room.min(at_once).max(1)).min(of.times.len());
            flight.add(q, of, &of.times[first..end])?;
            flight.filled += fixed + (end - first) as f64 * each;
            first = end;
        }
    }
    flight.land(&mut out)?;
    Ok(out)
}

/// Layers that are computed in one go.
struct Flight<'g> {
    gpu: &'g Gpu,
    recorder: Recorder<'g>,
    /// The request of each layer, and where the layer will be.
    wanted: Vec<(usize, Wanted<f32>)>,
    /// Share of the device that is taken.
    filled: f64,
}

impl<'g> Flight<'g> {
    fn new(gpu: &'g Gpu) -> Self {
        Flight { gpu, recorder: Recorder::new(&gpu.device, &gpu.profiler), wanted: Vec::new(), filled: 0.0 }
    }

    /// Records the layers of request `q` at these times.
    fn add(&mut self, q: usize, of: &LayerRequest<'_>, times: &[f64]) -> Result<()> {
        let (gpu, device) = (self.gpu, &self.gpu.device);
        let (low, high) = (&of.moving.fields[of.interval], &of.moving.fields[of.interval + 1]);
        let nodes = low.data.len();
        let (tiles, parts) = lone_tiles(of, 4 * nodes);
        let span = Span {
            limit: of.limit as f32,
            reach: reach(of.h) as f32,
            lower_parts: of.lone.low.len() as u32,
            all_parts: parts.len() as u32,
            relief: of.moving.relief as f32,
            empty: u32::from(of.lone.empty),
            ..Span::default()
        };
        let span = device.uniform("span", span);
        let fields = device.storage("fields", 4 * nodes + tiles.len())?;
        device.write_from(&fields, 4 * nodes, &tiles);
        // A binding must not be empty.
        let parts = device.upload("parts", &if parts.is_empty() { vec![Part::default()] } else { parts })?;
        let gap = of.moving.gap(of.interval);
        let images = [(low, 1.0), (high, 1.0), (of.slopes[0], gap), (of.slopes[1], gap)];
        for (k, image) in images.into_iter().enumerate() {
            gpu.place(&mut self.recorder, image, (&fields, k * nodes))?;
        }
        let layers = record(gpu, &mut self.recorder, of, times, (&span, &fields, &parts))?;
        let recorder = &mut self.recorder;
        self.wanted.extend((0..times.len()).map(|k| (q, recorder.read(&layers, k * nodes, nodes))));
        Ok(())
    }

    /// Computes what is recorded and puts each layer to those of its request.
    fn land(&mut self, out: &mut [Vec<Vec<f32>>]) -> Result<()> {
        let Flight { recorder, wanted, .. } = std::mem::replace(self, Flight::new(self.gpu));
        if wanted.is_empty() {
            return Ok(());
        }
        let landed = recorder.submit()?.wait()?;
        for (q, wanted) in &wanted {
            out[*q].push(landed.values(wanted)?);
        }
        Ok(())
    }
}

/// Records some layers.
fn record(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    of: &LayerRequest<'_>,
    times: &[f64],
    (span, fields, parts): (&Buffer<Span>, &Buffer<[f32]>, &Buffer<[Part]>),
) -> Result<Buffer<[f32]>> {
    let device = &gpu.device;
    let (dims, grid) = (of.moving.fields[0].dims, of.moving.displacements[0].grid);
    let vectors = &paths(gpu, recorder, of.moving, of.interval, times, of.h)?;
    let image = &device.uniform("image", image(dims, grid, of.h, times.len()));
    let table: Vec<f32> = times.iter().map(|t| *t as f32).collect();
    let table = &device.upload("times", &table)?;
    let tiles = tile_count(dims) * times.len();
    let far = &device.storage("far", tiles)?;
    let layers = device.storage("layers", dims[0] * dims[1] * times.len())?;
    let find_far = FindFar { image, span, fields, vectors, far }.bind(gpu);
    let interpolate = Interpolate { image, span, fields, vectors, times: table, parts, far, layers: &layers }.bind(gpu);
    recorder.run(&find_far, Size::List(tiles));
    recorder.run(&interpolate, per_pixel(dims, times.len()));
    Ok(layers)
}

/// Tiles of the lone parts, one after the other, the lower slice's first, and where they are among values of which so many come before.
fn lone_tiles(of: &LayerRequest<'_>, before: usize) -> (Vec<f32>, Vec<Part>) {
    let lone = of.lone;
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
        }
    });
    let parts = parts.collect();
    (values, parts)
}
