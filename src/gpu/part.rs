//! Distance fields of parts of contours on the GPU.

use rayon::prelude::*;

use super::Gpu;
use super::answers::Wanted;
use super::atlas::{Atlas, bits, in_batches, padded};
use super::distance::{DistanceBuffers, NODE_BYTES, Rounds, settled, settled_by};
use super::kernels::shader;
use super::layout::{Block, Job, Params};
use super::recorder::Recorder;
use super::work;
use crate::backend::jobs::PartJob;
use crate::error::Result;
use crate::grid::field::Field;

shader! {
    part = "common/job.wgsl" + "common/stencil.wgsl" + twin "src/reference/part.rs";

    /// Start values at the part's own edges and at the others'.
    StartPart for start_part, "part_start" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        whole: Read [f32],
        inside: Read [u32],
        d: Write [f32],
        awake: Write [u32],
    }

    /// The part's signed distance.
    FinishPart for finish_part, "part_finish" {
        params: Uniform Params,
        jobs: Read [Job],
        blocks: Read [Block],
        whole: Read [f32],
        inside: Read [u32],
        d: Write [f32],
    }
}

/// Fields of all parts. Those that are the whole contour, or nothing, are answered without computing.
pub fn part_fields(gpu: &Gpu, parts: &[PartJob], h: [f64; 2]) -> Result<Vec<Field>> {
    let mut out: Vec<Option<Field>> = parts.par_iter().map(PartJob::without_computing).collect();
    let open: Vec<usize> = (0..parts.len()).filter(|&k| out[k].is_none()).collect();
    // Two tiles a job; the whole field, the part's mask and the answer once.
    let share = |&k: &usize| {
        let nodes = 2 * padded(parts[k].inside.len());
        gpu.share(nodes * (NODE_BYTES + 4), 4 * nodes).max(gpu.share_of_work(work::DISTANCE_PIXEL * nodes))
    };
    let fields = in_batches(gpu, open.iter().map(share), |batch| {
        let batch: Vec<&PartJob> = open[batch].iter().map(|&k| &parts[k]).collect();
        settled(|rounds| some_fields(gpu, &batch, h, rounds))
    })?;
    for (k, field) in open.into_iter().zip(fields) {
        out[k] = Some(field);
    }
    Ok(out.into_iter().flatten().collect())
}

/// Fields of parts that fit the device together; nothing where the distances have not settled.
fn some_fields(gpu: &Gpu, batch: &[&PartJob], h: [f64; 2], rounds: Rounds) -> Result<Option<Vec<Field>>> {
    let device = &gpu.device;
    let atlas = Atlas::new(batch.iter().flat_map(|part| [part.whole.dims; 2]));
    let once = Atlas::new(batch.iter().map(|part| part.whole.dims));
    let whole = once.send(device, "whole", batch.iter().map(|part| &part.whole), 1.0)?;
    let inside = &device.upload("inside", &bits(&batch.iter().map(|part| &part.inside[..]).collect::<Vec<_>>()))?;
    let params = Params { hx: h[0] as f32, hy: h[1] as f32, ..Params::default() };
    let tiles = DistanceBuffers::new(gpu, atlas, params, whole)?;
    let DistanceBuffers { params, jobs, blocks, u: whole, d, awake, .. } = &tiles;
    let start = StartPart { params, jobs, blocks, whole, inside, d, awake }.bind(gpu);
    let finish = FinishPart { params, jobs, blocks, whole, inside, d }.bind(gpu);
    let mut recorder = Recorder::new(device, &gpu.profiler);
    recorder.run(&start, tiles.per_node());
    let mut recorder = tiles.settle(recorder, rounds)?;
    recorder.run(&finish, tiles.per_node());
    let found = device.storage("parts", once.node_count())?;
    for (own, job) in tiles.atlas.jobs.iter().step_by(2).zip(&once.jobs) {
        let [from, to, count] = [own.offset, job.offset, job.nx * job.ny].map(|n| 4 * u64::from(n));
        recorder.copy_part((d, from), (&found, to), count);
    }
    let changes = tiles.ask(&mut recorder);
    let wanted: Wanted<f32> = recorder.read(&found, 0, once.node_count());
    let landed = recorder.submit()?.wait()?;
    if !settled_by(&landed, &changes)? {
        return Ok(None);
    }
    let fields = landed.taken(&wanted, |values| once.unpack(values))?;
    gpu.keep_tiles(found, &once, &fields);
    Ok(Some(fields))
}
