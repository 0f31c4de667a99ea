//! Tiles of all jobs of a batch, one after the other in one buffer, and batches that fit a machine.

use std::ops::Range;

use rayon::prelude::*;

use super::Gpu;
use super::buffer::Buffer;
use super::device::Device;
use super::layout::{BLOCK, Job, PATCH};
use crate::error::{Error, Result};
use crate::grid::field::{FAR, Field, VALUES_OF_A_THREAD};

/// The place of every job of a batch.
#[derive(Debug, Clone, Default)]
pub struct Atlas {
    /// Jobs in order, tiles laid out, nothing begun.
    pub jobs: Vec<Job>,
}

impl Atlas {
    /// Tiles of these sizes.
    pub fn new(dims: impl IntoIterator<Item = [usize; 2]>) -> Self {
        let mut first_block = 0;
        let jobs = dims
            .into_iter()
            .map(|[nx, ny]| {
                let block_count = (nx * ny).div_ceil(BLOCK) as u32;
                let offset = first_block * BLOCK as u32;
                first_block += block_count;
                Job {
                    offset,
                    nx: nx as u32,
                    ny: ny as u32,
                    first_block: first_block - block_count,
                    block_count,
                    vanished: -1.0,
                    ..Job::default()
                }
            })
            .collect();
        Atlas { jobs }
    }

    /// Blocks of all tiles.
    pub fn block_count(&self) -> usize {
        self.jobs.last().map_or(0, |j| (j.first_block + j.block_count) as usize)
    }

    /// Nodes of all tiles, with what fills the last block of each.
    pub fn node_count(&self) -> usize {
        self.block_count() * BLOCK
    }

    /// Fields of all jobs in single precision, `fill` between them.
    pub fn pack<'a>(&self, fields: impl Iterator<Item = &'a Field>, fill: f32) -> Vec<f32> {
        let fields: Vec<&Field> = fields.collect();
        let mut out = vec![0.0; self.node_count()];
        let part = self.packer(&fields, fill);
        let parts = out.par_chunks_mut(VALUES_OF_A_THREAD).enumerate();
        parts.for_each(|(k, out)| part(k * VALUES_OF_A_THREAD, out));
        out
    }

    /// Makes a part of [`Atlas::pack`], from a number of its first value on.
    fn packer<'f>(&'f self, fields: &'f [&'f Field], fill: f32) -> impl Fn(usize, &mut [f32]) + Sync + 'f {
        move |first, out| {
            out.fill(fill);
            let end = first + out.len();
            let begin = self.jobs.partition_point(|job| job.offset as usize <= first).saturating_sub(1);
            for (job, field) in self.jobs.iter().zip(fields).skip(begin) {
                let offset = job.offset as usize;
                let own = first.max(offset)..end.min(offset + field.data.len());
                if own.start < own.end {
                    let values = &field.data[own.start - offset..own.end - offset];
                    let out = &mut out[own.start - first..own.end - first];
                    out.iter_mut().zip(values).for_each(|(to, v)| *to = v.clamp(-FAR, FAR) as f32);
                }
            }
        }
    }

    /// The values of [`Atlas::pack`] on a device.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn send<'a>(
        &self,
        device: &Device,
        label: &str,
        fields: impl IntoIterator<Item = &'a Field>,
        fill: f32,
    ) -> Result<Buffer<[f32]>> {
        let fields: Vec<&Field> = fields.into_iter().collect();
        device.upload_made(label, self.node_count(), self.packer(&fields, fill))
    }

    /// Fields of all jobs from values of the whole atlas.
    pub fn unpack(&self, values: &[f32]) -> Vec<Field> {
        let field = |(q, job): (usize, &Job)| Field {
            dims: [job.nx as usize, job.ny as usize],
            data: values[self.nodes(q)].par_iter().with_min_len(VALUES_OF_A_THREAD).map(|&v| f64::from(v)).collect(),
        };
        self.jobs.par_iter().enumerate().map(field).collect()
    }

    /// Nodes of a job.
    pub fn nodes(&self, q: usize) -> Range<usize> {
        let job = &self.jobs[q];
        let first = job.offset as usize;
        first..first + (job.nx * job.ny) as usize
    }

    /// Numbers of the patches of all tiles for the distance sweeps, of either colour of a checkerboard; writes into each job how many there are before
    /// its tile, and of these how many of the first colour. The device lays out the patches themselves.
    pub fn patches(&mut self) -> [usize; 2] {
        let (mut all, mut first) = (0, 0);
        for job in &mut self.jobs {
            (job.first_copy, job.first_bin) = (all, first);
            let own = job.nx.div_ceil(PATCH as u32) * job.ny.div_ceil(PATCH as u32);
            all += own;
            first += own.div_ceil(2);
        }
        [first, all - first].map(|count| count as usize)
    }
}

/// Pixels of all tiles that are inside, a bit for each, as the tiles lie.
pub fn bits(masks: &[&[bool]]) -> Vec<u32> {
    let words = |mask: &&[bool]| -> Vec<u32> {
        let word = |some: &[bool]| some.iter().enumerate().fold(0, |word, (k, inside)| word | u32::from(*inside) << k);
        let mut words: Vec<u32> = mask.chunks(32).map(word).collect();
        words.resize(padded(mask.len()) / 32, 0);
        words
    };
    masks.par_iter().map(words).collect::<Vec<_>>().concat()
}

/// Nodes of a tile with what fills its last block.
pub fn padded(nodes: usize) -> usize {
    nodes.next_multiple_of(BLOCK)
}

/// Cuts jobs that take these shares of a machine into batches, in order, each of at most the whole machine; a job that is more alone
/// makes its own batch.
pub fn batches(shares: impl IntoIterator<Item = f64>) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    let mut filled = 0.0;
    for (k, share) in shares.into_iter().enumerate() {
        match out.last_mut() {
            Some(batch) if filled + share <= 1.0 => {
                batch.end = k + 1;
                filled += share;
            }
            _ => {
                out.push(k..k + 1);
                filled = share;
            }
        }
    }
    out
}

/// Results of jobs that take these shares of a machine, in order, `work` for each batch of them, as [`in_ranges`] does it.
///
/// # Errors
/// The errors of `work`; [`Error::GpuMemory`] where there is none for a job alone.
pub fn in_batches<R>(
    gpu: &Gpu,
    shares: impl IntoIterator<Item = f64>,
    work: impl FnMut(Range<usize>) -> Result<Vec<R>>,
) -> Result<Vec<R>> {
    in_ranges(gpu, batches(shares), work)
}

/// Results of the jobs of all batches, in order, `work` for each batch. Where there is no memory for one, it is done in halves, down to one job.
///
/// # Errors
/// The errors of `work`; [`Error::GpuMemory`] where there is none for a job alone.
pub fn in_ranges<R>(
    gpu: &Gpu,
    mut open: Vec<Range<usize>>,
    mut work: impl FnMut(Range<usize>) -> Result<Vec<R>>,
) -> Result<Vec<R>> {
    open.reverse();
    let mut out = Vec::new();
    while let Some(batch) = open.pop() {
        match work(batch.clone()) {
            Err(Error::GpuMemory(_)) if batch.len() > 1 => {
                gpu.release()?;
                let middle = batch.start + batch.len() / 2;
                open.extend([middle..batch.end, batch.start..middle]);
            }
            results => out.extend(results?),
        }
    }
    Ok(out)
}
