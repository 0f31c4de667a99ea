//! One buffer for many arrays that come and go: what stays on the device between stages.

use std::collections::BTreeMap;

use bytemuck::Pod;

use super::Gpu;
use super::device::Buffer;
use super::recorder::Recorder;
use crate::error::Result;

/// Bytes that are read at once when values are taken off the device.
const PIECE: usize = 1 << 19;

/// An array in an arena: its first value and its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment {
    /// Number of the first value.
    pub first: usize,
    /// Number of values.
    pub len: usize,
}

impl Segment {
    /// Number of the first value, as kernels have it.
    pub fn begin(&self) -> u32 {
        self.first as u32
    }
}

/// Arrays of one type in one buffer.
#[derive(Debug)]
pub struct Arena<T> {
    label: &'static str,
    buffer: Option<Buffer<[T]>>,
    /// Values that the buffer holds.
    len: usize,
    /// Length of what is there, by its first value.
    live: BTreeMap<usize, usize>,
    /// Whether more has been asked for than a buffer of this device can hold.
    pub too_long: bool,
}

impl<T: Pod> Arena<T> {
    /// Nothing yet.
    pub fn new(label: &'static str) -> Self {
        Arena { label, buffer: None, len: 0, live: BTreeMap::new(), too_long: false }
    }

    /// The buffer.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn buffer(&mut self, gpu: &Gpu) -> Result<&Buffer<[T]>> {
        match &mut self.buffer {
            Some(buffer) => Ok(buffer),
            none => Ok(none.insert(gpu.device.storage(self.label, self.len)?)),
        }
    }

    /// Room for an array, in the first gap that is wide enough; the buffer grows where there is none.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn take(&mut self, gpu: &Gpu, len: usize) -> Result<Segment> {
        let mut first = 0;
        for (begin, length) in &self.live {
            if first + len <= *begin {
                break;
            }
            first = begin + length;
        }
        if first + len > self.len {
            self.grow(gpu, first + len)?;
        }
        self.live.insert(first, len.max(1));
        Ok(Segment { first, len })
    }

    /// Room for these values, which are sent there. What is recorded but not submitted sees them, too.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn put(&mut self, gpu: &Gpu, values: &[T]) -> Result<Segment> {
        let segment = self.take(gpu, values.len())?;
        gpu.device.write_at(self.buffer(gpu)?, segment.first, values);
        Ok(segment)
    }

    /// Gives an array's room back.
    pub fn free(&mut self, segment: Segment) {
        self.live.remove(&segment.first);
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        if self.buffer.is_some() { (self.len * size_of::<T>()) as u64 } else { 0 }
    }

    /// Bytes of what is there, gaps included.
    fn used(&self) -> usize {
        self.live.last_key_value().map_or(0, |(first, len)| first + len)
    }

    /// A longer buffer with the same values.
    fn grow(&mut self, gpu: &Gpu, len: usize) -> Result<()> {
        self.too_long |= (len * size_of::<T>()) as u64 > gpu.device.largest_binding();
        // Half as much again, so that a few times are enough; no more where that does not fit.
        let wide = len + len / 2;
        let made = gpu.device.storage(self.label, wide).map(|buffer| (buffer, wide));
        let (buffer, len) = match made.or_else(|_| gpu.device.storage(self.label, len).map(|buffer| (buffer, len))) {
            Ok(made) => made,
            Err(error) if self.too_long => return Err(error),
            // Not both at once.
            Err(_) => {
                let values = self.park(gpu)?;
                self.len = len;
                return self.unpark(gpu, &values);
            }
        };
        if let (Some(old), used @ 1..) = (&self.buffer, self.used()) {
            let mut recorder = Recorder::new(&gpu.device, &gpu.profiler);
            recorder.copy(old, &buffer, (used * size_of::<T>()) as u64);
            recorder.submit()?;
        }
        (self.buffer, self.len) = (Some(buffer), len);
        Ok(())
    }

    /// Takes the values off the device.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::read`].
    pub fn park(&mut self, gpu: &Gpu) -> Result<Vec<T>> {
        let mut values = Vec::new();
        if let Some(buffer) = &self.buffer {
            // In pieces, which lie there twice: little is left where this is needed.
            while values.len() < self.used() {
                let count = (self.used() - values.len()).min(PIECE / size_of::<T>());
                values.extend(gpu.device.read(buffer, values.len(), count)?);
            }
        }
        (self.buffer, self.len) = (None, self.used());
        Ok(values)
    }

    /// Puts values that were taken off back on the device.
    ///
    /// # Errors
    /// The errors of [`super::device::Device::buffer`].
    pub fn unpark(&mut self, gpu: &Gpu, values: &[T]) -> Result<()> {
        gpu.device.write_at(self.buffer(gpu)?, 0, values);
        Ok(())
    }
}
