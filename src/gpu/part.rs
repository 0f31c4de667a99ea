//! Distance fields of parts of contours on the GPU.

use super::Gpu;
use super::atlas::{Atlas, batches, padded};
use super::distance::{DistanceBuffers, NODE_BYTES};
use super::kernels::Recorder;
use super::layout::Params;
use crate::backend::jobs::PartJob;
use crate::error::Result;
use crate::grid::field::Field;

/// Fields of all parts. Those that are the whole contour, or nothing, are answered without computing.
pub fn part_fields(gpu: &Gpu, jobs: &[PartJob], h: [f64; 2]) -> Result<Vec<Field>> {
    let mut out: Vec<Option<Field>> = jobs.iter().map(PartJob::without_computing).collect();
    let open: Vec<usize> = (0..jobs.len()).filter(|&k| out[k].is_none()).collect();
    // Two tiles a job, with the whole field and the part's mask.
    let share = |&k: &usize| {
        let nodes = 2 * padded(jobs[k].inside.len());
        gpu.share(nodes * (NODE_BYTES + 4), 4 * nodes)
    };
    for batch in batches(open.iter().map(share)) {
        let batch = &open[batch];
        let atlas = Atlas::new(batch.iter().flat_map(|&k| [jobs[k].whole.dims; 2]));
        let whole = atlas.pack(batch.iter().flat_map(|&k| [&jobs[k].whole; 2]), 1.0);
        let masks: Vec<Field> = batch.iter().map(|&k| mask_field(&jobs[k])).collect();
        let inside = gpu.device.upload("inside", &atlas.pack(masks.iter().flat_map(|m| [m; 2]), 0.0))?;
        let params = Params { hx: h[0] as f32, hy: h[1] as f32, ..Params::default() };
        let tiles = DistanceBuffers::new(gpu, atlas, params, gpu.device.upload("whole", &whole)?)?;
        let DistanceBuffers { params, jobs: table, blocks, u, d, awake, .. } = &tiles;
        let start = gpu.kernels.part_start.bind(
            &gpu.device,
            &[
                ("params", params),
                ("jobs", table),
                ("blocks", blocks),
                ("whole", u),
                ("inside", &inside),
                ("d", d),
                ("awake", awake),
            ],
        );
        let finish = gpu.kernels.part_finish.bind(
            &gpu.device,
            &[("params", params), ("jobs", table), ("blocks", blocks), ("whole", u), ("inside", &inside), ("d", d)],
        );
        let mut work = Recorder::new(&gpu.device, &gpu.profiler);
        work.run(&start, tiles.per_node());
        work.submit()?;
        tiles.settle()?;
        let mut work = Recorder::new(&gpu.device, &gpu.profiler);
        work.run(&finish, tiles.per_node());
        work.submit()?;
        let fields = tiles.atlas.unpack(&tiles.read()?);
        for (&k, field) in batch.iter().zip(fields.into_iter().step_by(2)) {
            out[k] = Some(field);
        }
    }
    Ok(out.into_iter().flatten().collect())
}

fn mask_field(job: &PartJob) -> Field {
    Field { dims: job.whole.dims, data: job.inside.iter().map(|&m| f64::from(u8::from(m))).collect() }
}
