//! Distance sweeps on the GPU, by patches, until no patch is awake.

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::atlas::Atlas;
use super::blocks::blocks;
use super::buffer::Buffer;
use super::device::failure;
use super::kernels::{Bound, WORKGROUP, shader};
use super::layout::{Block, Colour, Job, PATCH, PATCHES, Params, Patch};
use super::recorder::{Recorder, Size};
use crate::error::Result;

shader! {
    distance = "common/job.wgsl" + "common/stencil.wgsl" + twin "src/reference/distance.rs";

    /// All patches, those of the first colour before those of the second.
    LayPatches for lay_patches, "distance_patches" {
        params: Uniform Params,
        colour: Uniform Colour,
        jobs: Read [Job],
        patches_mut: Write [Patch],
    }

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
/// Rounds that are guessed at most: of those that find no patch awake there should not be too many.
const MOST_GUESSED: usize = 4 * LOOK;
/// Rounds beyond the number of patches, in which rounding settles.
const SPARE_ROUNDS: usize = 256;
/// Bytes per node: the level set and its distance, patches and tables of blocks.
pub const NODE_BYTES: usize = 9;

/// Rounds after which distances are taken for settled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rounds {
    /// As many as are nearly always enough: the host does not wait, and asks with what follows whether they were.
    Guessed,
    /// As many as it takes; the host waits for it.
    All,
}

/// What `work` makes of distances, which gives nothing where they have not settled: then it is done once more, when they have.
pub fn settled<T>(mut work: impl FnMut(Rounds) -> Result<Option<T>>) -> Result<T> {
    if let Some(made) = work(Rounds::Guessed)? {
        return Ok(made);
    }
    work(Rounds::All)?.ok_or_else(|| failure("distances that have settled still change"))
}

/// The tiles of a batch with a distance each.
pub struct DistanceBuffers<'g> {
    /// Places of the tiles; `first_copy` is a tile's first patch, `first_bin` its first of the first colour.
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
    /// Patches that the longest distance may cross.
    reach: usize,
}

impl<'g> DistanceBuffers<'g> {
    /// Distances on these tiles; `u` has a value for every node.
    pub fn new(gpu: &'g Gpu, mut atlas: Atlas, params: Params, u: Buffer<[f32]>) -> Result<Self> {
        let device = &gpu.device;
        let counts = atlas.patches();
        let widest = || atlas.jobs.iter().map(|job| job.nx.max(job.ny)).max().unwrap_or(0) as usize;
        let reach = if params.limit > 0.0 { params.limit as usize } else { widest() } / PATCH;
        let params = Params { job_count: atlas.jobs.len() as u32, block_count: atlas.block_count() as u32, ..params };
        let params = device.uniform("params", params);
        let jobs = device.upload("jobs", &atlas.jobs)?;
        let blocks = blocks(gpu, &atlas, &params, &jobs)?;
        let d = device.storage("distance", atlas.node_count())?;
        let all = counts[0] + counts[1];
        let awake = device.zeroed("awake", all)?;
        let changes = device.zeroed("changes", 1)?;
        let patches = device.storage("patches", all)?;
        let colours = [0, 1].map(|k| {
            let first = if k == 0 { 0 } else { counts[0] as u32 };
            device.uniform("colour", Colour { first, count: counts[k] as u32, ..Colour::default() })
        });
        if all > 0 {
            let (params, colour, jobs, patches_mut) = (&params, &colours[1], &jobs, &patches);
            device.run_before(&LayPatches { params, colour, jobs, patches_mut }.bind(gpu), all)?;
        }
        let sweeps = [0, 1].map(|k| {
            let (params, colour, jobs, d, awake) = (&params, &colours[k], &jobs, &d, &awake);
            let (patches, changes) = (&patches, &changes);
            (SweepPatches { params, colour, jobs, d, awake, patches, changes }.bind(gpu), counts[k])
        });
        Ok(DistanceBuffers { atlas, params, jobs, blocks, u, d, awake, changes, gpu, sweeps, reach })
    }

    /// One invocation per node.
    pub fn per_node(&self) -> Size<'static> {
        Size::List(self.atlas.node_count())
    }

    /// Start values, then sweeps to the fixed point; what is recorded comes before. The recorder that is given back finds the signs.
    /// `far`: from a field that is right near its contour.
    pub fn solve(&self, mut recorder: Recorder<'g>, far: bool, rounds: Rounds) -> Result<Recorder<'g>> {
        let DistanceBuffers { gpu, params, jobs, blocks, u, d, awake, .. } = self;
        let start = match far {
            false => Start { params, jobs, blocks, u, d, awake }.bind(gpu),
            true => StartFar { params, jobs, blocks, u, d, awake }.bind(gpu),
        };
        recorder.run(&start, self.per_node());
        let mut recorder = self.settle(recorder, rounds)?;
        let finish = Finish { params, u, d }.bind(gpu);
        recorder.run(&finish, self.per_node());
        Ok(recorder)
    }

    /// Sweeps from the start values in `d`, which may only be recorded, until no patch is awake, or as often as is guessed. Gives back what is not
    /// sent off. A distance crosses a patch in one round, and none is longer than all patches: what goes on after so many rounds is no number.
    pub fn settle(&self, mut recorder: Recorder<'g>, rounds: Rounds) -> Result<Recorder<'g>> {
        let guess = self.gpu.device.made.guess.unwrap_or(self.reach.clamp(LOOK, MOST_GUESSED));
        let most = self.sweeps[0].1 + self.sweeps[1].1 + SPARE_ROUNDS;
        let mut done = 0;
        while done < most {
            let more = if done == 0 { guess.max(1) } else { LOOK };
            for round in 0..more {
                if round + 1 == more {
                    recorder.clear(&self.changes);
                }
                for (sweep, count) in self.sweeps.iter().filter(|s| s.1 > 0) {
                    recorder.run(sweep, Size::List(count.div_ceil(PATCHES) * WORKGROUP as usize));
                }
            }
            done += more;
            if rounds == Rounds::Guessed {
                return Ok(recorder);
            }
            let changes = self.ask(&mut recorder);
            let landed = recorder.submit()?.wait()?;
            recorder = Recorder::new(&self.gpu.device, &self.gpu.profiler);
            if settled_by(&landed, &changes)? {
                return Ok(recorder);
            }
        }
        Err(failure(format!("distances still change after {most} rounds")))
    }

    /// Records the question whether the last round has changed anything.
    pub fn ask(&self, recorder: &mut Recorder<'_>) -> Wanted<u32> {
        recorder.read(&self.changes, 0, 1)
    }

    /// What `take` makes of the distances of all tiles after what is recorded; nothing where they have not settled.
    pub fn read<R>(&self, mut recorder: Recorder<'g>, take: impl FnOnce(&[f32]) -> R) -> Result<Option<R>> {
        let changes = self.ask(&mut recorder);
        let wanted: Wanted<f32> = recorder.read(&self.d, 0, self.atlas.node_count());
        let landed = recorder.submit()?.wait()?;
        let settled = settled_by(&landed, &changes)?;
        settled.then(|| landed.taken(&wanted, take)).transpose()
    }
}

/// Whether nothing has changed in the last round, by the answer to [`DistanceBuffers::ask`].
pub fn settled_by(landed: &Landed<'_>, changes: &Wanted<u32>) -> Result<bool> {
    Ok(landed.value(changes)? == 0)
}
