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
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    if std::env::var_os("WGPU_BACKEND").is_none() {
        descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    }
    // It costs 12 to 70 us per indirect dispatch; the arguments are written by our own kernels and bounded there.
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
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

/// Adapters with what people see of them, best first.
pub(super) fn enumerate() -> Vec<(wgpu::Adapter, AdapterSummary)> {
    let mut adapters = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::all()));
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
                largest_binding: limits.max_storage_buffer_binding_size,
                largest_buffer: limits.max_buffer_size,
                lacks: (!lacks.is_empty()).then(|| lacks.join("; ")),
            };
            (adapter, summary)
        })
        .collect()
}

/// Limits that compute kernels depend on; a device for graphics may fall short in others.
fn compute_limit(name: &str) -> bool {
    ["compute", "storage", "uniform", "bind", "buffer"].iter().any(|part| name.contains(part))
        && !name.contains("texture")
}

/// All adapters, best first.
pub fn adapters() -> Vec<AdapterSummary> {
    enumerate().into_iter().map(|(_, summary)| summary).collect()
}
