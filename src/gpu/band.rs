//! Fronts in their tubes: the tiles of a batch, the band around their contours, and the steps that both morphs and sweeps take.

use super::Gpu;
use super::answers::{Landed, Wanted};
use super::atlas::Atlas;
use super::blocks::blocks;
use super::buffer::Buffer;
use super::device::failure;
use super::kernels::{Bound, WORKGROUP, shader};
use super::layout::{Block, EIGHTH, Job, Params, RUNNING, Stage, Values, Work};
use super::recorder::{Listed, Recorder, Size};
use super::reinit::Reinit;
use crate::error::Result;

shader! {
    band = "common/job.wgsl" + "common/stencil.wgsl" + twin "src/reference/band.rs";

    /// The whole tile as the old tube.
    Start for start, "band_start" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Write [Block],
        work_mut: Write Work,
        phi: Write [f32],
        other: Write [f32],
        slots: Write [u32],
    }

    /// T in the listed blocks, and the blocks that N may touch.
    Tube for tube, "band_tube" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Write [Block],
        work: Read Work,
        phi: Write [f32],
        touched: Write [u32],
    }

    /// Counts of touched blocks.
    Tally for tally, "band_tally" {
        params: Uniform Params,
        touched: Write [u32],
        places: Write [u32],
    }

    /// Listed blocks in order.
    Gather for gather, "band_gather" {
        params: Uniform Params,
        work_mut: Write Work,
        touched: Write [u32],
        places: Write [u32],
    }

    /// N = T and its ring.
    Grow for grow, "band_grow" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Write [Block],
        work: Read Work,
        phi: Write [f32],
        other: Write [f32],
        slots: Write [u32],
        places: Write [u32],
    }

    /// Beginnings of the blocks' parts of the band.
    Scan for scan, "band_scan" {
        params: Uniform Params,
        work_mut: Write Work,
        places: Write [u32],
    }

    /// The band's pixels in row order.
    Collect for collect, "band_collect" {
        params: Uniform Params,
        blocks: Write [Block],
        work: Read Work,
        slots: Write [u32],
        band: Write [[u32; 2]],
        earlier: Write [u32],
        places: Write [u32],
    }
}

/// Bytes of the arguments of dispatches over blocks, their eighths, the band, and the band in chunks in [`Work`].
const BLOCK_GROUPS: u64 = std::mem::offset_of!(Work, block_groups) as u64;
const EIGHTH_GROUPS: u64 = std::mem::offset_of!(Work, eighth_groups) as u64;
const BAND_GROUPS: u64 = std::mem::offset_of!(Work, band_groups) as u64;
const CHUNK_GROUPS: u64 = std::mem::offset_of!(Work, chunk_groups) as u64;

/// Bytes per node of an atlas: two copies of phi, the place in the band, bits and lists of blocks.
pub const NODE_BYTES: usize = 13;
/// Bytes per band place: the list, where each was before, the start of a step.
pub const PLACE_BYTES: usize = 16;

/// The fronts of a batch.
pub struct Front<'g> {
    /// Places of the tiles.
    pub atlas: Atlas,
    /// Places in the band lists.
    pub capacity: usize,
    /// Shared parameters.
    pub params: Buffer<Params>,
    /// Job table with states.
    pub jobs: Buffer<[Job]>,
    /// Block table.
    pub blocks: Buffer<[Block]>,
    /// Work lists.
    pub work: Buffer<Work>,
    /// The band.
    pub band: Buffer<[[u32; 2]]>,
    /// Node to band place.
    pub slots: Buffer<[u32]>,
    /// Place in the band before the last rebuild.
    pub earlier: Buffer<[u32]>,
    /// Level sets.
    pub phi: Buffer<[f32]>,
    /// Their second copy, which stages write.
    pub other: Buffer<[f32]>,
    /// By band place: phi at the start of a step, signs at the start of a reinitialisation.
    pub scratch: Buffer<[f32]>,
    /// The machine.
    pub gpu: &'g Gpu,
    kernels: BandKernels<'g>,
}

struct BandKernels<'g> {
    start: Bound<'g>,
    tube: Bound<'g>,
    tally: Bound<'g>,
    gather: Bound<'g>,
    grow: Bound<'g>,
    scan: Bound<'g>,
    collect: Bound<'g>,
    /// First or later iteration, phi to other or back.
    reinit: [[Bound<'g>; 2]; 2],
}

impl<'g> Front<'g> {
    /// Fronts at these level sets (`None`: they come later); `capacity` band places.
    pub fn new(
        gpu: &'g Gpu,
        atlas: Atlas,
        params: Params,
        phi: Option<Buffer<[f32]>>,
        capacity: usize,
    ) -> Result<Self> {
        let device = &gpu.device;
        let params = Params {
            job_count: atlas.jobs.len() as u32,
            block_count: atlas.block_count() as u32,
            band_capacity: capacity as u32,
            ..params
        };
        let nodes = atlas.node_count();
        let params = device.uniform("params", params);
        let jobs = device.upload("jobs", &atlas.jobs)?;
        let blocks = blocks(gpu, &atlas, &params, &jobs)?;
        let work = device.headed("work", atlas.block_count())?;
        let touched = device.zeroed("touched", atlas.block_count().div_ceil(32))?;
        let places = device.storage("places", atlas.block_count().div_ceil(WORKGROUP as usize))?;
        let band = device.storage("band", capacity)?;
        let slots = device.storage("slots", nodes)?;
        let earlier = device.storage("earlier", capacity)?;
        let phi = match phi {
            Some(phi) => phi,
            None => device.storage("phi", nodes)?,
        };
        let other = device.storage("other", nodes)?;
        let scratch = device.storage("scratch", capacity)?;
        let kernels = {
            let (params, jobs, blocks, work, touched) = (&params, &jobs, &blocks, &work, &touched);
            let (band, slots, earlier, phi, other, places) = (&band, &slots, &earlier, &phi, &other, &places);
            let reinit = [1, 0].map(|first| {
                let stage = &device.uniform("stage", Stage { a: 0.0, b: 0.0, first, towards: 0 });
                [(phi, other), (other, phi)]
                    .map(|(phi, next)| Reinit { params, stage, jobs, work, band, phi, signs: &scratch, next }.bind(gpu))
            });
            BandKernels {
                start: Start { params, jobs, blocks, work_mut: work, phi, other, slots }.bind(gpu),
                tube: Tube { params, jobs, blocks, work, phi, touched }.bind(gpu),
                tally: Tally { params, touched, places }.bind(gpu),
                gather: Gather { params, work_mut: work, touched, places }.bind(gpu),
                grow: Grow { params, jobs, blocks, work, phi, other, slots, places }.bind(gpu),
                scan: Scan { params, work_mut: work, places }.bind(gpu),
                collect: Collect { params, blocks, work, slots, band, earlier, places }.bind(gpu),
                reinit,
            }
        };
        Ok(Front {
            atlas,
            capacity,
            params,
            jobs,
            blocks,
            work,
            band,
            slots,
            earlier,
            phi,
            other,
            scratch,
            gpu,
            kernels,
        })
    }

    /// One invocation per listed block.
    fn per_block(&self) -> Size<'_> {
        Size::Indirect(&self.work.raw, BLOCK_GROUPS, Listed::Blocks)
    }

    /// One invocation per eighth of a listed block.
    fn per_eighth(&self) -> Size<'_> {
        Size::Indirect(&self.work.raw, EIGHTH_GROUPS, Listed::Eighths)
    }

    /// One invocation per band pixel.
    pub fn per_pixel(&self) -> Size<'_> {
        Size::Indirect(&self.work.raw, BAND_GROUPS, Listed::Pixels)
    }

    /// One invocation per chunk of band pixels.
    pub fn per_chunk(&self) -> Size<'_> {
        Size::Indirect(&self.work.raw, CHUNK_GROUPS, Listed::Chunks)
    }

    /// The first band, found by looking at whole tiles.
    pub fn begin(&self, recorder: &mut Recorder<'_>) {
        recorder.run(&self.kernels.start, Size::List(self.atlas.block_count() * EIGHTH));
        self.list(recorder);
    }

    /// The band follows its contours.
    pub fn rebuild(&self, recorder: &mut Recorder<'_>) {
        recorder.run(&self.kernels.tube, self.per_eighth());
        let words = Size::List(self.atlas.block_count().div_ceil(32));
        recorder.run(&self.kernels.tally, words);
        recorder.run(&self.kernels.gather, words);
        self.list(recorder);
    }

    fn list(&self, recorder: &mut Recorder<'_>) {
        recorder.run(&self.kernels.grow, self.per_block());
        recorder.run(&self.kernels.scan, Size::One);
        recorder.run(&self.kernels.collect, self.per_eighth());
    }

    /// A Hamilton-Jacobi step and one reinitialisation: phi to other, back, again, and home.
    pub fn step(&self, recorder: &mut Recorder<'_>, stages: &[Bound<'_>; 3]) {
        for stage in stages {
            recorder.run(stage, self.per_pixel());
        }
        recorder.run(&self.kernels.reinit[0][1], self.per_pixel());
    }

    /// An even number of reinitialisation iterations with the signs of the first.
    pub fn reinit(&self, recorder: &mut Recorder<'_>, iterations: usize) {
        debug_assert!(iterations.is_multiple_of(2), "phi ends where it began");
        for n in 0..iterations {
            recorder.run(&self.kernels.reinit[usize::from(n > 0)][n % 2], self.per_pixel());
        }
    }

    /// Gives both copies of phi new values and leaves the band as it is.
    pub fn replace_phi(&self, phi: &[f32]) {
        self.gpu.device.write(&self.phi, phi);
        self.gpu.device.write(&self.other, phi);
    }

    /// Records a look at the lists.
    pub fn look(&self, recorder: &mut Recorder<'_>) -> Wanted<Work> {
        recorder.read(&self.work, 0, 1)
    }

    /// Longest band so far if it was longer than its lists.
    pub fn overflow(&self, landed: &Landed<'_>, look: &Wanted<Work>) -> Result<Option<usize>> {
        let head = landed.value(look)?;
        let wanted = head.band_wanted as usize;
        let lists = [head.block_groups, head.eighth_groups, head.band_groups, head.chunk_groups];
        let [blocks, eighths, pixels, chunks] = lists.map(|groups| {
            let [x, y, z, _] = groups.map(u64::from);
            x * y * z * u64::from(WORKGROUP)
        });
        // Of fronts that are copied nothing is known; most steps copy none.
        self.gpu.profiler.looked(&self.gpu.device, [blocks, eighths, pixels, chunks, 0]);
        Ok((wanted > self.capacity).then_some(wanted))
    }

    /// Takes steps until no job runs, which are about `expected`: the jobs as they end, and the number that `beside` begins with. While the host reads
    /// one look the device works on the steps of the next; steps after the end change nothing, as no job is on the lists any more.
    pub fn run(
        &self,
        mut recorder: Recorder<'g>,
        beside: Option<&Buffer<Values>>,
        expected: usize,
        mut step: impl FnMut(&mut Recorder<'g>),
        check: impl Fn(&[Job]) -> Result<()>,
    ) -> Result<Room<(Vec<Job>, u32)>> {
        let mut ahead = None;
        let first = self.gpu.device.made.guess.unwrap_or(expected.clamp(LOOK, MOST_EXPECTED));
        for look in 0.. {
            // Those after the first are few, and more the longer it takes.
            let steps = if look == 0 { first.max(1) } else { (LOOK << ((look - 1) / 2)).min(LAST_LOOK) };
            for _ in 0..steps {
                step(&mut recorder);
            }
            let jobs: Wanted<Job> = recorder.read(&self.jobs, 0, self.atlas.jobs.len());
            let lists = self.look(&mut recorder);
            let number = beside.map(|buffer| recorder.read::<u32>(buffer, 0, 1));
            let sent = (recorder.submit()?, jobs, lists, number);
            recorder = Recorder::new(&self.gpu.device, &self.gpu.profiler);
            let Some((answers, jobs, lists, number)) = ahead.replace(sent) else { continue };
            let landed = answers.wait()?;
            if let Some(wanted) = self.overflow(&landed, &lists)? {
                return Ok(Room::Short(wanted));
            }
            let states = landed.values(&jobs)?;
            check(&states)?;
            if states.iter().all(|s| s.phase != RUNNING) {
                let number = number.map(|number| landed.value(&number)).transpose()?;
                return Ok(Room::Enough((states, number.unwrap_or(0))));
            }
        }
        Err(failure("fronts that never end"))
    }
}

/// Steps between two looks, which double with every second one, and most of them. Before the first there are at least as many.
const LOOK: usize = 16;
const LAST_LOOK: usize = 64;
/// And at most so many: whoever expects more may have been told nonsense.
const MOST_EXPECTED: usize = 256;

/// Result of a try with limited room.
pub enum Room<T> {
    /// It fitted.
    Enough(T),
    /// It did not: this much was wanted at least.
    Short(usize),
}

/// Tries `work` with more and more room until it fits.
pub fn with_room<T>(mut room: usize, most: usize, mut work: impl FnMut(usize) -> Result<Room<T>>) -> Result<T> {
    loop {
        match work(room.min(most))? {
            Room::Enough(result) => return Ok(result),
            Room::Short(wanted) if room < most => room = (wanted + wanted / 4).max(2 * room),
            Room::Short(wanted) => return Err(failure(format!("lists of {wanted} places wanted, {most} possible"))),
        }
    }
}

/// Band places of a batch beyond those of its jobs.
pub const SPARE_PLACES: usize = 1024;

/// Band places that a contour with this many crossed edges may need, with room to grow.
pub fn places(crossings: usize, gamma: f64, nodes: usize) -> usize {
    ((1.5 * crossings as f64 * (2.0 * gamma + 4.0)) as usize).min(nodes)
}

/// Edges between pixels that the contour of a field crosses.
pub fn crossings(field: &crate::grid::field::Field) -> usize {
    sides_that_differ(&field.data, field.dims[0], |v| *v < 0.0)
}

/// Edges between pixels of which one is inside, in rows of `nx`.
pub fn sides_that_differ<T>(pixels: &[T], nx: usize, inside: impl Fn(&T) -> bool) -> usize {
    let along = pixels.chunks_exact(nx).map(|row| row.windows(2).filter(|w| inside(&w[0]) != inside(&w[1])).count());
    let across = pixels.iter().zip(pixels.iter().skip(nx)).filter(|(a, b)| inside(a) != inside(b)).count();
    along.sum::<usize>() + across
}
