//! The device: choosing an adapter, limits, the byte budget, and what goes wrong.

use std::sync::{Arc, Mutex, PoisonError};

use super::adapter::{AdapterSummary, enumerate};
use super::layout::GRID;
use super::pool::Pool;
use super::upload::{self, Uploads};
use super::work;
use crate::error::{Error, Result};
use crate::report::DeviceUse;
use crate::storage::room::available;

/// Share of the host's free memory that an adapter without memory of its own may use.
const SHARE: f64 = 0.6;
/// Share of its own memory that an adapter may use; the rest is for the screen and other programs.
const OWN_SHARE: f64 = 0.8;
/// Budget where nothing is known about memory: any GPU with memory of its own has this much.
const UNKNOWN_BUDGET: u64 = 2 << 30;
/// Bytes of the host's memory that a driver and the compiled kernels take: 119 MiB measured on lavapipe 25.0.7.
pub const DRIVER_BYTES: u64 = 120 << 20;
/// Bytes of it that answers take which are asked for by a guess: without, the run of `tests/memory.rs` took 243 MiB of 240 allowed.
const GUESSED_BYTES: u64 = 8 << 20;
/// Share for the buffers of what a run may take beside them, where adapter and host have one memory.
const SHARED: f64 = 1.0 / 3.0;
/// Buffers in blocks of the host's memory that soon are free again: in blocks of 128 MiB the holes between buffers stayed, and a run that was
/// to take 300 MiB took 315.
const SMALL_BLOCKS: wgpu::MemoryHints =
    wgpu::MemoryHints::Manual { suballocated_device_memory_block_size: (1 << 20)..(8 << 20) };

/// Bytes for the buffers of kernels where so many are allowed: the host's chunks are beside them.
fn left(room: u64) -> u64 {
    room - upload::share(room)
}

/// A failure of the GPU, in words.
pub fn failure(message: impl Into<String>) -> Error {
    Error::Gpu(message.into())
}

/// Options that tests make an adapter smaller with than it is. No result depends on them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Made {
    /// Most workgroups along an axis of a dispatch.
    pub groups: Option<u32>,
    /// Bytes of buffers beyond which there is no memory, which batches are not planned with.
    pub grants: Option<u64>,
    /// Values that a dispatch may read and write.
    pub work: Option<u64>,
    /// What is guessed before the host knows it: rounds of distances, squares of a layer.
    pub guess: Option<usize>,
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
    /// A smaller adapter. For tests.
    pub made: Made,
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
    /// Bytes of all buffers, the host's chunks among them.
    pub(super) room: u64,
    host_bytes: u64,
    pool: Arc<Pool>,
    pub(super) uploads: Mutex<Uploads>,
    /// What was asked of the device.
    pub(super) counts: Mutex<DeviceUse>,
    pub(super) poison: bool,
    pub(super) made: Made,
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Device").field("summary", &self.summary).field("room", &self.room).finish_non_exhaustive()
    }
}

impl Device {
    /// Opens an adapter.
    ///
    /// # Errors
    /// [`Error::Setting`] if there is no such adapter; [`Error::Gpu`] if there is none, if it lacks something, or if the driver refuses.
    pub fn open(options: &GpuOptions) -> Result<Self> {
        let mut found = enumerate(options.made.groups.is_some());
        if found.is_empty() {
            return Err(failure(
                "no adapter found: there is no Vulkan, Metal or DirectX 12 driver (on Debian: mesa-vulkan-drivers, libvulkan1)",
            ));
        }
        let at = match &options.adapter {
            None => found.iter().position(|(_, s)| s.lacks.is_none()).unwrap_or(0),
            Some(wish) => {
                let wanted = wish.to_lowercase();
                // A number is never part of a name: one too large would choose whatever has its digits in its version.
                let at = match wish.parse::<usize>() {
                    Ok(number) => Some(number).filter(|&k| k < found.len()),
                    Err(_) => found.iter().position(|(_, s)| s.name.to_lowercase().contains(&wanted)),
                };
                at.ok_or_else(|| {
                    let names: Vec<_> = found.iter().map(|(_, s)| format!("{}: {}", s.index, s.name)).collect();
                    let message = format!(
                        "must be the number of one of this machine's adapters, or part of its name ({}); got `{wish}`",
                        names.join(", ")
                    );
                    Error::Setting { name: "adapter".into(), message }
                })?
            }
        };
        let (adapter, summary) = found.swap_remove(at);
        if let Some(lacks) = &summary.lacks {
            return Err(failure(format!("{}: limits too small: {lacks}", summary.name)));
        }
        let allowed = wgpu::Limits::default().or_worse_values_from(&adapter.limits());
        let most_groups = allowed.max_compute_workgroups_per_dimension.min(options.made.groups.unwrap_or(u32::MAX));
        let limits = wgpu::Limits {
            max_buffer_size: adapter.limits().max_buffer_size,
            max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size,
            max_compute_workgroups_per_dimension: most_groups,
            ..allowed
        };
        let can_time = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("interslice"),
            required_features: if can_time { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() },
            required_limits: limits.clone(),
            memory_hints: if summary.shares_memory() { SMALL_BLOCKS } else { wgpu::MemoryHints::default() },
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
            false => bytes.min(summary.room()),
        });
        let bound = options.memory.or(within);
        let room = bound.unwrap_or_else(|| summary.room());
        Ok(Device {
            host_bytes: DRIVER_BYTES + GUESSED_BYTES + bound.filter(|_| shared).unwrap_or(0),
            summary,
            limits,
            can_time,
            device,
            queue,
            faults,
            room,
            pool: Pool::new(left(room).min(options.made.grants.unwrap_or(u64::MAX))),
            uploads: Mutex::default(),
            counts: Mutex::default(),
            poison: options.poison,
            made: options.made,
        })
    }

    /// Bytes that a batch may use.
    pub fn budget(&self) -> u64 {
        left(self.room)
    }

    /// Bytes of the host's memory that the driver takes, and the buffers where they are there and bounded.
    pub fn host_bytes(&self) -> u64 {
        self.host_bytes
    }

    /// Largest array in one binding, bytes.
    pub fn largest_binding(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Most workgroups along an axis of a dispatch.
    pub fn most_groups(&self) -> u32 {
        self.limits.max_compute_workgroups_per_dimension
    }

    /// Workgroups in a row of a dispatch over a list, and rows in a layer.
    pub fn grid(&self) -> u32 {
        GRID.min(self.most_groups())
    }

    /// Values that a dispatch may read and write.
    pub fn most_work(&self) -> u64 {
        let is_large = self.summary.is_discrete() && self.summary.memory.is_some_and(|own| own >= work::LARGE);
        self.made.work.unwrap_or(if is_large { work::MOST_OF_LARGE } else { work::MOST })
    }

    /// Lets all buffers go that nobody uses, when the work that was sent off is done.
    ///
    /// # Errors
    /// The errors of [`Device::wait`].
    pub fn release(&self) -> Result<()> {
        // Values that wait for the next work hold their buffers.
        let nothing = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("release") });
        self.submit(nothing.finish());
        self.wait()?;
        self.uploads().release();
        self.pool.clear();
        Ok(())
    }

    /// Notes a failure: everything after fails.
    pub(super) fn fail(&self, why: String) {
        note(&self.faults, why);
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

    /// The buffers that wait, and the count of all.
    pub(super) fn pool(&self) -> &Arc<Pool> {
        &self.pool
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

impl AdapterSummary {
    /// Bytes that buffers may take where nobody has said how many: a share of what is free in the host's memory, and of the adapter's own.
    fn room(&self) -> u64 {
        let own = self.memory.map(|own| (own as f64 * OWN_SHARE) as u64);
        let shared = self.shares_memory().then(available).flatten().map(|free| (free as f64 * SHARE) as u64);
        own.into_iter().chain(shared).min().unwrap_or(UNKNOWN_BUDGET)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(kind: &str, memory: Option<u64>) -> u64 {
        let [name, api, driver] = ["GPU", "Vulkan", "1.0"].map(String::from);
        let (largest_binding, largest_buffer, lacks) = (1 << 30, 1 << 30, None);
        AdapterSummary {
            index: 0,
            name,
            api,
            kind: kind.into(),
            driver,
            memory,
            largest_binding,
            largest_buffer,
            lacks,
        }
        .room()
    }

    #[test]
    fn a_budget_is_that_of_the_adapters_own_memory() {
        let host = available().expect("this machine says") as f64 * SHARE;
        let near = |got: u64, expected: f64| (got as f64 / expected - 1.0).abs() < 0.1;
        assert_eq!(room("discrete", None), UNKNOWN_BUDGET, "the host's memory says nothing of a GPU's own");
        for own in [1u64 << 30, 80 << 30] {
            assert!(near(room("discrete", Some(own)), 0.8 * own as f64));
            assert!(near(room("integrated", Some(own)), host.min(0.8 * own as f64)));
        }
        assert!(near(room("CPU", None), host));
    }
}
