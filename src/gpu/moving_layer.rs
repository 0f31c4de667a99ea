//! Layers of an interval of a moving stack on the GPU, some times at once.

use super::Gpu;
use super::atlas::in_batches;
use super::device::Buffer;
use super::kernels::shader;
use super::layout::{Image, Part, Span};
use super::moving::{bounded, image, per_pixel, tile_count};
use super::recorder::{Recorder, Size};
use super::trajectories::paths;
use super::work;
use crate::backend::requests::LayerRequest;
use crate::error::Result;
use crate::grid::field::Field;
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

/// Layers at these times.
pub fn layers(gpu: &Gpu, of: &LayerRequest<'_>) -> Result<Vec<Vec<f32>>> {
    let times = of.times;
    let device = &gpu.device;
    let dims = of.moving.fields[0].dims;
    let nodes = dims[0] * dims[1];
    let (values, parts) = values(of);
    let vectors = of.moving.displacements[0].vectors.len();
    // Layers lie there twice while they are read back.
    let bytes = 8 * nodes + 16 * vectors + 4 * tile_count(dims);
    let work = gpu.share_of_work((work::LAYER_PIXEL + work::LONE_PART * parts.len()) * nodes);
    let share = |_: &f64| gpu.share_beside(4 * values.len() + 16 * vectors, bytes, 4 * nodes).max(work);
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
    let fields = device.upload("fields", &values)?;
    // A binding must not be empty.
    let parts = device.upload("parts", &if parts.is_empty() { vec![Part::default()] } else { parts })?;
    in_batches(gpu, times.iter().map(share), |batch| {
        let layers = batch_of_layers(gpu, of, &times[batch.clone()], (&span, &fields, &parts))?;
        let read = device.read(&layers, 0, batch.len() * nodes)?;
        Ok(read.chunks_exact(nodes).map(<[f32]>::to_vec).collect())
    })
}

fn batch_of_layers(
    gpu: &Gpu,
    of: &LayerRequest<'_>,
    times: &[f64],
    (span, fields, parts): (&Buffer<Span>, &Buffer<[f32]>, &Buffer<[Part]>),
) -> Result<Buffer<[f32]>> {
    let device = &gpu.device;
    let (dims, grid) = (of.moving.fields[0].dims, of.moving.displacements[0].grid);
    let vectors = &paths(gpu, of.moving, of.interval, times, of.h)?;
    let image = &device.uniform("image", image(dims, grid, of.h, times.len()));
    let table: Vec<f32> = times.iter().map(|t| *t as f32).collect();
    let table = &device.upload("times", &table)?;
    let tiles = tile_count(dims) * times.len();
    let far = &device.storage("far", tiles)?;
    let layers = device.storage("layers", dims[0] * dims[1] * times.len())?;
    let find_far = FindFar { image, span, fields, vectors, far }.bind(gpu);
    let interpolate = Interpolate { image, span, fields, vectors, times: table, parts, far, layers: &layers }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&find_far, Size::List(tiles));
    recorder.run(&interpolate, per_pixel(dims, times.len()));
    recorder.submit()?;
    Ok(layers)
}

/// Both slices, their slopes per interval, and the tiles of lone parts, one after the other; and where those tiles are, the lower slice's
/// first.
fn values(of: &LayerRequest<'_>) -> (Vec<f32>, Vec<Part>) {
    let LayerRequest { moving, slopes, lone, interval: i, .. } = *of;
    let gap = moving.gap(i);
    let mut values: Vec<f32> = Vec::new();
    let mut put = |field: &Field, scale: f64| {
        let first = values.len();
        values.extend(field.data.iter().map(|v| bounded(scale * v)));
        first as u32
    };
    put(&moving.fields[i], 1.0);
    put(&moving.fields[i + 1], 1.0);
    put(slopes[0], gap);
    put(slopes[1], gap);
    let parts = lone.low.iter().chain(&lone.high).map(|part| Part {
        first: put(&part.field, 1.0),
        nx: part.tile.dims[0] as u32,
        ny: part.tile.dims[1] as u32,
        x: part.tile.origin[0] as i32,
        y: part.tile.origin[1] as i32,
        depth: part.depth as f32,
        height: bounded(part.height),
        shrinking: part.profile.shrinking() as f32,
        farthest: bounded(part.farthest),
    });
    let parts = parts.collect();
    (values, parts)
}
