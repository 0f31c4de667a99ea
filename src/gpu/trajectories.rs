//! Paths through the layers of an interval on the GPU.

use super::Gpu;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::{Image, Time};
use super::moving::{image, send_vectors};
use super::recorder::{Recorder, Size};
use crate::error::Result;
use crate::registration::motion_field::MotionField;

shader! {
    trajectories = "common/job.wgsl" + "common/moving.wgsl" + twin "src/registration/motion_field.rs";

    /// The way through each node, from both slices.
    Follow for follow, "trajectories" {
        image: Uniform Image,
        vectors: Read [[f32; 2]],
        times: Read [Time],
        paths: Write [[f32; 2]],
    }
}

/// What the paths of interval `i` follow from: its displacement, and the rates at its slices.
pub fn trajectories(gpu: &Gpu, moving: &MotionField, i: usize) -> Result<Buffer<[[f32; 2]]>> {
    let [low, high] = &*moving.through_middle[i];
    send_vectors(&gpu.device, "vectors", [&*moving.displacements[i], low, high])
}

/// Records the paths of the layers of an interval at these times, which follow from its `trajectories` on such a grid of nodes: vectors from the lower
/// slice per node, then those to the upper one, time by time, and `behind` them these others.
pub fn paths(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    trajectories: &Buffer<[[f32; 2]]>,
    (grid, dims): ([usize; 2], [usize; 2]),
    times: &[f64],
    h: [f64; 2],
    behind: Option<&Buffer<[[f32; 2]]>>,
) -> Result<Buffer<[[f32; 2]]>> {
    let device = &gpu.device;
    let nodes: usize = grid.iter().product();
    let table: Vec<Time> = times
        .iter()
        .map(|&t| Time { t: t as f32, first: (t * (t - 1.0) * (t - 1.0)) as f32, second: (t * t * (t - 1.0)) as f32 })
        .collect();
    let image = &device.uniform("image", image(dims, grid, h, times.len()));
    let table = &device.upload("times", &table)?;
    let (own, bytes) = (2 * nodes * times.len(), behind.map_or(0, |behind| behind.raw.bytes()));
    let each = size_of::<[f32; 2]>();
    let paths = device.storage("paths", own + bytes as usize / each)?;
    if let Some(behind) = behind {
        recorder.copy_part((behind, 0), (&paths, (own * each) as u64), bytes);
    }
    let follow = Follow { image, vectors: trajectories, times: table, paths: &paths }.bind(gpu);
    recorder.run(&follow, Size::List(nodes * times.len()));
    Ok(paths)
}
