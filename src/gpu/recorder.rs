//! Recorder of work: dispatches, copies and zeros, in order, sent off together.

use std::sync::Arc;

use bytemuck::Pod;

use super::answers::{Answers, Questions, Wanted};
use super::buffer::Buffer;
use super::device::{Device, failure};
use super::kernels::{Bound, SCAN_WIDTH, WORKGROUP};
use super::pool::Raw;
use super::profiler::{Profiler, Stamps};
use crate::error::{Error, Result};

/// Number of invocations of a dispatch.
#[derive(Debug, Clone, Copy)]
pub enum Size<'b> {
    /// One per item of a list of this length.
    List(usize),
    /// A row of workgroups with this many invocations for each of this many items.
    Rows(usize, usize),
    /// One workgroup.
    One,
    /// Number of workgroups along three axes, read at this byte of a buffer; what they are workgroups of.
    Indirect(&'b Raw, u64, Listed),
}

/// Lists whose lengths only the device knows until the next look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Listed {
    /// Blocks near a front.
    Blocks,
    /// Eighths of these blocks.
    Eighths,
    /// Pixels of a band.
    Pixels,
    /// Chunks of them.
    Chunks,
    /// Blocks of fronts that are copied.
    Copies,
}

/// Number of [`Listed`] lists.
pub const LISTS: usize = 5;

/// Timestamps of one submission at most.
const MOST_QUERIES: u32 = 4096;

fn groups(n: usize) -> usize {
    n.div_ceil(WORKGROUP as usize)
}

/// Workgroups of a dispatch over a list, at most so many in a row and rows in a layer.
fn list_shape(n: usize, most: usize) -> [usize; 3] {
    let (groups, rows) = (groups(n), groups(n).div_ceil(most));
    [groups.min(most), rows.min(most), rows.div_ceil(most)]
}

/// Workgroups that a device allows of a kernel.
fn allowed(device: &Device, kernel: &str, shape: [usize; 3]) -> Result<[u32; 3]> {
    let most = device.most_groups();
    match shape.map(|n| u32::try_from(n).ok().filter(|n| *n <= most)) {
        [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
        _ => Err(failure(format!(
            "kernel `{kernel}`: {shape:?} workgroups, {} allows {most} along an axis",
            device.summary.name
        ))),
    }
}

impl Device {
    /// Runs a kernel over a list of `count` items before the next work, behind what was sent before.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] for more workgroups than the device allows.
    pub(super) fn run_before(&self, bound: &Bound<'_>, count: usize) -> Result<()> {
        let shape = allowed(self, bound.label(), list_shape(count, self.grid() as usize))?;
        self.count(|counts| counts.count_dispatches(1, count as u64));
        self.uploads().run(self, bound, shape);
        Ok(())
    }
}

/// Work being recorded.
pub struct Recorder<'d> {
    device: &'d Device,
    profiler: &'d Profiler,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    queries: Option<wgpu::QuerySet>,
    /// Kernel and pixels of each dispatch.
    runs: Vec<(&'static str, usize)>,
    /// The first dispatch that no device allows.
    refused: Option<Error>,
    /// Dispatches over each list.
    listed: [u64; LISTS],
    /// Buffers that the work needs: nobody else gets them before it is sent off.
    needed: Vec<Arc<[Raw]>>,
    questions: Questions,
}

impl<'d> Recorder<'d> {
    /// An empty recording.
    pub fn new(device: &'d Device, profiler: &'d Profiler) -> Self {
        let encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("work") });
        let queries = (profiler.timed && device.can_time).then(|| {
            device.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("profile"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST_QUERIES,
            })
        });
        Recorder {
            device,
            profiler,
            encoder,
            pass: None,
            queries,
            runs: Vec::new(),
            refused: None,
            listed: [0; LISTS],
            needed: Vec::new(),
            questions: Questions::default(),
        }
    }

    /// Records one dispatch.
    pub fn run(&mut self, bound: &Bound<'_>, size: Size<'_>) {
        let at = 2 * self.runs.len() as u32;
        let timed = self.queries.as_ref().filter(|_| at + 1 < MOST_QUERIES);
        if timed.is_some() || self.pass.is_none() {
            self.pass = None;
            let timestamp_writes = timed.map(|query_set| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(at),
                end_of_pass_write_index: Some(at + 1),
            });
            let descriptor = wgpu::ComputePassDescriptor { label: Some("work"), timestamp_writes };
            self.pass = Some(self.encoder.begin_compute_pass(&descriptor).forget_lifetime());
        }
        let Some(pass) = &mut self.pass else { return };
        let pixels = match size {
            Size::List(n) => n,
            Size::Rows(n, rows) => n * rows,
            _ => 0,
        };
        self.runs.push((bound.label(), pixels));
        self.needed.push(bound.buffers());
        bound.set(pass);
        match size {
            Size::Indirect(_, _, list) => self.listed[list as usize] += 1,
            Size::One => self.device.count(|counts| counts.count_dispatches(1, SCAN_WIDTH.into())),
            _ => self.device.count(|counts| counts.count_dispatches(1, pixels as u64)),
        }
        let most = self.device.grid() as usize;
        let shape = match size {
            Size::Indirect(buffer, offset, _) => return pass.dispatch_workgroups_indirect(buffer, offset),
            Size::List(n) => list_shape(n, most),
            Size::Rows(n, rows) => [groups(n), rows.min(most), rows.div_ceil(most)],
            Size::One => [1, 1, 1],
        };
        match allowed(self.device, bound.label(), shape) {
            Ok([x, y, z]) => pass.dispatch_workgroups(x, y, z),
            Err(e) => {
                self.refused.get_or_insert(e);
            }
        }
    }

    /// Records a copy of whole values.
    pub fn copy<T>(&mut self, from: &Buffer<[T]>, to: &Buffer<[T]>, bytes: u64) {
        self.copy_part((from, 0), (to, 0), bytes);
    }

    /// Records a copy of bytes between places of two buffers.
    pub fn copy_part<T>(&mut self, (from, first): (&Buffer<[T]>, u64), (to, place): (&Buffer<[T]>, u64), bytes: u64) {
        self.pass = None;
        self.needed.push([from.raw.clone(), to.raw.clone()].into());
        self.encoder.copy_buffer_to_buffer(&from.raw, first, &to.raw, place, bytes);
    }

    /// Records zeros.
    pub fn clear<T>(&mut self, buffer: &Buffer<[T]>) {
        self.pass = None;
        self.needed.push([buffer.raw.clone()].into());
        self.encoder.clear_buffer(&buffer.raw, 0, Some(buffer.raw.bytes()));
    }

    /// Records that `count` values are read back, from the value `first` on, as they are after all that is recorded.
    pub fn read<T: Pod>(&mut self, buffer: &Buffer<impl ?Sized>, first: usize, count: usize) -> Wanted<T> {
        self.questions.ask(buffer, first, count)
    }

    /// Sends the recording off.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] when the device has failed, and for more workgroups than it allows.
    pub fn submit(mut self) -> Result<Answers<'d>> {
        self.pass = None;
        if let Some(refused) = self.refused.take() {
            return Err(refused);
        }
        let stamps = match self.queries.take() {
            Some(set) if !self.runs.is_empty() => {
                let count = (2 * self.runs.len() as u32).min(MOST_QUERIES);
                let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
                let resolved = self.device.buffer("timestamps", u64::from(count) * 8, usage)?;
                self.encoder.resolve_query_set(&set, 0..count, &resolved.raw, 0);
                let kernels = self.runs.iter().map(|(kernel, _)| *kernel).collect();
                Some(Stamps { buffer: resolved, count: count as usize, kernels })
            }
            _ => None,
        };
        let answers = self.questions.send(self.device, self.encoder)?;
        self.device.check()?;
        self.profiler.submitted(self.device, &self.runs, self.listed, stamps)?;
        Ok(answers)
    }
}
