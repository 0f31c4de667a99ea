//! The device: choosing an adapter, limits, the byte budget, waiting, and what goes wrong.

use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytemuck::Pod;
use sysinfo::System;

use super::adapter::{AdapterSummary, enumerate};
use super::layout::Headed;
use crate::error::{Error, Result};

/// Longest time one batch of work may take before the device counts as hung.
const PATIENCE: Duration = Duration::from_secs(120);
/// Share of the memory that is free now which software adapters, and GPUs that do not say how much they have, may use.
const SHARE: f64 = 0.6;
/// Budget where nothing is known about memory.
const UNKNOWN_BUDGET: u64 = 2 << 30;
/// Bytes of the host's memory that a driver and the compiled kernels take: 105 MiB measured on lavapipe.
pub const DRIVER_BYTES: u64 = 112 << 20;
/// Share for the buffers of what a run may take beside them, where adapter and host have one memory.
const SHARED: f64 = 1.0 / 3.0;

/// Buffer that kernels read and write.
const STORAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::INDIRECT)
    .union(wgpu::BufferUsages::COPY_SRC)
    .union(wgpu::BufferUsages::COPY_DST);

/// A failure of the GPU, in words.
pub fn failure(message: impl Into<String>) -> Error {
    Error::Gpu(message.into())
}

/// Options for opening a device.
#[derive(Debug, Clone, Default)]
pub struct GpuOptions {
    /// Adapter by its number in [`adapters`](super::adapter::adapters) or a part of its name; without it the best one.
    pub adapter: Option<String>,
    /// Bytes that buffers may take; without it what `within` leaves.
    pub memory: Option<u64>,
    /// Bytes that a run may take, buffers too where the adapter has no memory of its own; without it buffers may take 60 % of what is free.
    pub within: Option<u64>,
    /// Time every kernel.
    pub timed: bool,
    /// Fill buffers with NaN where kernels are to write before they read. For tests.
    pub poison: bool,
}

/// A device with everything the backend asks of it.
pub struct Device {
    /// Summary of the adapter.
    pub summary: AdapterSummary,
    /// Its limits, as granted.
    pub limits: wgpu::Limits,
    /// Whether kernels can be timed.
    pub can_time: bool,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    faults: Arc<Mutex<Vec<String>>>,
    budget: u64,
    host_bytes: u64,
    used: Arc<AtomicU64>,
    /// Bytes sent and read back.
    traffic: [AtomicU64; 2],
    poison: bool,
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Device").field("summary", &self.summary).field("budget", &self.budget).finish_non_exhaustive()
    }
}

/// A buffer that holds a `T`: `[f32]` for an array, a struct for one value or for the head of a list. Gives its bytes back to the budget when
/// dropped.
#[derive(Debug)]
pub struct Buffer<T: ?Sized> {
    pub(super) raw: wgpu::Buffer,
    used: Arc<AtomicU64>,
    holds: PhantomData<T>,
}

impl<T: ?Sized> Drop for Buffer<T> {
    fn drop(&mut self) {
        self.used.fetch_sub(self.raw.size(), Ordering::Relaxed);
    }
}

impl Device {
    /// Opens an adapter.
    ///
    /// # Errors
    /// [`Error::Gpu`] if there is no such adapter, if it lacks something, or if the driver refuses.
    pub fn open(options: &GpuOptions) -> Result<Self> {
        let mut found = enumerate();
        if found.is_empty() {
            return Err(failure(
                "no adapter found: there is no Vulkan, Metal or DirectX 12 driver (on Debian: mesa-vulkan-drivers, libvulkan1)",
            ));
        }
        let at = match &options.adapter {
            None => found.iter().position(|(_, s)| s.lacks.is_none()).unwrap_or(0),
            Some(wish) => {
                let wanted = wish.to_lowercase();
                let by_index = wish.parse::<usize>().ok().filter(|&k| k < found.len());
                by_index
                    .or_else(|| found.iter().position(|(_, s)| s.name.to_lowercase().contains(&wanted)))
                    .ok_or_else(|| {
                        let names: Vec<_> = found.iter().map(|(_, s)| format!("{} ({})", s.index, s.name)).collect();
                        failure(format!("no adapter matches `{wish}`; there are {}", names.join(", ")))
                    })?
            }
        };
        let (adapter, summary) = found.swap_remove(at);
        if let Some(lacks) = &summary.lacks {
            return Err(failure(format!("{}: limits too small: {lacks}", summary.name)));
        }
        let limits = wgpu::Limits {
            max_buffer_size: adapter.limits().max_buffer_size,
            max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size,
            ..wgpu::Limits::default().or_worse_values_from(&adapter.limits())
        };
        let can_time = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("interslice"),
            required_features: if can_time { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() },
            required_limits: limits.clone(),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| failure(format!("{}: no device: {e}", summary.name)))?;
        let faults = Arc::new(Mutex::new(Vec::new()));
        let lost = faults.clone();
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed || !message.contains("dropped") {
                note(&lost, format!("the device is lost ({reason:?}): {message}"));
            }
        });
        let uncaptured = faults.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| note(&uncaptured, e.to_string())));
        let shared = summary.shares_memory();
        let within = options.within.map(|bytes| match shared {
            true => (bytes.saturating_sub(DRIVER_BYTES) as f64 * SHARED) as u64,
            false => bytes,
        });
        let bound = options.memory.or(within);
        let budget = bound.unwrap_or_else(free_memory);
        Ok(Device {
            host_bytes: DRIVER_BYTES + bound.filter(|_| shared).unwrap_or(0),
            summary,
            limits,
            can_time,
            device,
            queue,
            faults,
            budget,
            used: Arc::default(),
            traffic: Default::default(),
            poison: options.poison,
        })
    }

    /// Bytes that a batch may use.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// Bytes of the host's memory that the driver takes, and the buffers where they are there and bounded.
    pub fn host_bytes(&self) -> u64 {
        self.host_bytes
    }

    /// Largest array in one binding, bytes.
    pub fn largest_binding(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Fails if the device is lost or has complained.
    ///
    /// # Errors
    /// [`Error::Gpu`] with what it said.
    pub fn check(&self) -> Result<()> {
        let faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        match faults.first() {
            Some(message) => Err(failure(format!("{}: {message}", self.summary.name))),
            None => Ok(()),
        }
    }

    /// A buffer of `bytes`, within the limits and the budget.
    ///
    /// # Errors
    /// [`Error::Gpu`] that names the buffer, its size and the limit.
    pub fn buffer<T: ?Sized>(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Buffer<T>> {
        self.check()?;
        let size = bytes.next_multiple_of(4).max(16);
        let staging = usage.contains(wgpu::BufferUsages::MAP_READ);
        let limit = if staging { self.limits.max_buffer_size } else { self.largest_binding() };
        if size > limit {
            return Err(failure(format!("buffer `{label}` needs {size} bytes, {} allows {limit}", self.summary.name)));
        }
        let used = self.used.fetch_add(size, Ordering::Relaxed) + size;
        if used > self.budget {
            self.used.fetch_sub(size, Ordering::Relaxed);
            return Err(failure(format!(
                "out of memory: buffer `{label}` of {size} bytes exceeds the budget of {} bytes (--gpu-memory, --memory)",
                self.budget
            )));
        }
        let out_of_memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let invalid = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let raw = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        });
        let buffer = Buffer { raw, used: self.used.clone(), holds: PhantomData };
        let error = pollster::block_on(invalid.pop()).or(pollster::block_on(out_of_memory.pop()));
        match error {
            Some(e) => Err(failure(format!("buffer `{label}` of {size} bytes: {e}"))),
            None => Ok(buffer),
        }
    }

    /// A storage buffer of `count` values that some kernel writes before any reads them; NaN until then if [`GpuOptions::poison`] says so.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn storage<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer<[T]>> {
        let buffer = self.zeroed(label, count)?;
        if self.poison {
            self.queue.write_buffer(&buffer.raw, 0, &vec![0xff; buffer.raw.size() as usize]);
        }
        Ok(buffer)
    }

    /// A storage buffer of `count` zeroed values.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn zeroed<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer<[T]>> {
        // A binding must hold one.
        self.buffer(label, (count.max(1) * size_of::<T>()) as u64, STORAGE)
    }

    /// A storage buffer with a head and a list of `count` items behind it, zeroed.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn headed<H: Headed>(&self, label: &str, count: usize) -> Result<Buffer<H>> {
        self.buffer(label, (size_of::<H>() + count * size_of::<H::Item>()) as u64, STORAGE)
    }

    /// A storage buffer with these values.
    ///
    /// # Errors
    /// The errors of [`Device::buffer`].
    pub fn upload<T: Pod>(&self, label: &str, values: &[T]) -> Result<Buffer<[T]>> {
        let buffer = self.zeroed(label, values.len())?;
        self.write(&buffer, values);
        Ok(buffer)
    }

    /// Gives the first values of a buffer new ones.
    pub fn write<T: Pod>(&self, buffer: &Buffer<[T]>, values: &[T]) {
        self.traffic[0].fetch_add(size_of_val(values) as u64, Ordering::Relaxed);
        self.queue.write_buffer(&buffer.raw, 0, bytemuck::cast_slice(values));
    }

    /// Gives the values of a buffer from the value `first` on new ones.
    pub fn write_at<T: Pod>(&self, buffer: &Buffer<[T]>, first: usize, values: &[T]) {
        self.traffic[0].fetch_add(size_of_val(values) as u64, Ordering::Relaxed);
        self.queue.write_buffer(&buffer.raw, (first * size_of::<T>()) as u64, bytemuck::cast_slice(values));
    }

    /// Bytes sent and read back so far.
    pub fn traffic(&self) -> [u64; 2] {
        self.traffic.each_ref().map(|bytes| bytes.load(Ordering::Relaxed))
    }

    /// A uniform buffer with one value.
    pub fn uniform<T: Pod>(&self, label: &str, value: T) -> Buffer<T> {
        let raw = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size_of::<T>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        // Written by the queue: to map a buffer of a device that is lost would panic.
        self.queue.write_buffer(&raw, 0, bytemuck::bytes_of(&value));
        self.used.fetch_add(raw.size(), Ordering::Relaxed);
        Buffer { raw, used: self.used.clone(), holds: PhantomData }
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device is lost, has complained, or hangs.
    pub fn wait(&self) -> Result<()> {
        let poll = self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) });
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

    /// Copies the first number of a head back.
    ///
    /// # Errors
    /// The errors of [`Device::read`].
    pub fn read_first<H: Headed>(&self, buffer: &Buffer<H>) -> Result<u32> {
        let first: Vec<u32> = self.read_as(buffer, 0, 1)?;
        Ok(first[0])
    }

    fn read_as<T: Pod>(&self, buffer: &Buffer<impl ?Sized>, first: usize, count: usize) -> Result<Vec<T>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let size = size_of::<T>() as u64;
        let bytes = count as u64 * size;
        self.traffic[1].fetch_add(bytes, Ordering::Relaxed);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging: Buffer<[T]> = self.buffer("staging", bytes, usage)?;
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read") });
        encoder.copy_buffer_to_buffer(&buffer.raw, first as u64 * size, &staging.raw, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let answer = Arc::new(Mutex::new(None));
        let slot = answer.clone();
        staging.raw.slice(..bytes).map_async(wgpu::MapMode::Read, move |r| {
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(r);
        });
        self.wait()?;
        let answer = answer.lock().unwrap_or_else(PoisonError::into_inner).take();
        match answer {
            Some(Ok(())) => {
                let view = staging
                    .raw
                    .slice(..bytes)
                    .get_mapped_range()
                    .map_err(|e| failure(format!("{}: reading back failed: {e}", self.summary.name)))?;
                Ok(bytemuck::pod_collect_to_vec(&view))
            }
            Some(Err(e)) => Err(failure(format!("{}: reading back failed: {e}", self.summary.name))),
            None => Err(failure(format!("{}: reading back gave no answer", self.summary.name))),
        }
    }

    /// Loses the device on purpose: everything after fails. For tests.
    pub fn destroy(&self) {
        // Noted first: whoever fails because of it finds out why.
        note(&self.faults, "the device was destroyed".into());
        self.device.destroy();
    }
}

fn note(faults: &Mutex<Vec<String>>, message: String) {
    faults.lock().unwrap_or_else(PoisonError::into_inner).push(message);
}

fn free_memory() -> u64 {
    let Ok(mut system) = System::new() else { return UNKNOWN_BUDGET };
    system.refresh_memory();
    match system.available_memory() {
        0 => UNKNOWN_BUDGET,
        free => (free as f64 * SHARE) as u64,
    }
}
