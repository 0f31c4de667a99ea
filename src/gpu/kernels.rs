//! All kernels: each shader's interface by the names of its variables, compiled once per device.
//!
//! A shader is declared with `shader!` in the host file of its stem: its entry points, and for each the variables that it uses with their
//! access and type. Every entry point becomes a struct with one buffer per variable, so that a name too many, too few or misspelt, or a buffer
//! that holds something else, does not compile. Which binding a name has is read from the shader by naga when it is compiled. That the
//! declarations and the shaders say the same is shown by `tests/gpu/shaders.rs`, which needs no adapter.

use std::collections::BTreeMap;
use std::sync::Arc;

use wgpu::naga;

use super::device::{Device, failure};
use super::layout::{Shared, StructLayout};
use super::pool::Raw;
use crate::error::Result;

/// Invocations of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Width of the one workgroup that scans.
pub const SCAN_WIDTH: u32 = 256;
/// Values that the host sets for a shader's `override`s on a device whose dispatches have at most `grid` workgroups along an axis.
pub fn overrides(grid: u32) -> [(&'static str, f64); 3] {
    [("lane_count", f64::from(WORKGROUP)), ("scan_width", f64::from(SCAN_WIDTH)), ("grid", f64::from(grid))]
}

/// Access of a shader to a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// `var<uniform>`.
    Uniform,
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    Write,
}

/// A variable of an entry point.
#[derive(Debug, Clone)]
pub struct Binding {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Access of the shader to it.
    pub access: Access,
    /// Its type in WGSL.
    pub spelling: String,
    /// Structs in it.
    pub structs: Vec<StructLayout>,
}

impl Binding {
    /// A variable of which the host's buffer holds a `T`.
    pub fn of<T: Shared + ?Sized>(name: &'static str, access: Access) -> Self {
        Binding { name, access, spelling: T::spelling(), structs: T::structs() }
    }
}

/// An entry point as the host declares it.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its name in WGSL.
    pub name: &'static str,
    /// Its name in profiles.
    pub label: &'static str,
    /// Variables that it uses, in the order of the bindings.
    pub bindings: Vec<Binding>,
}

/// A shader as the host declares it.
#[derive(Debug, Clone)]
pub struct Interface {
    /// Its stem.
    pub stem: &'static str,
    /// Source file of its f64 twin; none for what only the GPU does.
    pub twin: Option<&'static str>,
    /// Its whole text.
    pub text: &'static str,
    /// Its entry points.
    pub entries: Vec<Entry>,
}

/// Declares a shader. See [`crate::gpu::kernels`].
///
/// ```text
/// shader! {
///     exact = "common/job.wgsl" + "common/stencil.wgsl", twin "src/reference/exact.rs";
///
///     /// What the entry point `columns` uses, `exact_columns` in profiles.
///     Columns for columns, "exact_columns" {
///         side: Uniform Side,
///         jobs: Read [Job],
///         steps: Write [f32],
///     }
/// }
/// ```
macro_rules! shader {
    (
        $stem:ident = $($common:literal +)* $(twin $twin:literal)?;
        $($(#[$doc:meta])* $buffers:ident for $entry:ident, $label:literal {
            $($name:ident: $access:ident $kind:ty,)*
        })+
    ) => {
        /// The shader's kernels.
        #[derive(Debug)]
        pub struct Shader {
            $($entry: $crate::gpu::kernels::Kernel,)+
        }

        impl Shader {
            /// The shader as declared here.
            pub fn interface() -> $crate::gpu::kernels::Interface {
                use $crate::gpu::kernels::{Access, Binding, Entry, Interface};
                Interface {
                    stem: stringify!($stem),
                    twin: None$(.or(Some($twin)))?,
                    text: concat!(
                        $(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $common)), "\n",)*
                        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", stringify!($stem), ".wgsl")),
                        "\n"
                    ),
                    entries: vec![$(Entry {
                        name: stringify!($entry),
                        label: $label,
                        bindings: vec![$(Binding::of::<$kind>(stringify!($name), Access::$access),)*],
                    },)+],
                }
            }

            /// Compiles every kernel.
            ///
            /// # Errors
            /// [`crate::Error::Gpu`] with the shader's name and the compiler's words.
            pub fn new(device: &$crate::gpu::device::Device) -> $crate::error::Result<Self> {
                let module = $crate::gpu::kernels::Module::new(device, &Shader::interface())?;
                Ok(Shader { $($entry: module.kernel(device, stringify!($entry))?,)+ })
            }
        }

        $(
            $(#[$doc])*
            #[derive(Debug)]
            #[allow(missing_docs)]
            pub struct $buffers<'b> {
                $(pub $name: &'b $crate::gpu::buffer::Buffer<$kind>,)*
            }

            impl $buffers<'_> {
                /// The kernel with these buffers.
                pub fn bind<'g>(&self, gpu: &'g $crate::gpu::Gpu) -> $crate::gpu::kernels::Bound<'g> {
                    gpu.kernels.$stem.$entry.bind(&gpu.device, &[$(&self.$name.raw,)*])
                }
            }
        )+
    };
}
pub(super) use shader;

macro_rules! kernels {
    ($($stem:ident)*) => {
        /// Every kernel of a device.
        #[derive(Debug)]
        pub struct Kernels {
            $(pub(super) $stem: super::$stem::Shader,)*
        }

        impl Kernels {
            /// Compiles everything.
            ///
            /// # Errors
            /// [`crate::Error::Gpu`] with the shader's name and the compiler's words.
            pub fn new(device: &Device) -> Result<Self> {
                Ok(Kernels { $($stem: super::$stem::Shader::new(device)?,)* })
            }
        }

        /// Every shader as the host declares it.
        pub fn interfaces() -> Vec<Interface> {
            vec![$(super::$stem::Shader::interface(),)*]
        }
    };
}

// Every shader, by the stem that its files share.
kernels!(
    band hj_step reinit extend trace particles propagate scatter compose distance exact contour_field displacement
    trajectories moving_slopes moving_layer morph_layer part blocks rescale doctor
);

/// A compiled shader and where its variables are bound.
pub struct Module {
    interface: Interface,
    compiled: wgpu::ShaderModule,
    places: BTreeMap<String, u32>,
    overrides: Vec<(&'static str, f64)>,
}

impl Module {
    /// Compiles a shader.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] with the shader's name and the compiler's words.
    pub fn new(device: &Device, interface: &Interface) -> Result<Self> {
        let Interface { stem, text, .. } = interface;
        let parsed = naga::front::wgsl::parse_str(text)
            .map_err(|e| failure(format!("shader `{stem}`: {}", e.emit_to_string_with_path(text, stem))))?;
        let place = |(_, v): (_, &naga::GlobalVariable)| Some((v.name.clone()?, v.binding.as_ref()?.binding));
        let places = parsed.global_variables.iter().filter_map(place).collect();
        let declared = |name: &str| parsed.overrides.iter().any(|(_, o)| o.name.as_deref() == Some(name));
        let overrides = overrides(device.grid()).into_iter().filter(|(name, _)| declared(name)).collect();
        let scope = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let compiled = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(stem),
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(parsed)),
        });
        match pollster::block_on(scope.pop()) {
            Some(e) => Err(failure(format!("shader `{stem}`: {e}"))),
            None => Ok(Module { interface: interface.clone(), compiled, places, overrides }),
        }
    }

    /// An entry point ready to run.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] with the kernel's name if the shader has no such entry point or lacks a variable, or with the compiler's words.
    pub fn kernel(&self, device: &Device, name: &str) -> Result<Kernel> {
        let stem = self.interface.stem;
        let lacks = |what: &str| failure(format!("shader `{stem}` has no `{what}`"));
        let entry = self.interface.entries.iter().find(|e| e.name == name).ok_or_else(|| lacks(name))?;
        let place = |b: &Binding| self.places.get(b.name).copied().ok_or_else(|| lacks(b.name));
        let places = entry.bindings.iter().map(place).collect::<Result<_>>()?;
        let scope = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let pipeline = device.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry.label),
            layout: None,
            module: &self.compiled,
            entry_point: Some(name),
            // Kernels write a workgroup's memory before they read it.
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &self.overrides,
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        });
        match pollster::block_on(scope.pop()) {
            Some(e) => Err(failure(format!("kernel `{}`: {e}", entry.label))),
            None => Ok(Kernel { label: entry.label, pipeline, places }),
        }
    }
}

/// A compiled entry point and where each of its buffers is bound.
#[derive(Debug)]
pub struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    places: Vec<u32>,
}

impl Kernel {
    /// Binds buffers, given in the order in which the kernel declares them.
    pub fn bind(&self, device: &Device, buffers: &[&Raw]) -> Bound<'_> {
        let entries: Vec<_> = self
            .places
            .iter()
            .zip(buffers)
            .map(|(&binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.binding() })
            .collect();
        let group = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Bound { kernel: self, group, buffers: buffers.iter().map(|buffer| (*buffer).clone()).collect() }
    }
}

/// A kernel with its buffers.
#[derive(Debug)]
pub struct Bound<'k> {
    kernel: &'k Kernel,
    group: wgpu::BindGroup,
    buffers: Arc<[Raw]>,
}

impl Bound<'_> {
    /// Its name in profiles.
    pub(super) fn label(&self) -> &'static str {
        self.kernel.label
    }

    /// Its buffers.
    pub(super) fn buffers(&self) -> Arc<[Raw]> {
        self.buffers.clone()
    }

    /// Makes it the next dispatch of a pass.
    pub(super) fn set(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.kernel.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
    }
}
