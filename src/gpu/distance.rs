//! Distance sweeps on the GPU, by patches, until no patch is awake.

use super::Gpu;
use super::atlas::Atlas;
use super::device::Buffer;
use super::kernels::{Bound, Recorder, Size};
use super::layout::{Block, Colour, Job, Params};
use crate::error::Result;

/// Rounds of both colours between two looks.
const LOOK: usize = 16;
/// Bytes per node: the level set and its distance, patches and tables of blocks.
pub const NODE_BYTES: usize = 9;

/// The tiles of a batch with a distance each.
pub struct DistanceBuffers<'g> {
    /// Where the tiles lie; `first_copy` is a tile's first patch.
    pub atlas: Atlas,
    /// Shared parameters.
    pub params: Buffer,
    /// Job table.
    pub jobs: Buffer,
    /// Block table.
    pub blocks: Buffer,
    /// What the distance is measured from.
    pub u: Buffer,
    /// Distances.
    pub d: Buffer,
    /// Which patches are awake.
    pub awake: Buffer,
    changes: Buffer,
    gpu: &'g Gpu,
    /// Sweeps over the patches of a colour, with their number.
    sweeps: [(Bound<'g>, usize); 2],
}

impl<'g> DistanceBuffers<'g> {
    /// Distances on these tiles; `u` has a value for every node.
    pub fn new(gpu: &'g Gpu, mut atlas: Atlas, params: Params, u: Buffer) -> Result<Self> {
        let device = &gpu.device;
        let colours = atlas.patches();
        let counts = colours.each_ref().map(Vec::len);
        let patches = colours.concat();
        let params = Params {
            job_count: atlas.jobs.len() as u32,
            block_count: atlas.block_count() as u32,
            patch_count: patches.len() as u32,
            ..params
        };
        let params = device.uniform("params", params);
        let jobs = device.upload::<Job>("jobs", &atlas.jobs)?;
        let blocks = device.upload::<Block>("blocks", &atlas.blocks())?;
        let d = device.storage::<f32>("distance", atlas.node_count())?;
        let awake = device.zeroed::<u32>("awake", patches.len())?;
        let changes = device.zeroed::<u32>("changes", 1)?;
        let patches = device.upload("patches", &patches)?;
        let sweeps = [0, 1].map(|k| {
            let first = if k == 0 { 0 } else { counts[0] as u32 };
            let colour = Colour { first, count: counts[k] as u32, ..Colour::default() };
            let colour = device.uniform("colour", colour);
            let buffers = [
                ("params", &params),
                ("colour", &colour),
                ("jobs", &jobs),
                ("d", &d),
                ("awake", &awake),
                ("patches", &patches),
                ("changes", &changes),
            ];
            (gpu.kernels.distance_sweep.bind(device, &buffers), counts[k])
        });
        Ok(DistanceBuffers { atlas, params, jobs, blocks, u, d, awake, changes, gpu, sweeps })
    }

    /// One invocation per node.
    pub fn per_node(&self) -> Size<'static> {
        Size::List(self.atlas.node_count())
    }

    /// Start values, then sweeps to the fixed point, then signs. `far`: from a field that is right near its contour.
    pub fn solve(&self, far: bool) -> Result<()> {
        let (device, k) = (&self.gpu.device, &self.gpu.kernels);
        let start = if far { &k.distance_start_far } else { &k.distance_start };
        let start = start.bind(
            device,
            &[
                ("params", &self.params),
                ("jobs", &self.jobs),
                ("blocks", &self.blocks),
                ("u", &self.u),
                ("d", &self.d),
                ("awake", &self.awake),
            ],
        );
        let mut work = Recorder::new(device, &self.gpu.profiler);
        work.run(&start, self.per_node());
        work.submit()?;
        self.settle()?;
        let finish = k.distance_finish.bind(device, &[("params", &self.params), ("u", &self.u), ("d", &self.d)]);
        let mut work = Recorder::new(device, &self.gpu.profiler);
        work.run(&finish, self.per_node());
        work.submit()
    }

    /// Sweeps from the start values in `d` until no patch is awake.
    pub fn settle(&self) -> Result<()> {
        loop {
            let mut work = Recorder::new(&self.gpu.device, &self.gpu.profiler);
            for round in 0..LOOK {
                if round + 1 == LOOK {
                    work.clear(&self.changes);
                }
                for (sweep, count) in self.sweeps.iter().filter(|s| s.1 > 0) {
                    work.run(sweep, Size::List(*count));
                }
            }
            work.submit()?;
            if self.gpu.device.read::<u32>(&self.changes, 0, 1)? == [0] {
                return Ok(());
            }
        }
    }

    /// The distances of all tiles.
    pub fn read(&self) -> Result<Vec<f32>> {
        self.gpu.device.read(&self.d, 0, self.atlas.node_count())
    }
}
