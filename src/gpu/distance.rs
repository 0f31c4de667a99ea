//! Distance sweeps on the GPU, by patches, until no patch is awake.

use super::Gpu;
use super::answers::Wanted;
use super::atlas::Atlas;
use super::blocks::blocks;
use super::buffer::Buffer;
use super::device::failure;
use super::kernels::{Bound, WORKGROUP, shader};
use super::layout::{Block, Colour, Job, PATCHES, Params, Patch};
use super::recorder::{Recorder, Size};
use crate::error::Result;

shader! {
    distance = "common/job.wgsl" + "common/stencil.wgsl" + twin "src/reference/distance.rs";

    /// Start values at the contours of any level set.
    Start for start, "distance_start" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        u: Read [f32],
        d: Write [f32],
        awake: Write [u32],
    }

    /// Start values from a field that is right near its contours.
    StartFar for start_far, "distance_start_far" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        u: Read [f32],
        d: Write [f32],
        awake: Write [u32],
    }

    /// Every patch of a colour that is awake, until it is settled.
    SweepPatches for sweep_patches, "distance_sweep" {
        params: Uniform Params,
        colour: Uniform Colour,
        jobs: Read [Job],
        d: Write [f32],
        awake: Write [u32],
        patches: Read [Patch],
        changes: Write [u32],
    }

    /// Signs.
    Finish for finish, "distance_finish" {
        params: Uniform Params,
        u: Read [f32],
        d: Write [f32],
    }
}

/// Rounds of both colours between two looks.
const LOOK: usize = 16;
/// Rounds beyond the number of patches, in which rounding settles.
const SPARE_ROUNDS: usize = 256;
/// Bytes per node: the level set and its distance, patches and tables of blocks.
pub const NODE_BYTES: usize = 9;

/// The tiles of a batch with a distance each.
pub struct DistanceBuffers<'g> {
    /// Places of the tiles; `first_copy` is a tile's first patch.
    pub atlas: Atlas,
    /// Shared parameters.
    pub params: Buffer<Params>,
    /// Job table.
    pub jobs: Buffer<[Job]>,
    /// Block table.
    pub blocks: Buffer<[Block]>,
    /// Fields from whose zero sets the distance is measured.
    pub u: Buffer<[f32]>,
    /// Distances.
    pub d: Buffer<[f32]>,
    /// Whether each patch is awake.
    pub awake: Buffer<[u32]>,
    changes: Buffer<[u32]>,
    gpu: &'g Gpu,
    /// Sweeps over the patches of a colour, with their number.
    sweeps: [(Bound<'g>, usize); 2],
}

impl<'g> DistanceBuffers<'g> {
    /// Distances on these tiles; `u` has a value for every node.
    pub fn new(gpu: &'g Gpu, mut atlas: Atlas, params: Params, u: Buffer<[f32]>) -> Result<Self> {
        let device = &gpu.device;
        let colours = atlas.patches();
        let counts = colours.each_ref().map(Vec::len);
        let patches = colours.concat();
        let params = Params { job_count: atlas.jobs.len() as u32, block_count: atlas.block_count() as u32, ..params };
        let params = device.uniform("params", params);
        let jobs = device.upload("jobs", &atlas.jobs)?;
        let blocks = blocks(gpu, &atlas, &params, &jobs)?;
        let d = device.storage("distance", atlas.node_count())?;
        let awake = device.zeroed("awake", patches.len())?;
        let changes = device.zeroed("changes", 1)?;
        let patches = device.upload("patches", &patches)?;
        let sweeps = [0, 1].map(|k| {
            let first = if k == 0 { 0 } else { counts[0] as u32 };
            let colour = &device.uniform("colour", Colour { first, count: counts[k] as u32, ..Colour::default() });
            let (params, jobs, d, awake) = (&params, &jobs, &d, &awake);
            let (patches, changes) = (&patches, &changes);
            (SweepPatches { params, colour, jobs, d, awake, patches, changes }.bind(gpu), counts[k])
        });
        Ok(DistanceBuffers { atlas, params, jobs, blocks, u, d, awake, changes, gpu, sweeps })
    }

    /// One invocation per node.
    pub fn per_node(&self) -> Size<'static> {
        Size::List(self.atlas.node_count())
    }

    /// Start values, then sweeps to the fixed point; what is recorded comes before. The recorder that is given back finds the signs.
    /// `far`: from a field that is right near its contour.
    pub fn solve(&self, mut recorder: Recorder<'g>, far: bool) -> Result<Recorder<'g>> {
        let DistanceBuffers { gpu, params, jobs, blocks, u, d, awake, .. } = self;
        let start = match far {
            false => Start { params, jobs, blocks, u, d, awake }.bind(gpu),
            true => StartFar { params, jobs, blocks, u, d, awake }.bind(gpu),
        };
        recorder.run(&start, self.per_node());
        let mut recorder = self.settle(recorder)?;
        let finish = Finish { params, u, d }.bind(gpu);
        recorder.run(&finish, self.per_node());
        Ok(recorder)
    }

    /// Sweeps from the start values in `d`, which may only be recorded, until no patch is awake. Gives back an empty recorder. A distance crosses a patch
    /// in one round, and none is longer than all patches: what goes on after so many rounds is no number.
    pub fn settle(&self, mut recorder: Recorder<'g>) -> Result<Recorder<'g>> {
        let most = self.sweeps[0].1 + self.sweeps[1].1 + SPARE_ROUNDS;
        for _ in 0..most.div_ceil(LOOK) {
            for round in 0..LOOK {
                if round + 1 == LOOK {
                    recorder.clear(&self.changes);
                }
                for (sweep, count) in self.sweeps.iter().filter(|s| s.1 > 0) {
                    recorder.run(sweep, Size::List(count.div_ceil(PATCHES) * WORKGROUP as usize));
                }
            }
            let changes: Wanted<u32> = recorder.read(&self.changes, 0, 1);
            let changes = recorder.submit()?.wait()?.value(&changes)?;
            recorder = Recorder::new(&self.gpu.device, &self.gpu.profiler);
            if changes == 0 {
                return Ok(recorder);
            }
        }
        Err(failure(format!("distances still change after {most} rounds")))
    }

    /// What `take` makes of the distances of all tiles after what is recorded.
    pub fn read<R>(&self, mut recorder: Recorder<'g>, take: impl FnOnce(&[f32]) -> R) -> Result<R> {
        let wanted: Wanted<f32> = recorder.read(&self.d, 0, self.atlas.node_count());
        recorder.submit()?.wait()?.taken(&wanted, take)
    }
}
