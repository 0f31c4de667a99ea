//! Buffers of a device: made within its limits and its budget, or taken from those that wait.

use std::marker::PhantomData;

use bytemuck::Pod;

use super::device::{Device, failure};
use super::layout::Headed;
use super::pool::{Raw, capacity};
use crate::error::{Error, Result};

/// Buffer that kernels read and write.
const STORAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::INDIRECT)
    .union(wgpu::BufferUsages::COPY_SRC)
    .union(wgpu::BufferUsages::COPY_DST);

/// A buffer that holds a `T`: `[f32]` for an array, a struct for one value or for the head of a list. When nobody holds it any more it waits for
/// the next who needs one like it.
#[derive(Debug)]
pub struct Buffer<T: ?Sized> {
    pub(super) raw: Raw,
    holds: PhantomData<T>,
}

impl Device {
    /// A buffer of `bytes`, within the limits and the budget.
    ///
    /// # Errors
    /// [`Error::GpuMemory`], or [`Error::Gpu`] for a buffer that no limit allows; both name the buffer and its size.
    pub fn buffer<T: ?Sized>(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Buffer<T>> {
        self.check()?;
        let size = bytes.next_multiple_of(4).max(16);
        let staging = usage.contains(wgpu::BufferUsages::MAP_READ);
        let limit = if staging { self.limits.max_buffer_size } else { self.largest_binding() };
        if size > limit {
            return Err(failure(format!("buffer `{label}` needs {size} bytes, {} allows {limit}", self.summary.name)));
        }
        let capacity = capacity(size).min(limit - limit % 4);
        if let Some(held) = self.pool().take(capacity, usage) {
            return Ok(Buffer { raw: Raw::new(held, size), holds: PhantomData });
        }
        if !self.pool().reserve(capacity) {
            return Err(Error::GpuMemory(format!(
                "out of memory: buffer `{label}` of {size} bytes exceeds the budget of {} bytes (--gpu-memory, --memory) beside what is there",
                self.room.min(self.made.grants.unwrap_or(u64::MAX))
            )));
        }
        let out_of_memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let invalid = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let raw = self.create(label, capacity, usage, false);
        let error = pollster::block_on(invalid.pop()).or(pollster::block_on(out_of_memory.pop()));
        match error {
            Some(e) => {
                self.pool().give_back(capacity);
                let why = format!("buffer `{label}` of {size} bytes: {e}");
                Err(if matches!(e, wgpu::Error::OutOfMemory { .. }) { Error::GpuMemory(why) } else { failure(why) })
            }
            None => Ok(Buffer { raw: Raw::new(self.pool().held(raw), size), holds: PhantomData }),
        }
    }

    /// A new buffer of the driver's.
    fn create(&self, label: &str, size: u64, usage: wgpu::BufferUsages, mapped_at_creation: bool) -> wgpu::Buffer {
        self.count(|counts| counts.buffers += 1);
        let label = Some(label);
        self.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation })
    }

    /// A buffer that the host can write at once; none of a device that has failed, which would panic.
    pub(super) fn mapped(&self, label: &str, size: u64) -> Option<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC;
        self.check().is_ok().then(|| self.create(label, size, usage, true))
    }

    /// A storage buffer of `count` values that some kernel writes before any reads them; NaN until then if [`GpuOptions::poison`] says so.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn storage<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer<[T]>> {
        // A binding must hold one.
        let buffer = self.buffer(label, (count.max(1) * size_of::<T>()) as u64, STORAGE)?;
        if self.poison {
            self.queue.write_buffer(&buffer.raw, 0, &vec![0xff; buffer.raw.bytes() as usize]);
        }
        Ok(buffer)
    }

    /// A storage buffer of `count` zeroed values.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn zeroed<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer<[T]>> {
        self.cleared(self.buffer(label, (count.max(1) * size_of::<T>()) as u64, STORAGE)?)
    }

    /// A buffer whose values are zero before the next work.
    fn cleared<T: ?Sized>(&self, buffer: Buffer<T>) -> Result<Buffer<T>> {
        self.uploads().clear(self, &buffer.raw);
        Ok(buffer)
    }

    /// A storage buffer with a head and a list of `count` items behind it, zeroed.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn headed<H: Headed>(&self, label: &str, count: usize) -> Result<Buffer<H>> {
        self.cleared(self.buffer(label, (size_of::<H>() + count * size_of::<H::Item>()) as u64, STORAGE)?)
    }

    /// A storage buffer with these values.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn upload<T: Pod>(&self, label: &str, values: &[T]) -> Result<Buffer<[T]>> {
        let buffer = if values.is_empty() {
            self.zeroed(label, 0)?
        } else {
            self.buffer(label, size_of_val(values) as u64, STORAGE)?
        };
        self.write(&buffer, values);
        Ok(buffer)
    }

    /// A storage buffer of `count` values, which `make` makes from a number of the first on: all threads at once where there are many.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn upload_made<T: Pod>(
        &self,
        label: &str,
        count: usize,
        make: impl Fn(usize, &mut [T]) + Sync,
    ) -> Result<Buffer<[T]>> {
        if count == 0 {
            return self.zeroed(label, 0);
        }
        let buffer = self.storage(label, count)?;
        self.write_made(&buffer, count, make);
        Ok(buffer)
    }

    /// A uniform buffer with one value.
    pub fn uniform<T: Pod>(&self, label: &str, value: T) -> Buffer<T> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let size = size_of::<T>() as u64;
        let held = self.pool().take(capacity(size), usage).unwrap_or_else(|| {
            self.pool().count(capacity(size));
            self.pool().held(self.create(label, capacity(size), usage, false))
        });
        let raw = Raw::new(held, size);
        self.send(&raw, 0, bytemuck::bytes_of(&value));
        Buffer { raw, holds: PhantomData }
    }
}
