//! Tiles of all jobs of a batch, one after the other in one buffer, and batches that fit a machine.

use std::ops::Range;

use rayon::prelude::*;

use super::Gpu;
use super::layout::{BLOCK, Block, Job, PATCH, Patch};
use crate::error::{Error, Result};
use crate::grid::field::{FAR, Field};

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

    /// The table of blocks: which job each belongs to.
    pub fn blocks(&self) -> Vec<Block> {
        let of = |(q, job): (usize, &Job)| {
            std::iter::repeat_n(Block { job: q as u32, ..Block::default() }, job.block_count as usize)
        };
        self.jobs.iter().enumerate().flat_map(of).collect()
    }

    /// Fields of all jobs in single precision, `fill` between them.
    pub fn pack<'a>(&self, fields: impl Iterator<Item = &'a Field>, fill: f32) -> Vec<f32> {
        let mut out = vec![fill; self.node_count()];
        let mut rest = &mut out[..];
        let mut tiles = Vec::with_capacity(self.jobs.len());
        for (job, field) in self.jobs.iter().zip(fields) {
            let (tile, later) = std::mem::take(&mut rest).split_at_mut(job.block_count as usize * BLOCK);
            tiles.push((tile, field));
            rest = later;
        }
        tiles.into_par_iter().for_each(|(tile, field)| {
            tile.iter_mut().zip(&field.data).for_each(|(to, v)| *to = v.clamp(-FAR, FAR) as f32);
        });
        out
    }

    /// Fields of all jobs from values of the whole atlas.
    pub fn unpack(&self, values: &[f32]) -> Vec<Field> {
        let field = |(q, job): (usize, &Job)| Field {
            dims: [job.nx as usize, job.ny as usize],
            data: values[self.nodes(q)].iter().map(|&v| f64::from(v)).collect(),
        };
        self.jobs.par_iter().enumerate().map(field).collect()
    }

    /// Nodes of a job.
    pub fn nodes(&self, q: usize) -> Range<usize> {
        let job = &self.jobs[q];
        let first = job.offset as usize;
        first..first + (job.nx * job.ny) as usize
    }

    /// Patches of all tiles for the distance sweeps, those of either colour of a checkerboard; writes each tile's first patch number into
    /// its job.
    pub fn patches(&mut self) -> [Vec<Patch>; 2] {
        let mut out = [Vec::new(), Vec::new()];
        let mut number = 0;
        for (q, job) in self.jobs.iter_mut().enumerate() {
            job.first_copy = number;
            let [columns, rows] = [job.nx, job.ny].map(|n| n.div_ceil(PATCH as u32));
            for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
                out[(row + column) as usize % 2].push(Patch { job: q as u32, column, row, number });
                number += 1;
            }
        }
        out
    }
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

/// Results of jobs that take these shares of a machine, in order, `work` for each batch of them. Where there is no memory for a batch, it is done
/// in halves, down to one job.
///
/// # Errors
/// The errors of `work`; [`Error::GpuMemory`] where there is none for a job alone.
pub fn in_batches<R>(
    gpu: &Gpu,
    shares: impl IntoIterator<Item = f64>,
    mut work: impl FnMut(Range<usize>) -> Result<Vec<R>>,
) -> Result<Vec<R>> {
    let mut open = batches(shares);
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
