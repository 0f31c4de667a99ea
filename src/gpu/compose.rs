//! Slices made of copied fronts on the GPU: blending, distances farther out, and the way back to the host.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::{Atlas, in_batches, padded};
use super::band::Front;
use super::buffer::Buffer;
use super::distance::{self, DistanceBuffers, Rounds, settled};
use super::kernels::{Bound, shader};
use super::layout::{Block, Copy, Hole, Item, Job, NONE, Params, Reached, VANISHED, Values};
use super::moving::bounded;
use super::recorder::{Recorder, Size};
use super::resident::scaled;
use super::trace::morph_params;
use super::work;
use crate::backend::MorphOptions;
use crate::backend::blend::{is_broken, mend};
use crate::backend::jobs::{Filled, SweepPair, Swept, blend_weights};
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;
use crate::grid::tile::Tile;
use crate::settings::Sweep;

shader! {
    compose = "common/job.wgsl" + twin "src/backend/blend.rs";

    /// Fronts that are wanted within this step, copied.
    CopyFront for copy_front, "copy_front" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        phi: Read [f32],
        reached: Read Reached,
        copies: Write [Copy],
        values: Write Values,
        slots: Read [u32],
        before: Read [[f32; 4]],
    }

    /// Copies of both directions made one.
    Blend for blend, "blend" {
        params: Uniform Params,
        copies: Write [Copy],
        values: Write Values,
        items: Read [Item],
        blended: Write [f32],
        holes: Read [Hole],
        hole_values: Read [f32],
    }
}

/// Fronts at the output times of their jobs.
pub struct Copies {
    /// Places in the pool of values.
    pub value_capacity: u32,
    copies: Buffer<[Copy]>,
    values: Buffer<Values>,
    states: Vec<Job>,
    /// Contours that the sweeps go to, as the jobs' tiles lie.
    ends: Option<Buffer<[f32]>>,
}

impl Copies {
    /// Room for the copies of all jobs, whose bands share `room` places; writes into each job where its copies go.
    pub fn new(gpu: &Gpu, atlas: &mut Atlas, room: usize) -> Result<Self> {
        let mut count = 0;
        for job in &mut atlas.jobs {
            job.first_copy = count;
            count += job.time_count * job.block_count;
        }
        let times = atlas.jobs.iter().map(|j| j.time_count as usize).max().unwrap_or(0);
        // `room` is generous, so that a part of it per time is enough; the host tries again with more where it is not.
        let most = (gpu.device.largest_binding() as usize - size_of::<Values>()) / 4;
        let value_capacity = (room * times.max(1)).min(most);
        Ok(Copies {
            value_capacity: value_capacity as u32,
            copies: gpu.device.storage("copies", count as usize)?,
            values: gpu.device.headed("values", value_capacity)?,
            states: Vec::new(),
            ends: None,
        })
    }

    /// The kernel that copies the fronts listed in `reached`, which lie between `before` and what the front is now.
    pub fn bind<'g>(
        &self,
        gpu: &'g Gpu,
        front: &Front<'g>,
        reached: &Buffer<Reached>,
        before: &Buffer<[[f32; 4]]>,
    ) -> Bound<'g> {
        let (Front { params, jobs, blocks, phi, slots, .. }, Copies { copies, values, .. }) = (front, self);
        CopyFront { params, jobs, blocks, phi, reached, copies, values, slots, before }.bind(gpu)
    }

    /// The pool of values, which begins with how many were copied or would have been.
    pub fn pool(&self) -> &Buffer<Values> {
        &self.values
    }

    /// Bytes of all that they are.
    pub fn bytes(&self) -> usize {
        let ends = self.ends.as_ref().map_or(0, |ends| ends.raw.bytes());
        (self.copies.raw.bytes() + self.values.raw.bytes() + ends) as usize
    }

    /// These copies with the states in which the jobs ended, and the contours that they went to.
    pub fn finished(self, states: Vec<Job>, ends: Buffer<[f32]>) -> Self {
        Copies { states, ends: Some(ends), ..self }
    }

    /// The contours that the jobs went to, and where that of job `q` begins.
    pub fn end(&self, q: usize) -> (Option<&Buffer<[f32]>>, u32) {
        (self.ends.as_ref(), self.states[q].offset)
    }

    /// First block of copy `k` of job `q`; [`NONE`] where its front had vanished.
    fn first(&self, q: usize, k: usize) -> u32 {
        let job = &self.states[q];
        if job.phase == VANISHED && k as u32 >= job.next_time {
            return NONE;
        }
        job.first_copy + k as u32 * job.block_count
    }
}

/// Pairs of sweeps that have been swept.
pub struct SweptPairs<'p> {
    /// The pairs.
    pub pairs: &'p [&'p SweepPair<'p>],
    /// Courses of both sweeps of each.
    pub swept: Vec<Swept>,
    /// Their fronts.
    pub copies: Copies,
    /// Parameters of all of them.
    pub params: Params,
    /// Direction from which they count.
    pub sweep: Sweep,
}

/// Slices of all pairs, as many at once as fit.
pub fn fill_slices(
    gpu: &Gpu,
    pairs: &[&SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    (swept, copies): (Vec<Swept>, Copies),
) -> Result<Vec<Filled>> {
    let wanted: Vec<(usize, usize)> =
        pairs.iter().enumerate().flat_map(|(p, pair)| (0..pair.up.times.len()).map(move |k| (p, k))).collect();
    let mut out: Vec<Filled> =
        swept.chunks_exact(2).map(|s| Filled { slices: Vec::new(), up: s[0].clone(), down: s[1].clone() }).collect();
    let params = morph_params(h, options);
    let swept = SweptPairs { pairs, swept, copies, params, sweep: options.sweep };
    let share = |&(p, _): &(usize, usize)| {
        let nodes = padded(pairs[p].up.source.data.len());
        // What is read back lies there twice.
        let share = gpu.share(nodes * (distance::NODE_BYTES + 4), 4 * nodes);
        share.max(gpu.share_of_work(work::DISTANCE_PIXEL * nodes))
    };
    let slices = in_batches(gpu, wanted.iter().map(share), |batch| {
        let batch = &wanted[batch];
        let mut slices = settled(|rounds| {
            let atlas = swept.atlas(batch);
            let (recorder, blended) = swept.blend(gpu, batch, &atlas)?;
            outwards(gpu, recorder, atlas, (params, rounds), blended)
        })?;
        // Most slices are whole. Those that are not are blended once more, mended as they were blended, and continued outwards.
        let lost = |&slot: &usize| is_broken(pairs[batch[slot].0], |pixel| slices[slot][pixel] >= 0.0);
        let broken: Vec<usize> = (0..batch.len()).filter(lost).collect();
        if !broken.is_empty() {
            let some: Vec<(usize, usize)> = broken.iter().map(|&slot| batch[slot]).collect();
            let (atlas, mended) = swept.mended(gpu, &some)?;
            let mended = settled(|rounds| {
                let recorder = Recorder::new(&gpu.device, &gpu.profiler);
                let mended = gpu.device.upload("mended", &mended)?;
                outwards(gpu, recorder, atlas.clone(), (params, rounds), mended)
            })?;
            for (&slot, field) in broken.iter().zip(mended) {
                slices[slot] = field;
            }
        }
        Ok(slices)
    })?;
    for (&(p, _), slice) in wanted.iter().zip(slices) {
        out[p].slices.push(slice);
    }
    Ok(out)
}

impl SweptPairs<'_> {
    /// Tiles of some slices, each a pair and the number of its time.
    pub fn atlas(&self, slices: &[(usize, usize)]) -> Atlas {
        Atlas::new(slices.iter().map(|&(p, _)| self.pairs[p].up.source.dims))
    }

    /// Records that both directions' copies are made one, slice by slice, without the holes that end between the contours.
    pub fn blend<'g>(
        &self,
        gpu: &'g Gpu,
        slices: &[(usize, usize)],
        atlas: &Atlas,
    ) -> Result<(Recorder<'g>, Buffer<[f32]>)> {
        let (device, Copies { value_capacity, copies, values, .. }) = (&gpu.device, &self.copies);
        let (mut holes, mut hole_values) = (Vec::new(), Vec::new());
        let mut first_values = BTreeMap::new();
        let mut items = Vec::with_capacity(slices.len());
        for (&(p, k), tile) in slices.iter().zip(&atlas.jobs) {
            let (pair, t) = (&self.pairs[p], self.pairs[p].up.times[k]);
            let weights = blend_weights(self.sweep, t, &self.swept[2 * p], &self.swept[2 * p + 1]);
            let [up_weight, down_weight] = weights.map(|w| w as f32);
            let mut first = *first_values.entry(p).or_insert_with(|| {
                let first = hole_values.len();
                for (cap, _) in pair.holes.iter() {
                    hole_values.extend(scaled(&cap.field, 1.0));
                }
                first
            });
            let item = Item {
                up: self.copies.first(2 * p, k),
                down: self.copies.first(2 * p + 1, pair.up.times.len() - 1 - k),
                up_weight,
                down_weight,
                block_count: tile.block_count,
                offset: tile.offset,
                first_hole: holes.len() as u32,
                hole_count: pair.holes.len() as u32,
                nx: tile.nx,
            };
            items.push(item);
            for (cap, direction) in pair.holes.iter() {
                let (offset, Tile { origin, dims }) = (bounded(cap.offset(direction.away(t))), cap.tile);
                let [x, y, nx, ny] = [origin[0], origin[1], dims[0], dims[1]].map(|n| n as u32);
                holes.push(Hole { first: first as u32, offset, x, y, nx, ny });
                first += cap.field.data.len();
            }
        }
        let blended = device.storage("blended", atlas.node_count())?;
        let largest = items.iter().map(|i| i.block_count as usize).max().unwrap_or(0);
        let size = Size::Rows(largest, items.len());
        let items = &device.upload("items", &items)?;
        let (holes, hole_values) = (&device.upload("holes", &holes)?, &device.upload("hole values", &hole_values)?);
        let params = &device.uniform("params", Params { value_capacity: *value_capacity, ..self.params });
        let blend = Blend { params, copies, values, items, blended: &blended, holes, hole_values }.bind(gpu);
        let mut recorder = Recorder::new(device, &gpu.profiler);
        if largest > 0 {
            recorder.run(&blend, size);
        }
        Ok((recorder, blended))
    }

    /// Some slices blended and mended on the host, on tiles of their own.
    pub fn mended(&self, gpu: &Gpu, slices: &[(usize, usize)]) -> Result<(Atlas, Vec<f32>)> {
        let atlas = self.atlas(slices);
        let (mut recorder, blended) = self.blend(gpu, slices, &atlas)?;
        let wanted: Wanted<f32> = recorder.read(&blended, 0, atlas.node_count());
        let values = recorder.submit()?.wait()?.values(&wanted)?;
        let mut mended = atlas.unpack(&values);
        for (field, &(p, k)) in mended.iter_mut().zip(slices) {
            mend(self.pairs[p], k, field);
        }
        let values = atlas.pack(mended.iter(), 1.0);
        Ok((atlas, values))
    }
}

/// Fields that are right near their contours as soon as what is recorded is done, continued outwards as distances; nothing where these have not settled.
fn outwards<'g>(
    gpu: &'g Gpu,
    recorder: Recorder<'g>,
    atlas: Atlas,
    (params, rounds): (Params, Rounds),
    u: Buffer<[f32]>,
) -> Result<Option<Vec<SparseImage<f32>>>> {
    let tiles = DistanceBuffers::new(gpu, atlas, params, u)?;
    let recorder = tiles.solve(recorder, true, rounds)?;
    tiles.read(recorder, |values| {
        let slice = |(q, job): (usize, &Job)| {
            SparseImage::of([job.nx as usize, job.ny as usize], &values[tiles.atlas.nodes(q)])
        };
        tiles.atlas.jobs.par_iter().enumerate().map(slice).collect()
    })
}
