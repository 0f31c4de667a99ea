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

/// Records the paths of the layers of interval `i` at these times: vectors from the lower slice per node, then those to the upper one, time by time,
/// and `behind` them these others.
pub fn paths(
    gpu: &Gpu,
    recorder: &mut Recorder<'_>,
    (moving, i, dims): (&MotionField, usize, [usize; 2]),
    times: &[f64],
    h: [f64; 2],
    behind: &[[f32; 2]],
) -> Result<Buffer<[[f32; 2]]>> {
    let device = &gpu.device;
    let v = &moving.displacements[i];
    let nodes = v.vectors.len();
    let [low, high] = &*moving.through_middle[i];
    let table: Vec<Time> = times
        .iter()
        .map(|&t| Time { t: t as f32, first: (t * (t - 1.0) * (t - 1.0)) as f32, second: (t * t * (t - 1.0)) as f32 })
        .collect();
    let image = &device.uniform("image", image(dims, v.grid, h, times.len()));
    let own = &send_vectors(device, "vectors", [&**v, low, high])?;
    let table = &device.upload("times", &table)?;
    let paths = device.storage("paths", 2 * nodes * times.len() + behind.len())?;
    device.write_from(&paths, 2 * nodes * times.len(), behind);
    let follow = Follow { image, vectors: own, times: table, paths: &paths }.bind(gpu);
    recorder.run(&follow, Size::List(nodes * times.len()));
    Ok(paths)
}
