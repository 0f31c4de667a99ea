//! Slices made of copied fronts on the GPU: blending, distances farther out, and the way back to the host.

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::{Atlas, in_batches, padded};
use super::band::Front;
use super::device::Buffer;
use super::distance::{self, DistanceBuffers};
use super::kernels::{Bound, shader};
use super::layout::{Block, Copy, Item, Job, NONE, Params, Reached, VANISHED, Values};
use super::recorder::{Recorder, Size};
use super::trace::morph_params;
use super::work;
use crate::backend::MorphOptions;
use crate::backend::blend::{is_broken, mend};
use crate::backend::jobs::{Filled, SweepPair, Swept, blend_weights};
use crate::error::Result;
use crate::grid::sparse_image::SparseImage;

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
    }
}

/// Fronts at the output times of their jobs.
pub struct Copies {
    /// Places in the pool of values.
    pub value_capacity: u32,
    copies: Buffer<[Copy]>,
    values: Buffer<Values>,
    states: Vec<Job>,
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

    /// These copies with the states in which the jobs ended.
    pub fn finished(self, states: Vec<Job>) -> Self {
        Copies { states, ..self }
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

/// Slices of all pairs, as many at once as fit.
pub fn fill_slices(
    gpu: &Gpu,
    pairs: &[SweepPair<'_>],
    h: [f64; 2],
    options: &MorphOptions,
    (swept, copies): (Vec<Swept>, Copies),
) -> Result<Vec<Filled>> {
    let wanted: Vec<(usize, usize)> =
        pairs.iter().enumerate().flat_map(|(p, pair)| (0..pair.up.times.len()).map(move |k| (p, k))).collect();
    let mut out: Vec<Filled> =
        swept.chunks_exact(2).map(|s| Filled { slices: Vec::new(), up: s[0].clone(), down: s[1].clone() }).collect();
    let params = morph_params(h, options);
    let share = |&(p, _): &(usize, usize)| {
        let nodes = padded(pairs[p].up.source.data.len());
        // What is read back lies there twice.
        let share = gpu.share(nodes * (distance::NODE_BYTES + 4), 4 * nodes);
        share.max(gpu.share_of_work(work::DISTANCE_PIXEL * nodes))
    };
    let slices = in_batches(gpu, wanted.iter().map(share), |batch| {
        let batch = &wanted[batch];
        let atlas = Atlas::new(batch.iter().map(|&(p, _)| pairs[p].up.source.dims));
        let items: Vec<Item> = batch
            .iter()
            .zip(&atlas.jobs)
            .map(|(&(p, k), tile)| {
                let times = &pairs[p].up.times;
                let [up_weight, down_weight] = {
                    let (up, down) = (&out[p].up, &out[p].down);
                    blend_weights(options.sweep, times[k], up, down).map(|w| w as f32)
                };
                Item {
                    up: copies.first(2 * p, k),
                    down: copies.first(2 * p + 1, times.len() - 1 - k),
                    up_weight,
                    down_weight,
                    block_count: tile.block_count,
                    offset: tile.offset,
                    ..Item::default()
                }
            })
            .collect();
        let (recorder, blended) = blend(gpu, &copies, &items, atlas.node_count(), params)?;
        let mut slices = outwards(gpu, recorder, atlas, params, blended)?;
        // Most slices are whole. Those that are not are blended once more, mended as they were blended, and continued outwards.
        let lost = |&slot: &usize| is_broken(&pairs[batch[slot].0], |pixel| slices[slot][pixel] >= 0.0);
        let broken: Vec<usize> = (0..batch.len()).filter(lost).collect();
        if !broken.is_empty() {
            let atlas = Atlas::new(broken.iter().map(|&slot| slices[slot].dims()));
            let again: Vec<Item> = broken
                .iter()
                .zip(&atlas.jobs)
                .map(|(&slot, tile)| Item { offset: tile.offset, ..items[slot] })
                .collect();
            let (mut recorder, blended) = blend(gpu, &copies, &again, atlas.node_count(), params)?;
            let wanted: Wanted<f32> = recorder.read(&blended, 0, atlas.node_count());
            let values = recorder.submit()?.wait()?.values(&wanted)?;
            let mut mended = atlas.unpack(&values);
            for (field, &slot) in mended.iter_mut().zip(&broken) {
                let (p, k) = batch[slot];
                mend(&pairs[p], k, field);
            }
            let recorder = Recorder::new(&gpu.device, &gpu.profiler);
            let mended = gpu.device.upload("mended", &atlas.pack(mended.iter(), 1.0))?;
            for (&slot, field) in broken.iter().zip(outwards(gpu, recorder, atlas, params, mended)?) {
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

/// Records that both directions' copies are made one, tile by tile.
fn blend<'g>(
    gpu: &'g Gpu,
    copies: &Copies,
    items: &[Item],
    nodes: usize,
    params: Params,
) -> Result<(Recorder<'g>, Buffer<[f32]>)> {
    let device = &gpu.device;
    let blended = device.storage("blended", nodes)?;
    let largest = items.iter().map(|i| i.block_count as usize).max().unwrap_or(0);
    let size = Size::Rows(largest, items.len());
    let items = &device.upload("items", items)?;
    let params = &device.uniform("params", Params { value_capacity: copies.value_capacity, ..params });
    let Copies { copies, values, .. } = copies;
    let blend = Blend { params, copies, values, items, blended: &blended }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&blend, size);
    Ok((recorder, blended))
}

/// Fields that are right near their contours as soon as what is recorded is done, continued outwards as distances.
fn outwards<'g>(
    gpu: &'g Gpu,
    recorder: Recorder<'g>,
    atlas: Atlas,
    params: Params,
    u: Buffer<[f32]>,
) -> Result<Vec<SparseImage<f32>>> {
    let tiles = DistanceBuffers::new(gpu, atlas, params, u)?;
    let recorder = tiles.solve(recorder, true)?;
    let values = tiles.read(recorder)?;
    let slice =
        |(q, job): (usize, &Job)| SparseImage::of([job.nx as usize, job.ny as usize], &values[tiles.atlas.nodes(q)]);
    Ok(tiles.atlas.jobs.par_iter().enumerate().map(slice).collect())
}
