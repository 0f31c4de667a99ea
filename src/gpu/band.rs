//! Fronts in their tubes: the tiles of a batch, the band around their contours, and the steps that both morphs and sweeps take.

use super::Gpu;
use super::atlas::Atlas;
use super::device::{Buffer, failure};
use super::kernels::{Bound, Recorder, Size};
use super::layout::{Block, Job, Params, Stage, Work};
use crate::error::Result;
use crate::grid::stencil::TVD_RK3;

/// Bytes of the arguments of dispatches over blocks, the band, and the band in chunks in [`Work`].
const BLOCK_GROUPS: u64 = std::mem::offset_of!(Work, block_groups) as u64;
const BAND_GROUPS: u64 = std::mem::offset_of!(Work, band_groups) as u64;
const CHUNK_GROUPS: u64 = std::mem::offset_of!(Work, chunk_groups) as u64;

/// Bytes per node of an atlas: two copies of phi, the place in the band, bits and lists of blocks.
pub const NODE_BYTES: usize = 13;
/// Bytes per band place: the list, where each was before, the start of a step.
pub const PLACE_BYTES: usize = 16;

/// The fronts of a batch.
pub struct Front<'g> {
    /// Where the tiles lie.
    pub atlas: Atlas,
    /// Places in the band lists.
    pub capacity: usize,
    /// Shared parameters.
    pub params: Buffer,
    /// Job table with states.
    pub jobs: Buffer,
    /// Block table.
    pub blocks: Buffer,
    /// Work lists.
    pub work: Buffer,
    /// The band.
    pub band: Buffer,
    /// Node to band place.
    pub slots: Buffer,
    /// Place in the band before the last rebuild.
    pub earlier: Buffer,
    /// Level sets.
    pub phi: Buffer,
    other: Buffer,
    scratch: Buffer,
    gpu: &'g Gpu,
    start: Bound<'g>,
    tube: Bound<'g>,
    gather: Bound<'g>,
    grow: Bound<'g>,
    scan: Bound<'g>,
    collect: Bound<'g>,
    /// First or later iteration, phi to other or back.
    reinit: [[Bound<'g>; 2]; 2],
}

impl<'g> Front<'g> {
    /// Fronts at these level sets (`None`: they come later); `capacity` band places.
    pub fn new(gpu: &'g Gpu, atlas: Atlas, params: Params, phi: Option<&[f32]>, capacity: usize) -> Result<Self> {
        let (device, k) = (&gpu.device, &gpu.kernels);
        let params = Params {
            job_count: atlas.jobs.len() as u32,
            block_count: atlas.block_count() as u32,
            band_capacity: capacity as u32,
            ..params
        };
        let nodes = atlas.node_count();
        let params = device.uniform("params", params);
        let jobs = device.upload("jobs", &atlas.jobs)?;
        let blocks = device.upload::<Block>("blocks", &atlas.blocks())?;
        let work = device.headed::<Work, u32>("work", atlas.block_count())?;
        let touched = device.zeroed::<u32>("touched", atlas.block_count().div_ceil(32))?;
        let band = device.storage::<[u32; 2]>("band", capacity)?;
        let slots = device.storage::<u32>("slots", nodes)?;
        let earlier = device.storage::<u32>("earlier", capacity)?;
        let phi = match phi {
            Some(values) => device.upload("phi", values)?,
            None => device.storage::<f32>("phi", nodes)?,
        };
        let other = device.storage::<f32>("other", nodes)?;
        let scratch = device.storage::<f32>("scratch", capacity)?;
        let stage = |first| device.uniform("stage", Stage { a: 0.0, b: 0.0, first, towards: 0 });
        let reinit = [1, 0].map(|first| {
            let stage = stage(first);
            let bind = |from, to| {
                k.reinit.bind(
                    device,
                    &[
                        ("params", &params),
                        ("stage", &stage),
                        ("jobs", &jobs),
                        ("work", &work),
                        ("band", &band),
                        ("phi", from),
                        ("signs", &scratch),
                        ("next", to),
                    ],
                )
            };
            [bind(&phi, &other), bind(&other, &phi)]
        });
        Ok(Front {
            start: k.band_start.bind(
                device,
                &[
                    ("params", &params),
                    ("jobs", &jobs),
                    ("blocks", &blocks),
                    ("lists", &work),
                    ("phi", &phi),
                    ("other", &other),
                    ("slots", &slots),
                ],
            ),
            tube: k.band_tube.bind(
                device,
                &[
                    ("params", &params),
                    ("jobs", &jobs),
                    ("blocks", &blocks),
                    ("work", &work),
                    ("phi", &phi),
                    ("touched", &touched),
                ],
            ),
            gather: k.band_gather.bind(device, &[("params", &params), ("lists", &work), ("touched", &touched)]),
            grow: k.band_grow.bind(
                device,
                &[
                    ("params", &params),
                    ("jobs", &jobs),
                    ("blocks", &blocks),
                    ("work", &work),
                    ("phi", &phi),
                    ("other", &other),
                    ("slots", &slots),
                ],
            ),
            scan: k.band_scan.bind(device, &[("params", &params), ("blocks", &blocks), ("lists", &work)]),
            collect: k.band_collect.bind(
                device,
                &[
                    ("params", &params),
                    ("blocks", &blocks),
                    ("work", &work),
                    ("slots", &slots),
                    ("band", &band),
                    ("earlier", &earlier),
                ],
            ),
            reinit,
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
        })
    }

    /// One invocation per listed block.
    pub fn per_block(&self) -> Size<'_> {
        Size::Indirect(&self.work, BLOCK_GROUPS)
    }

    /// One invocation per band pixel.
    pub fn per_pixel(&self) -> Size<'_> {
        Size::Indirect(&self.work, BAND_GROUPS)
    }

    /// One invocation per chunk of band pixels.
    pub fn per_chunk(&self) -> Size<'_> {
        Size::Indirect(&self.work, CHUNK_GROUPS)
    }

    /// The first band, found by looking at whole tiles.
    pub fn begin(&self, work: &mut Recorder<'_>) {
        work.run(&self.start, Size::List(self.atlas.block_count()));
        self.list(work);
    }

    /// The band follows its contours.
    pub fn rebuild(&self, work: &mut Recorder<'_>) {
        work.run(&self.tube, self.per_block());
        work.run(&self.gather, Size::One);
        self.list(work);
    }

    fn list(&self, work: &mut Recorder<'_>) {
        work.run(&self.grow, self.per_block());
        work.run(&self.scan, Size::One);
        work.run(&self.collect, self.per_block());
    }

    /// The three stages of a Hamilton-Jacobi step. `field` is a goal by node, or a speed by band place.
    pub fn bind_step(&self, field: &Buffer, towards: bool) -> [Bound<'g>; 3] {
        let (device, k) = (&self.gpu.device, &self.gpu.kernels);
        let way = [(&self.phi, &self.other), (&self.other, &self.phi), (&self.phi, &self.other)];
        std::array::from_fn(|n| {
            let (a, b) = TVD_RK3[n];
            let stage = Stage { a: a as f32, b: b as f32, first: u32::from(n == 0), towards: u32::from(towards) };
            let stage = device.uniform("stage", stage);
            let (from, to) = way[n];
            let buffers = [
                ("params", &self.params),
                ("stage", &stage),
                ("jobs", &self.jobs),
                ("work", &self.work),
                ("band", &self.band),
                ("phi", from),
                ("field", field),
                ("begun", &self.scratch),
                ("next", to),
            ];
            k.hj_step.bind(device, &buffers)
        })
    }

    /// A Hamilton-Jacobi step and one reinitialisation: phi to other, back, again, and home.
    pub fn step(&self, work: &mut Recorder<'_>, stages: &[Bound<'_>; 3]) {
        for stage in stages {
            work.run(stage, self.per_pixel());
        }
        work.run(&self.reinit[0][1], self.per_pixel());
    }

    /// An even number of reinitialisation iterations with the signs of the first.
    pub fn reinit(&self, work: &mut Recorder<'_>, iterations: usize) {
        debug_assert!(iterations.is_multiple_of(2), "phi ends where it began");
        for n in 0..iterations {
            work.run(&self.reinit[usize::from(n > 0)][n % 2], self.per_pixel());
        }
    }

    /// Gives both copies of phi new values and leaves the band as it is.
    pub fn replace_phi(&self, phi: &[f32]) {
        self.gpu.device.write(&self.phi, phi);
        self.gpu.device.write(&self.other, phi);
    }

    /// The job table as it is now.
    pub fn states(&self) -> Result<Vec<Job>> {
        self.gpu.device.read(&self.jobs, 0, self.atlas.jobs.len())
    }

    /// Longest band so far if it was longer than its lists.
    pub fn overflow(&self) -> Result<Option<usize>> {
        let head: Vec<Work> = self.gpu.device.read(&self.work, 0, 1)?;
        let wanted = head.first().map_or(0, |w| w.band_wanted as usize);
        Ok((wanted > self.capacity).then_some(wanted))
    }
}

/// What a try with limited room gave.
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
    let nx = field.dims[0];
    let inside = |v: &f64| *v < 0.0;
    let along =
        field.data.chunks_exact(nx).map(|row| row.windows(2).filter(|w| inside(&w[0]) != inside(&w[1])).count());
    let across = field.data.iter().zip(field.data.iter().skip(nx)).filter(|(a, b)| inside(a) != inside(b)).count();
    along.sum::<usize>() + across
}
