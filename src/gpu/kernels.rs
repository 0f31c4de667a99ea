//! All kernels: WGSL text put together, compiled once per device, and how work is recorded.

use std::collections::BTreeMap;

use super::device::{Buffer, Device, failure};
use super::layout::GRID;
use super::profiler::{Profiler, Stamps};
use crate::error::Result;

/// Invocations of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Width of the one workgroup that gathers and scans.
const SCAN_WIDTH: u32 = 256;

macro_rules! source {
    ($($file:literal),+) => { concat!($(include_str!(concat!("../../shaders/", $file)), "\n"),+) };
}

/// Every module of WGSL: its stem and its whole text.
pub const MODULES: [(&str, &str); 17] = [
    ("band", source!("common/job.wgsl", "common/stencil.wgsl", "band.wgsl")),
    ("hj_step", source!("common/job.wgsl", "common/stencil.wgsl", "common/stage.wgsl", "hj_step.wgsl")),
    ("reinit", source!("common/job.wgsl", "common/stencil.wgsl", "common/stage.wgsl", "reinit.wgsl")),
    ("extend", source!("common/job.wgsl", "common/field.wgsl", "extend.wgsl")),
    ("trace", source!("common/job.wgsl", "common/arrival.wgsl", "trace.wgsl")),
    ("particles", source!("common/job.wgsl", "common/field.wgsl", "common/goal.wgsl", "particles.wgsl")),
    (
        "propagate",
        source!(
            "common/job.wgsl",
            "common/stencil.wgsl",
            "common/field.wgsl",
            "common/goal.wgsl",
            "common/arrival.wgsl",
            "common/course.wgsl",
            "propagate.wgsl"
        ),
    ),
    ("scatter", source!("common/job.wgsl", "common/field.wgsl", "scatter.wgsl")),
    ("compose", source!("common/job.wgsl", "compose.wgsl")),
    ("distance", source!("common/job.wgsl", "common/stencil.wgsl", "distance.wgsl")),
    ("exact", source!("common/job.wgsl", "common/stencil.wgsl", "exact.wgsl")),
    ("contour_field", source!("common/job.wgsl", "contour_field.wgsl")),
    ("displacement", source!("common/job.wgsl", "common/moving.wgsl", "displacement.wgsl")),
    ("trajectories", source!("common/job.wgsl", "common/moving.wgsl", "trajectories.wgsl")),
    (
        "moving_slopes",
        source!(
            "common/job.wgsl",
            "common/moving.wgsl",
            "common/sample.wgsl",
            "common/spline.wgsl",
            "moving_slopes.wgsl"
        ),
    ),
    (
        "moving_layer",
        source!(
            "common/job.wgsl",
            "common/moving.wgsl",
            "common/sample.wgsl",
            "common/spline.wgsl",
            "moving_layer.wgsl"
        ),
    ),
    ("doctor", source!("doctor.wgsl")),
];

/// The module of part fields shares the distance module's patches.
pub const PART: (&str, &str) = ("part", source!("common/job.wgsl", "common/stencil.wgsl", "part.wgsl"));

/// A compiled entry point and the bindings it uses, in the order in which buffers are given.
#[derive(Debug)]
pub struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    bindings: &'static [u32],
}

macro_rules! kernels {
    ($($name:ident: $module:literal . $entry:literal [$($binding:literal),*],)*) => {
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
                for (stem, text) in MODULES.iter().chain([&PART]) {
                    modules.insert(*stem, compile(device, stem, text)?);
                }
                Ok(Kernels { $($name: pipeline(device, &modules, stringify!($name), $module, $entry, &[$($binding),*])?,)* })
            }
        }
    };
}

kernels!(
    band_start: "band"."start" [0, 1, 2, 4, 5, 6, 7],
    band_tube: "band"."tube" [0, 1, 2, 3, 5, 8],
    band_gather: "band"."gather" [0, 4, 8],
    band_grow: "band"."grow" [0, 1, 2, 3, 5, 6, 7],
    band_scan: "band"."scan" [0, 2, 4],
    band_collect: "band"."collect" [0, 2, 3, 7, 9, 10],
    hj_step: "hj_step"."hj_step" [0, 1, 2, 3, 4, 5, 6, 7, 8],
    reinit: "reinit"."reinit" [0, 1, 2, 3, 4, 5, 6, 7],
    extend_find: "extend"."find" [0, 1, 2, 3, 4, 5, 6],
    extend_courses: "extend"."extend_courses" [2, 6, 7, 8],
    extend_line: "extend"."extend_line" [2, 6, 9, 10],
    extend_carry: "extend"."carry" [0, 2, 7, 8, 11],
    trace_measure: "trace"."measure" [1, 2, 3, 4, 5, 6],
    trace_control: "trace"."control" [0, 6, 7],
    particles_predict: "particles"."predict" [0, 1, 2, 3, 4],
    particles_correct: "particles"."correct" [0, 1, 2, 3, 4],
    particles_land: "particles"."land" [0, 1, 2, 3, 4],
    sweep_advance: "propagate"."advance" [0, 9, 11],
    sweep_measure: "propagate"."measure" [0, 1, 2, 3, 4, 5, 6, 7, 8],
    sweep_control: "propagate"."control" [0, 6, 9, 10, 11],
    sweep_steer: "propagate"."steer" [0, 1, 2, 3, 4, 7, 8, 12, 13],
    scatter: "scatter"."scatter" [0, 1, 2, 3, 4, 5, 6, 7, 8],
    scatter_fill: "scatter"."fill" [0, 1, 3, 7, 8, 9],
    copy_front: "compose"."copy_front" [0, 1, 2, 3, 4, 5, 6, 9, 10],
    blend: "compose"."blend" [0, 5, 6, 7, 8],
    distance_start: "distance"."start" [0, 2, 3, 4, 5, 6],
    distance_start_far: "distance"."start_far" [0, 2, 3, 4, 5, 6],
    distance_sweep: "distance"."sweep_patches" [0, 1, 2, 5, 6, 7, 8],
    distance_finish: "distance"."finish" [0, 4, 5],
    exact_columns: "exact"."columns" [1, 2, 3, 4],
    exact_rows: "exact"."rows" [0, 1, 2, 3, 4, 5, 6, 7],
    gaussian: "contour_field"."gaussian" [0, 1, 2, 3, 4, 7],
    sharpen: "contour_field"."sharpen" [0, 1, 4, 5, 6, 7],
    hold_sides: "contour_field"."hold_sides" [0, 1, 4, 6, 7],
    limit: "contour_field"."limit" [0, 1, 4, 7],
    put_conditioned: "contour_field"."put_conditioned" [0, 1, 3, 4, 5, 7],
    displacement_pairs: "displacement"."bring_together" [0, 1, 2, 3, 4],
    displacement_moments: "displacement"."sum_moments" [0, 1, 2, 3, 4, 5],
    displacement_changes: "displacement"."sum_changes" [0, 1, 4, 5],
    displacement_keep: "displacement"."keep_changes" [0, 8, 10],
    displacement_mean: "displacement"."window_mean" [0, 6, 7, 8, 9],
    displacement_weigh: "displacement"."weigh" [0, 1, 3, 8, 10, 12],
    displacement_solve: "displacement"."solve" [0, 1, 10, 11, 13],
    displacement_guess: "displacement"."add_guess" [0, 8, 12, 13],
    trajectories: "trajectories"."follow" [0, 1, 2, 3, 4],
    moving_slopes: "moving_slopes"."find_slopes" [0, 1, 2, 3, 4],
    moving_layer_far: "moving_layer"."find_far" [0, 1, 2, 3, 6],
    moving_layer: "moving_layer"."interpolate" [0, 1, 2, 3, 4, 5, 6, 7],
    doctor_count: "doctor"."count" [0, 1],
    doctor_nan: "doctor"."not_a_number" [0, 1],
    part_start: "part"."start_part" [0, 2, 3, 4, 5, 6, 7],
    part_finish: "part"."finish_part" [0, 2, 3, 4, 5, 6],
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
    bindings: &'static [u32],
) -> Result<Kernel> {
    let Some(compiled) = modules.get(module) else { return Err(failure(format!("no shader `{module}`"))) };
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
        None => Ok(Kernel { label, pipeline, bindings }),
    }
}

impl Kernel {
    /// Binds buffers, in the order of the kernel's bindings.
    pub fn bind(&self, device: &Device, buffers: &[&Buffer]) -> Bound<'_> {
        debug_assert_eq!(buffers.len(), self.bindings.len(), "{}", self.label);
        let entries: Vec<_> = self
            .bindings
            .iter()
            .zip(buffers)
            .map(|(&binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.raw.as_entire_binding() })
            .collect();
        let group = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Bound { kernel: self, group }
    }
}

/// A kernel with its buffers.
#[derive(Debug)]
pub struct Bound<'k> {
    kernel: &'k Kernel,
    group: wgpu::BindGroup,
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
        Recorder { device, profiler, encoder, pass: None, queries, runs: Vec::new() }
    }

    /// Records one dispatch.
    pub fn run(&mut self, bound: &Bound<'_>, size: Size<'_>) {
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
        pass.set_bind_group(0, &bound.group, &[]);
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
    /// [`crate::Error::Gpu`] when the device has failed.
    pub fn submit(mut self) -> Result<()> {
        self.pass = None;
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
