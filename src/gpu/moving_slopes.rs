//! Slopes of the fields of a moving stack on the GPU, some slices at a time.

use std::ops::Range;

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::in_batches;
use super::kernels::shader;
use super::layout::{ABOVE, BELOW, BOTH, Image, Knot};
use super::moving::{image, per_pixel, send_vectors};
use super::recorder::Recorder;
use super::work;
use crate::error::Result;
use crate::grid::field::{Field, VALUES_OF_A_THREAD};
use crate::progress::Progress;
use crate::registration::motion_field::MotionField;

shader! {
    moving_slopes = "common/job.wgsl" + "common/moving.wgsl" + "common/sample.wgsl" + "common/spline.wgsl"
        + twin "src/reference/moving_slopes.rs";

    /// Slopes at the slices of `knots`.
    FindSlopes for find_slopes, "moving_slopes" {
        image: Uniform Image,
        fields: Read [f32],
        vectors: Read [[f32; 2]],
        knots: Read [Knot],
        slopes: Write [f32],
    }
}

/// Slices that a slope reads on either side of its own.
const HALO: usize = 2;

/// Slopes at the `wanted` slices, per height.
pub fn slopes(gpu: &Gpu, moving: &MotionField, wanted: Range<usize>, progress: &dyn Progress) -> Result<Vec<Field>> {
    let slices = wanted.len();
    let nodes = moving.fields[0].data.len();
    let bytes = 4 * nodes + 16 * moving.displacements[0].vectors.len();
    // Slopes lie there twice while they are read back, and so do fields when they are new.
    let share = |_| {
        let share = gpu.share_beside(4 * HALO * bytes, 2 * bytes + 8 * nodes, 4 * nodes * (1 + 2 * HALO));
        share.max(gpu.share_of_work(work::SLOPE_PIXEL * nodes))
    };
    in_batches(gpu, (0..slices).map(share), |batch| {
        let found = of_slices(gpu, moving, wanted.start + batch.start..wanted.start + batch.end)?;
        progress.advance(batch.len());
        Ok(found)
    })
}

fn of_slices(gpu: &Gpu, moving: &MotionField, batch: Range<usize>) -> Result<Vec<Field>> {
    let device = &gpu.device;
    let last = moving.fields.len() - 1;
    let (dims, grid) = (moving.fields[0].dims, moving.displacements[0].grid);
    let (first, end) = (batch.start.saturating_sub(HALO), (batch.end + HALO).min(last + 1));
    let gap = |k: usize| moving.gaps.get(k).copied().unwrap_or(0.0);
    let knot = |s: usize| {
        let (sides, gaps) = match s {
            0 => (ABOVE, [gap(0), gap(1)]),
            s if s == last => (BELOW, [gap(last - 1), last.checked_sub(2).map_or(0.0, gap)]),
            s => (BOTH, [gap(s - 1), gap(s)]),
        };
        let farther = if sides == BOTH { [s.checked_sub(2).map_or(0.0, gap), gap(s + 1)] } else { [0.0; 2] };
        let [gaps, farther] = [gaps, farther].map(|gaps| gaps.map(|g| (g / moving.px) as f32));
        let (relief, doubt) = (moving.relief as f32, moving.doubt as f32);
        Knot { slice: (s - first) as u32, sides, gaps, farther, relief, doubt }
    };
    let knots: Vec<Knot> = batch.clone().map(knot).collect();
    let image = &device.uniform("image", image(dims, grid, [1.0; 2], batch.len()));
    let nodes = dims[0] * dims[1];
    let fields = &device.storage("slices", (end - first) * nodes)?;
    let mut recorder = Recorder::new(device, &gpu.profiler);
    for (k, field) in moving.fields[first..end].iter().enumerate() {
        gpu.place(&mut recorder, (field, 1.0, 1.0), (fields, k * nodes))?;
    }
    let at_slices = moving.at_slices[first..end - 1].iter().flat_map(|both| both.iter());
    let vectors = &send_vectors(device, "vectors", at_slices)?;
    let knots = &device.upload("knots", &knots)?;
    let slopes = device.storage("slopes", batch.len() * nodes)?;
    let find = FindSlopes { image, fields, vectors, knots, slopes: &slopes }.bind(gpu);
    recorder.run(&find, per_pixel(dims, batch.len()));
    let wanted: Wanted<f32> = recorder.read(&slopes, 0, batch.len() * nodes);
    let values =
        |some: &[f32]| some.par_iter().with_min_len(VALUES_OF_A_THREAD).map(|v| f64::from(*v) / moving.px).collect();
    let field = |some: &[f32]| Field { dims, data: values(some) };
    let landed = recorder.submit()?.wait()?;
    let fields: Vec<Field> = landed.taken(&wanted, |values| values.par_chunks_exact(nodes).map(field).collect())?;
    // A quotient times its divisor is the number again as soon as it is rounded to half of the digits.
    gpu.keep_images(slopes, moving.px, &fields);
    Ok(fields)
}
