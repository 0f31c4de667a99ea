//! Values that work gives back: copied together behind it, read when the device has done it.

use std::marker::PhantomData;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;

use super::buffer::Buffer;
use super::device::{Device, failure};
use super::pool::Raw;
use crate::error::Result;

/// Places of values in what is read are multiples of this.
const ALIGNMENT: u64 = 16;

/// Place of some values among all that a piece of work gives back.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<T> {
    first: u64,
    bytes: u64,
    holds: PhantomData<T>,
}

/// What is to be read back of a piece of work.
#[derive(Debug, Default)]
pub struct Questions {
    copies: Vec<(Raw, u64, u64)>,
    bytes: u64,
}

type Outcome = Arc<Mutex<Option<std::result::Result<(), wgpu::BufferAsyncError>>>>;

/// What will be read back of work that was sent off.
#[derive(Debug)]
pub struct Answers<'d> {
    device: &'d Device,
    staging: Option<Raw>,
    outcome: Outcome,
    work: wgpu::SubmissionIndex,
}

/// Values that have come back.
#[derive(Debug)]
pub struct Landed<'d> {
    device: &'d Device,
    staging: Option<Raw>,
}

impl Questions {
    /// Asks for `count` values from the value `first` on.
    pub fn ask<T: Pod>(&mut self, buffer: &Buffer<impl ?Sized>, first: usize, count: usize) -> Wanted<T> {
        let size = size_of::<T>() as u64;
        let wanted = Wanted { first: self.bytes, bytes: count as u64 * size, holds: PhantomData };
        if count > 0 {
            self.copies.push((buffer.raw.clone(), first as u64 * size, wanted.bytes));
            self.bytes += wanted.bytes.next_multiple_of(ALIGNMENT);
        }
        wanted
    }

    /// Sends work off and has the values copied behind it.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn send(self, device: &Device, mut work: wgpu::CommandEncoder) -> Result<Answers<'_>> {
        let staging = match self.bytes {
            0 => None,
            bytes => {
                let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
                Some(device.buffer::<[u8]>("staging", bytes, usage)?.raw)
            }
        };
        let mut place = 0;
        for (from, first, bytes) in &self.copies {
            if let Some(staging) = &staging {
                work.copy_buffer_to_buffer(from, *first, staging, place, *bytes);
            }
            place += bytes.next_multiple_of(ALIGNMENT);
        }
        device.count(|counts| counts.bytes_down += self.copies.iter().map(|(_, _, bytes)| bytes).sum::<u64>());
        let work = device.submit(work.finish());
        let outcome = Outcome::default();
        if let Some(staging) = &staging {
            let slot = outcome.clone();
            staging.slice(..self.bytes).map_async(wgpu::MapMode::Read, move |mapped| {
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(mapped);
            });
        }
        Ok(Answers { device, staging, outcome, work })
    }
}

impl<'d> Answers<'d> {
    /// Waits for the work whose values these are, not for what was sent off after it.
    ///
    /// # Errors
    /// The errors of [`Device::wait`].
    pub fn wait(self) -> Result<Landed<'d>> {
        self.device.wait_for(Some(self.work.clone()))?;
        self.land()
    }

    /// Waits once for all of several pieces of work, each of which was sent off after the one before.
    ///
    /// # Errors
    /// The errors of [`Device::wait`].
    pub fn wait_for_all(all: Vec<Self>) -> Result<Vec<Landed<'d>>> {
        if let Some(last) = all.last() {
            last.device.wait_for(Some(last.work.clone()))?;
        }
        all.into_iter().map(Self::land).collect()
    }

    /// The values of work that is done.
    fn land(mut self) -> Result<Landed<'d>> {
        let device = self.device;
        let staging = self.staging.take();
        let failed = |why: String| failure(format!("{}: reading back {why}", device.summary.name));
        if let Some(staging) = staging.as_ref() {
            let outcome = self.outcome.lock().unwrap_or_else(PoisonError::into_inner).take();
            match outcome {
                Some(Ok(())) => {}
                Some(Err(e)) => return Err(failed(format!("failed: {e}"))),
                None => {
                    staging.unmap();
                    return Err(failed("gave no answer".into()));
                }
            }
        }
        Ok(Landed { device, staging })
    }
}

impl Drop for Answers<'_> {
    fn drop(&mut self) {
        // Nobody will read it: the buffer can be used again.
        self.staging.iter().for_each(|staging| staging.unmap());
    }
}

impl Landed<'_> {
    /// The values at a place.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] with the driver's words.
    pub fn values<T: Pod>(&self, wanted: &Wanted<T>) -> Result<Vec<T>> {
        self.taken(wanted, <[T]>::to_vec)
    }

    /// What `take` makes of the values at a place, where they lie.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] with the driver's words.
    pub fn taken<T: Pod, R>(&self, wanted: &Wanted<T>, take: impl FnOnce(&[T]) -> R) -> Result<R> {
        let Some(staging) = self.staging.as_ref().filter(|_| wanted.bytes > 0) else { return Ok(take(&[])) };
        let view = staging
            .slice(wanted.first..wanted.first + wanted.bytes)
            .get_mapped_range()
            .map_err(|e| failure(format!("{}: reading back failed: {e}", self.device.summary.name)))?;
        Ok(match bytemuck::try_cast_slice(&view) {
            Ok(values) => take(values),
            Err(_) => take(&bytemuck::pod_collect_to_vec::<u8, T>(&view)),
        })
    }

    /// The one value at a place.
    ///
    /// # Errors
    /// The errors of [`Landed::values`].
    pub fn value<T: Pod>(&self, wanted: &Wanted<T>) -> Result<T> {
        let values = self.values(wanted)?;
        values.first().copied().ok_or_else(|| failure("nothing was read back"))
    }
}

impl Drop for Landed<'_> {
    fn drop(&mut self) {
        self.staging.iter().for_each(|staging| staging.unmap());
    }
}
