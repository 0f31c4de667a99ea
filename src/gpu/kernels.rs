//! All kernels, compiled once per device, and how work is recorded.

use std::collections::BTreeMap;

use super::device::{Buffer, Device, failure};
use super::layout::GRID;
use super::profiler::{Profiler, Stamps};
use super::shaders::MODULES;
use super::variables::{Variable, variables};
use crate::error::Result;

/// Invocations of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Width of the one workgroup that gathers and scans.
pub const SCAN_WIDTH: u32 = 256;

/// A compiled entry point and the variables of the shader that it uses.
#[derive(Debug)]
pub struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    variables: &'static [Variable],
}

macro_rules! kernels {
    ($($name:ident: $module:literal . $entry:literal,)*) => {
        /// Every kernel of a device.
        #[derive(Debug)]
        pub struct Kernels { $(#[allow(missing_docs)] pub $name: Kernel,)* }

        impl Kernels {
            /// Compiles everything.
            ///
            /// # Errors
            /// [`crate::Error::Gpu`] with the shader's name and the compiler's words.
            pub fn new(device: &Device) -> Result<Self> {
                let mut modules = BTreeMap::new();
                for (stem, text) in MODULES {
                    modules.insert(stem, compile(device, stem, text)?);
                }
                Ok(Kernels { $($name: pipeline(device, &modules, stringify!($name), $module, $entry)?,)* })
            }
        }
    };
}

kernels!(
    band_start: "band"."start",
    band_tube: "band"."tube",
    band_gather: "band"."gather",
    band_grow: "band"."grow",
    band_scan: "band"."scan",
    band_collect: "band"."collect",
    hj_step: "hj_step"."hj_step",
    reinit: "reinit"."reinit",
    extend_find: "extend"."find",
    extend_courses: "extend"."extend_courses",
    extend_line: "extend"."extend_line",
    extend_carry: "extend"."carry",
    trace_measure: "trace"."measure",
    trace_control: "trace"."control",
    particles_predict: "particles"."predict",
    particles_correct: "particles"."correct",
    particles_land: "particles"."land",
    sweep_advance: "propagate"."advance",
    sweep_measure: "propagate"."measure",
    sweep_control: "propagate"."control",
    sweep_steer: "propagate"."steer",
    scatter: "scatter"."scatter",
    scatter_fill: "scatter"."fill",
    copy_front: "compose"."copy_front",
    blend: "compose"."blend",
    distance_start: "distance"."start",
    distance_start_far: "distance"."start_far",
    distance_sweep: "distance"."sweep_patches",
    distance_finish: "distance"."finish",
    exact_columns: "exact"."columns",
    exact_rows: "exact"."rows",
    gaussian: "contour_field"."gaussian",
    sharpen: "contour_field"."sharpen",
    hold_sides: "contour_field"."hold_sides",
    limit: "contour_field"."limit",
    put_conditioned: "contour_field"."put_conditioned",
    displacement_pairs: "displacement"."bring_together",
    displacement_moments: "displacement"."sum_moments",
    displacement_changes: "displacement"."sum_changes",
    displacement_keep: "displacement"."keep_changes",
    displacement_mean: "displacement"."window_mean",
    displacement_weigh: "displacement"."weigh",
    displacement_solve: "displacement"."solve",
    displacement_guess: "displacement"."add_guess",
    trajectories: "trajectories"."follow",
    moving_slopes: "moving_slopes"."find_slopes",
    moving_layer_far: "moving_layer"."find_far",
    moving_layer: "moving_layer"."interpolate",
    doctor_count: "doctor"."count",
    doctor_nan: "doctor"."not_a_number",
    part_start: "part"."start_part",
    part_finish: "part"."finish_part",
);

fn compile(device: &Device, stem: &str, text: &'static str) -> Result<wgpu::ShaderModule> {
    let scope = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let module = device.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(stem),
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    match pollster::block_on(scope.pop()) {
        Some(e) => Err(failure(format!("shader `{stem}`: {e}"))),
        None => Ok(module),
    }
}

fn pipeline(
    device: &Device,
    modules: &BTreeMap<&str, wgpu::ShaderModule>,
    label: &'static str,
    module: &str,
    entry: &str,
) -> Result<Kernel> {
    let Some(compiled) = modules.get(module) else { return Err(failure(format!("no shader `{module}`"))) };
    let variables = variables(module, entry).map_err(failure)?;
    let scan = [("scan_width", f64::from(SCAN_WIDTH))];
    let lists = [("lane_count", f64::from(WORKGROUP))];
    let scope = device.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let pipeline = device.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: None,
        module: compiled,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: match entry {
                "gather" | "scan" => &scan,
                "count" | "not_a_number" => &[],
                _ => &lists,
            },
            ..Default::default()
        },
        cache: None,
    });
    match pollster::block_on(scope.pop()) {
        Some(e) => Err(failure(format!("kernel `{label}`: {e}"))),
        None => Ok(Kernel { label, pipeline, variables }),
    }
}

impl Kernel {
    /// Binds buffers by the names that they have in the shader: all that the kernel uses, and no other. A buffer of another type than the
    /// shader's is refused, when the work is submitted.
    pub fn bind(&self, device: &Device, buffers: &[(&str, &Buffer)]) -> Bound<'_> {
        let entry = |variable: &Variable| {
            let of_name = |(name, _): &&(&str, &Buffer)| *name == variable.name;
            let (_, buffer) =
                buffers.iter().find(of_name).ok_or_else(|| format!("nothing is bound to `{}`", variable.name))?;
            if buffer.element != variable.element {
                let Variable { name, element, .. } = variable;
                return Err(format!("`{name}` is of {element}, the buffer of {}", buffer.element));
            }
            Ok(wgpu::BindGroupEntry { binding: variable.binding, resource: buffer.raw.as_entire_binding() })
        };
        let unused = buffers.iter().find(|(name, _)| self.variables.iter().all(|v| v.name != *name));
        let entries = match unused {
            Some((name, _)) => Err(format!("it has no `{name}`")),
            None => self.variables.iter().map(entry).collect::<std::result::Result<Vec<_>, String>>(),
        };
        let layout = &self.pipeline.get_bind_group_layout(0);
        let bind = |entries: Vec<_>| {
            let descriptor = wgpu::BindGroupDescriptor { label: Some(self.label), layout, entries: &entries };
            device.device.create_bind_group(&descriptor)
        };
        Bound { kernel: self, group: entries.map(bind).map_err(|wrong| format!("kernel `{}`: {wrong}", self.label)) }
    }
}

/// A kernel with its buffers, or why these are not the kernel's.
#[derive(Debug)]
pub struct Bound<'k> {
    kernel: &'k Kernel,
    group: std::result::Result<wgpu::BindGroup, String>,
}

/// How many invocations a dispatch has.
#[derive(Debug, Clone, Copy)]
pub enum Size<'b> {
    /// One per item of a list of this length.
    List(usize),
    /// This many invocations times this many rows of workgroups.
    Rows(usize, usize),
    /// One workgroup.
    One,
    /// As the three numbers at this byte of a buffer say.
    Indirect(&'b Buffer, u64),
}

/// Timestamps of one submission at most.
const MOST_QUERIES: u32 = 4096;

/// Work being recorded.
pub struct Recorder<'d> {
    device: &'d Device,
    profiler: &'d Profiler,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    queries: Option<wgpu::QuerySet>,
    /// Kernel and pixels of each dispatch.
    runs: Vec<(&'static str, usize)>,
    /// What is wrong with the first kernel that cannot run.
    wrong: Option<String>,
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
        Recorder { device, profiler, encoder, pass: None, queries, runs: Vec::new(), wrong: None }
    }

    /// Records one dispatch.
    pub fn run(&mut self, bound: &Bound<'_>, size: Size<'_>) {
        let group = match &bound.group {
            Ok(group) => group,
            Err(wrong) => {
                self.wrong.get_or_insert_with(|| wrong.clone());
                return;
            }
        };
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
        self.runs.push((bound.kernel.label, pixels));
        pass.set_pipeline(&bound.kernel.pipeline);
        pass.set_bind_group(0, group, &[]);
        let groups = |n: usize| n.div_ceil(WORKGROUP as usize) as u32;
        match size {
            Size::List(n) => {
                let wide = groups(n);
                pass.dispatch_workgroups(wide.min(GRID), wide.div_ceil(GRID), 1);
            }
            Size::Rows(n, rows) => pass.dispatch_workgroups(groups(n), rows as u32, 1),
            Size::One => pass.dispatch_workgroups(1, 1, 1),
            Size::Indirect(buffer, offset) => pass.dispatch_workgroups_indirect(&buffer.raw, offset),
        }
    }

    /// Records a copy of whole values.
    pub fn copy(&mut self, from: &Buffer, to: &Buffer, bytes: u64) {
        self.copy_part((from, 0), (to, 0), bytes);
    }

    /// Records a copy of bytes between places of two buffers.
    pub fn copy_part(&mut self, (from, first): (&Buffer, u64), (to, place): (&Buffer, u64), bytes: u64) {
        self.pass = None;
        self.encoder.copy_buffer_to_buffer(&from.raw, first, &to.raw, place, bytes);
    }

    /// Records zeros.
    pub fn clear(&mut self, buffer: &Buffer) {
        self.pass = None;
        self.encoder.clear_buffer(&buffer.raw, 0, None);
    }

    /// Sends the recording off.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`] when the device has failed, or a kernel was given buffers that are not its own.
    pub fn submit(mut self) -> Result<()> {
        self.pass = None;
        if let Some(wrong) = self.wrong.take() {
            return Err(failure(wrong));
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
        self.device.queue.submit([self.encoder.finish()]);
        self.device.check()?;
        self.profiler.submitted(self.device, &self.runs, stamps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Gpu, GpuOptions};

    /// A kernel with these buffers, recorded and submitted.
    fn tried(gpu: &Gpu, kernel: &Kernel, buffers: &[(&str, &Buffer)]) -> Result<()> {
        let mut work = Recorder::new(&gpu.device, &gpu.profiler);
        work.run(&kernel.bind(&gpu.device, buffers), Size::List(1));
        work.submit()
    }

    #[test]
    fn a_kernel_takes_its_own_buffers_and_no_others() {
        let gpu = Gpu::open(&GpuOptions::default()).expect("an adapter, tests/run installs one");
        let floats = |label| gpu.device.zeroed::<f32>(label, 4).expect("room for four numbers");
        let (u, d) = (floats("u"), floats("d"));
        let params = gpu.device.uniform("params", super::super::layout::Params::default());
        let kernel = &gpu.kernels.distance_finish;
        let refused = |buffers: &[(&str, &Buffer)], words: &str| {
            let said = tried(&gpu, kernel, buffers).expect_err(words).to_string();
            assert!(said.contains("distance_finish") && said.contains(words), "{said}");
        };
        tried(&gpu, kernel, &[("params", &params), ("u", &u), ("d", &d)]).expect("these are its own");
        tried(&gpu, kernel, &[("d", &d), ("u", &u), ("params", &params)]).expect("in any order");
        refused(&[("params", &params), ("u", &u)], "nothing is bound to `d`");
        refused(&[("params", &params), ("u", &u), ("d", &d), ("goal", &d)], "it has no `goal`");
        refused(&[("params", &params), ("u", &u), ("d", &d.viewed::<u32>())], "`d` is of f32, the buffer of u32");
        refused(&[("params", &u), ("u", &u), ("d", &d)], "`params` is of Params, the buffer of f32");
    }
}
