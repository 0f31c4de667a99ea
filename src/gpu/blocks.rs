//! The table of the blocks of an atlas, made on the device: which tile each belongs to.

use super::Gpu;
use super::atlas::Atlas;
use super::buffer::Buffer;
use super::kernels::shader;
use super::layout::{Block, Job, Params};
use crate::error::Result;

shader! {
    blocks = "common/job.wgsl" + twin "src/gpu/atlas.rs";

    /// The tile of every block.
    LayBlocks for lay_blocks, "lay_blocks" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Write [Block],
    }
}

/// The table of an atlas, made before the next work from its jobs, which `params` count as they count the blocks.
///
/// # Errors
/// The errors of [`Device::buffer`](super::device::Device::buffer), and those for more workgroups than the device allows.
pub fn blocks(gpu: &Gpu, atlas: &Atlas, params: &Buffer<Params>, jobs: &Buffer<[Job]>) -> Result<Buffer<[Block]>> {
    let count = atlas.block_count();
    let blocks = gpu.device.storage("blocks", count)?;
    if count > 0 {
        gpu.device.run_before(&LayBlocks { params, jobs, blocks: &blocks }.bind(gpu), count)?;
    }
    Ok(blocks)
}
