//! Exact distances to the other side of a mask on the GPU.

use super::Gpu;
use super::atlas::Atlas;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::{Job, Params, Side};
use super::recorder::{Recorder, Size};
use crate::error::Result;

shader! {
    exact = "common/job.wgsl" + "common/stencil.wgsl" + twin "src/reference/exact.rs";

    /// Steps to the nearest pixel of a side along each column.
    Columns for columns, "exact_columns" {
        side: Uniform Side,
        jobs: Read [Job],
        u: Read [f32],
        steps: Write [f32],
    }

    /// Lower envelope of the columns' parabolas along each row.
    Rows for rows, "exact_rows" {
        params: Uniform Params,
        side: Uniform Side,
        jobs: Read [Job],
        u: Read [f32],
        steps: Write [f32],
        feet: Write [u32],
        begins: Write [f32],
        distance: Write [f32],
    }
}

/// Records the signed exact distance to the other side of each mask `u < 0`.
pub fn exact_distance(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    atlas: &Atlas,
    params: Params,
    u: &Buffer<[f32]>,
) -> Result<Buffer<[f32]>> {
    let device = &gpu.device;
    let params = &device.uniform("params", params);
    let jobs = &device.upload("jobs", &atlas.jobs)?;
    let nodes = atlas.node_count();
    let (steps, feet) = (&device.storage("steps", nodes)?, &device.storage("feet", nodes)?);
    let (begins, distance) = (&device.storage("begins", nodes)?, device.storage("exact", nodes)?);
    let largest = |of: fn(&Job) -> u32| atlas.jobs.iter().map(of).max().unwrap_or(0) as usize;
    for inside in [1, 0] {
        let side = &device.uniform("side", Side { inside, ..Side::default() });
        let columns = Columns { side, jobs, u, steps }.bind(gpu);
        let rows = Rows { params, side, jobs, u, steps, feet, begins, distance: &distance }.bind(gpu);
        recorder.run(&columns, Size::Rows(largest(|j| j.nx), atlas.jobs.len()));
        recorder.run(&rows, Size::Rows(largest(|j| j.ny), atlas.jobs.len()));
    }
    Ok(distance)
}
