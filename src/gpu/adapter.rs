//! The adapters of this machine, best first, and what they lack.

/// An adapter as people see it.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct AdapterSummary {
    /// Position in the list.
    pub index: usize,
    /// Name of the GPU.
    pub name: String,
    /// Vulkan, Metal or Dx12.
    pub api: String,
    /// Discrete, integrated, virtual, CPU or other.
    pub kind: String,
    /// Driver and its version.
    pub driver: String,
    /// Bytes of its own memory, where the driver says.
    pub memory: Option<u64>,
    /// Largest storage binding, bytes.
    pub largest_binding: u64,
    /// Largest buffer, bytes.
    pub largest_buffer: u64,
    /// Capability that is missing, if any.
    pub lacks: Option<String>,
}

impl AdapterSummary {
    /// Whether this is a program that computes on the CPU.
    pub fn is_software(&self) -> bool {
        self.kind == "CPU"
    }

    /// Whether its memory is the host's.
    pub fn shares_memory(&self) -> bool {
        self.is_software() || self.kind == "integrated"
    }

    /// Whether it is known to have memory of its own, which is faster than the host's.
    pub fn is_discrete(&self) -> bool {
        self.kind == "discrete"
    }
}

/// `checked`: with what bounds indirect dispatches.
fn instance(checked: bool) -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    if std::env::var_os("WGPU_BACKEND").is_none() {
        descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    }
    // It costs 12 to 70 us per indirect dispatch; the arguments are written by our own kernels and bounded there.
    descriptor.flags.set(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL, checked);
    wgpu::Instance::new(descriptor)
}

/// Best first: discrete, integrated, virtual, other, CPU.
fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// Adapters with what people see of them, best first. `checked`: the driver never gets an indirect dispatch beyond the limits; it is left out.
pub(super) fn enumerate(checked: bool) -> Vec<(wgpu::Adapter, AdapterSummary)> {
    let mut adapters = pollster::block_on(instance(checked).enumerate_adapters(wgpu::Backends::all()));
    adapters.sort_by_key(|a| rank(a.get_info().device_type));
    adapters
        .into_iter()
        .enumerate()
        .map(|(index, adapter)| {
            let (info, limits) = (adapter.get_info(), adapter.limits());
            let kind = match info.device_type {
                wgpu::DeviceType::DiscreteGpu => "discrete",
                wgpu::DeviceType::IntegratedGpu => "integrated",
                wgpu::DeviceType::VirtualGpu => "virtual",
                wgpu::DeviceType::Cpu => "CPU",
                wgpu::DeviceType::Other => "other",
            };
            let mut lacks = Vec::new();
            wgpu::Limits::default().check_limits_with_fail_fn(&limits, false, |name, wanted, allowed| {
                if compute_limit(name) {
                    lacks.push(format!("{name} is {allowed}, {wanted} is needed"));
                }
            });
            let summary = AdapterSummary {
                index,
                name: info.name,
                api: info.backend.to_string(),
                kind: kind.into(),
                driver: format!("{} {}", info.driver, info.driver_info).trim().into(),
                memory: own_memory(&adapter),
                largest_binding: limits.max_storage_buffer_binding_size,
                largest_buffer: limits.max_buffer_size,
                lacks: (!lacks.is_empty()).then(|| lacks.join("; ")),
            };
            (adapter, summary)
        })
        .collect()
}

/// Bytes of the largest heap that is a Vulkan device's own. wgpu asks no other API.
#[cfg(not(any(target_vendor = "apple", target_family = "wasm")))]
fn own_memory(adapter: &wgpu::Adapter) -> Option<u64> {
    /// `VK_MEMORY_HEAP_DEVICE_LOCAL_BIT`.
    const DEVICE_LOCAL: u32 = 1;
    // SAFETY: the adapter is only asked; nothing of it is kept or destroyed.
    let own = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
    // SAFETY: the physical device belongs to this instance, and both live as long as the adapter, which is borrowed.
    let memory = unsafe {
        own.shared_instance().raw_instance().get_physical_device_memory_properties(own.raw_physical_device())
    };
    let heaps = memory.memory_heaps.iter().take(memory.memory_heap_count as usize);
    heaps.filter(|heap| heap.flags.as_raw() & DEVICE_LOCAL != 0).map(|heap| heap.size).max()
}

#[cfg(any(target_vendor = "apple", target_family = "wasm"))]
fn own_memory(_adapter: &wgpu::Adapter) -> Option<u64> {
    None
}

/// Limits that compute kernels depend on; a device for graphics may fall short in others.
fn compute_limit(name: &str) -> bool {
    ["compute", "storage", "uniform", "bind", "buffer"].iter().any(|part| name.contains(part))
        && !name.contains("texture")
}

/// All adapters, best first.
pub fn adapters() -> Vec<AdapterSummary> {
    enumerate(false).into_iter().map(|(_, summary)| summary).collect()
}
