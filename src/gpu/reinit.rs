//! Reinitialisation on the GPU: |grad phi| = 1 near the contour.

use super::kernels::shader;
use super::layout::{Job, Params, Stage, Work};

shader! {
    reinit = "common/job.wgsl" + "common/stencil.wgsl" + "common/stage.wgsl" + twin "src/reference/reinit.rs";

    /// One iteration from `phi` to `next`; the first keeps `signs`.
    Reinit for reinit, "reinit" {
        params: Uniform Params,
        stage: Uniform Stage,
        jobs: Read [Job],
        work: Read Work,
        band: Read [[u32; 2]],
        phi: Read [f32],
        signs: Write [f32],
        next: Write [f32],
    }
}
