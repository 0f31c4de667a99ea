//! What goes between host and device: values, work, answers; counted.

use std::sync::{MutexGuard, PoisonError};
use std::time::Duration;

use bytemuck::Pod;

use super::answers::Questions;
use super::buffer::Buffer;
use super::device::{Device, failure};
use super::layout::Headed;
use super::pool::Raw;
use super::upload::{self, Uploads, WORTH_ALL_THREADS};
use crate::error::Result;
use crate::report::DeviceUse;
use crate::report::clock::of_this_thread;

/// Longest time one batch of work may take before the device counts as hung.
const PATIENCE: Duration = Duration::from_secs(120);

impl Device {
    /// Gives the first values of a buffer new ones.
    pub fn write<T: Pod>(&self, buffer: &Buffer<[T]>, values: &[T]) {
        self.write_from(buffer, 0, values);
    }

    /// Gives the values of a buffer from the value `first` on new ones.
    pub fn write_from<T: Pod>(&self, buffer: &Buffer<[T]>, first: usize, values: &[T]) {
        self.send(&buffer.raw, (first * size_of::<T>()) as u64, bytemuck::cast_slice(values));
    }

    /// Gives the first `count` values of a buffer those that `make` makes, from a number of the first on: all threads at once where there are many.
    pub fn write_made<T: Pod>(&self, buffer: &Buffer<[T]>, count: usize, make: impl Fn(usize, &mut [T]) + Sync) {
        let bytes = count * size_of::<T>();
        if bytes < WORTH_ALL_THREADS {
            let mut made = vec![T::zeroed(); count];
            make(0, &mut made);
            return self.write(buffer, &made);
        }
        let bytes = bytes as u64;
        self.count(|counts| counts.bytes_up += bytes);
        // Whoever waits for all threads may be given another's work meanwhile: nothing is locked.
        let chunks = self.uploads().chunks(self, bytes);
        if let Err(e) = upload::fill(&chunks, count, &make) {
            self.fail(e);
        }
        self.uploads().send_filled(self, &buffer.raw, 0, chunks, bytes);
    }

    /// Copies `count` values from a place of one buffer to one of another before the next work.
    pub(super) fn copy_before<T: Pod>(
        &self,
        (from, first): (&Buffer<[T]>, usize),
        (to, place): (&Buffer<[T]>, usize),
        count: usize,
    ) {
        let bytes = |values: usize| (values * size_of::<T>()) as u64;
        if count > 0 {
            self.uploads().copy(self, (&from.raw, bytes(first)), (&to.raw, bytes(place)), bytes(count));
        }
    }

    /// Sends bytes, from the byte `first` of a buffer on, with the next work.
    pub(super) fn send(&self, buffer: &Raw, first: u64, bytes: &[u8]) {
        self.count(|counts| counts.bytes_up += bytes.len() as u64);
        self.uploads().send(self, buffer, first, bytes);
    }

    pub(super) fn uploads(&self) -> MutexGuard<'_, Uploads> {
        self.uploads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What was asked of the device so far.
    pub fn used(&self) -> DeviceUse {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Counts what is asked of the device.
    pub(super) fn count(&self, what: impl FnOnce(&mut DeviceUse)) {
        what(&mut self.counts.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Runs a call in which a driver may compute; counts the CPU time of the calling thread as the driver's.
    fn in_driver<T>(&self, call: impl FnOnce() -> T) -> T {
        let before = of_this_thread();
        let result = call();
        if let Some((before, after)) = before.zip(of_this_thread()) {
            self.count(|counts| counts.driver_seconds += after - before);
        }
        result
    }

    /// Sends work off, behind the values that it needs.
    pub(super) fn submit(&self, work: wgpu::CommandBuffer) -> wgpu::SubmissionIndex {
        self.count(|counts| counts.submits += 1);
        let mut uploads = self.uploads();
        let (before, targets) = uploads.take();
        let sent = self.in_driver(|| self.queue.submit(before.into_iter().chain([work])));
        uploads.recall(self.pool());
        drop(uploads);
        drop(targets);
        sent
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device is lost, has complained, or hangs.
    pub fn wait(&self) -> Result<()> {
        self.wait_for(None)
    }

    /// Waits until some work is done, or everything that was sent off.
    ///
    /// # Errors
    /// The errors of [`Device::wait`].
    pub(super) fn wait_for(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<()> {
        self.count(|counts| counts.waits += 1);
        let until = wgpu::PollType::Wait { submission_index, timeout: Some(PATIENCE) };
        let poll = self.in_driver(|| self.device.poll(until));
        self.check()?;
        poll.map(|_| ())
            .map_err(|e| failure(format!("{}: no answer within {} s: {e}", self.summary.name, PATIENCE.as_secs())))
    }

    /// Copies `count` values back, from the value `first` on.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`] and [`Device::wait`].
    pub fn read<T: Pod>(&self, buffer: &Buffer<[T]>, first: usize, count: usize) -> Result<Vec<T>> {
        self.read_as(buffer, first, count)
    }

    /// Copies the head of a list back.
    ///
    /// # Errors
    /// The errors of [`Device::read`].
    pub fn read_head<H: Headed>(&self, buffer: &Buffer<H>) -> Result<H> {
        let head: Vec<H> = self.read_as(buffer, 0, 1)?;
        Ok(head[0])
    }

    fn read_as<T: Pod>(&self, buffer: &Buffer<impl ?Sized>, first: usize, count: usize) -> Result<Vec<T>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let mut questions = Questions::default();
        let wanted = questions.ask(buffer, first, count);
        let nothing = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read") });
        questions.send(self, nothing)?.wait()?.values(&wanted)
    }
}
