//! A Hamilton-Jacobi step on the GPU, one dispatch a stage.

use super::band::Front;
use super::buffer::Buffer;
use super::kernels::{Bound, shader};
use super::layout::{Job, Params, Stage, Work};
use crate::grid::stencil::TVD_RK3;

shader! {
    hj_step = "common/job.wgsl" + "common/stencil.wgsl" + "common/stage.wgsl" + twin "src/reference/hj_step.rs";

    /// One stage from `phi` to `next`.
    HjStep for hj_step, "hj_step" {
        params: Uniform Params,
        stage: Uniform Stage,
        jobs: Read [Job],
        work: Read Work,
        band: Read [[u32; 2]],
        phi: Read [f32],
        field: Read [f32],
        begun: Write [f32],
        next: Write [f32],
    }
}

/// The three stages of a step. `field` is a level set to move towards by node (`towards`), or a speed by band place.
pub fn stages<'g>(front: &Front<'g>, field: &Buffer<[f32]>, towards: bool) -> [Bound<'g>; 3] {
    let Front { gpu, params, jobs, work, band, phi, other, scratch, .. } = front;
    let way = [(phi, other), (other, phi), (phi, other)];
    std::array::from_fn(|n| {
        let (a, b) = TVD_RK3[n];
        let stage = Stage { a: a as f32, b: b as f32, first: u32::from(n == 0), towards: u32::from(towards) };
        let stage = &gpu.device.uniform("stage", stage);
        let (phi, next) = way[n];
        HjStep { params, stage, jobs, work, band, phi, field, begun: scratch, next }.bind(gpu)
    })
}
