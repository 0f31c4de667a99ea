//! The GPU path: every numeric stage as WGSL kernels through wgpu, in single precision, batched over all jobs.
//!
//! One kernel a file, under the same stem as its twin in `reference` and its text in `shaders`. The host looks at the jobs every 16 steps;
//! within a stage nothing else comes back. Jobs are cut into batches that fit the adapter's limits and the byte budget; a job's bits do not
//! depend on the batch it is in.

pub mod adapter;
mod answers;
pub mod atlas;
pub mod band;
pub mod blocks;
pub mod buffer;
mod coalesce;
mod compose;
mod contour_field;
pub mod device;
mod displacement;
mod distance;
mod doctor;
mod exact;
mod extend;
mod fallback;
mod hj_step;
pub mod kernels;
mod layer_steps;
pub mod layout;
mod morph_batches;
mod morph_bodies;
mod morph_layer;
mod morph_slices;
mod moving;
mod moving_layer;
mod moving_slopes;
mod packed_layers;
mod part;
mod particles;
mod pool;
mod profiler;
mod propagate;
mod queue;
mod recorder;
mod reinit;
mod remeasure;
mod rescale;
mod resident;
mod scatter;
pub mod selftest;
mod trace;
mod traffic;
mod trajectories;
pub mod trust;
mod upload;
mod work;

use std::borrow::Cow;

use crate::backend::Backend;
use crate::backend::interval_morph::Morphed;
use crate::backend::jobs::{Filled, SweepPair, Traced};
use crate::backend::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use crate::error::Result;
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::{Progress, Silent};
use crate::reference::Reference;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::report::{DeviceUse, Profile};
use coalesce::{SliceJob, WaitingCalls};
use device::Device;
pub use device::GpuOptions;
pub use fallback::GpuOrReference;
use kernels::Kernels;
use profiler::Profiler;
use queue::Turns;
use resident::Resident;

/// Share of the budget that batches are planned with; the rest is for reading back and for lists that must be made longer.
const BUDGET_SHARE: f64 = 0.7;

/// The GPU backend.
#[derive(Debug)]
pub struct Gpu {
    /// The device.
    #[doc(hidden)]
    pub device: Device,
    kernels: Kernels,
    profiler: Profiler,
    /// A stage has the whole budget: stages of runs on other threads wait for their turn. No stage may be asked for from within a parallel
    /// loop, whose threads the stage itself may need.
    turns: Turns,
    waiting: WaitingCalls,
    resident: Resident,
}

impl Gpu {
    /// Opens a device and compiles all kernels.
    ///
    /// # Errors
    /// [`crate::Error::Gpu`].
    pub fn open(options: &GpuOptions) -> Result<Self> {
        let device = Device::open(options)?;
        let kernels = Kernels::new(&device)?;
        Ok(Gpu {
            device,
            kernels,
            profiler: Profiler::new(options.timed),
            turns: Turns::default(),
            waiting: WaitingCalls::default(),
            resident: Resident::default(),
        })
    }

    /// Cost of the kernels so far.
    pub fn profile(&self) -> Profile {
        let DeviceUse { submits: submissions, bytes_up, bytes_down, .. } = self.device.used();
        Profile { submissions, bytes_up, bytes_down, ..self.profiler.profile(&self.device) }
    }

    /// The share of this device that a job takes: of the byte budget, or of the largest array where that is more.
    fn share(&self, bytes: usize, largest_array: usize) -> f64 {
        let of_budget = bytes as f64 / (BUDGET_SHARE * self.device.budget() as f64);
        let of_array = largest_array as f64 / self.device.largest_binding() as f64;
        of_budget.max(of_array)
    }
}

impl Backend for Gpu {
    fn name(&self) -> String {
        let s = &self.device.summary;
        format!("GPU {} ({}, {})", s.name, s.api, s.driver)
    }

    fn host_bytes(&self) -> u64 {
        self.device.host_bytes()
    }

    fn device_use(&self) -> Option<DeviceUse> {
        Some(self.device.used())
    }

    fn run_begins(&self) {
        self.resident.begin();
    }

    fn run_ends(&self) {
        self.resident.end();
    }

    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        let &ContourRequest { slices, dims, h, options } = request;
        let jobs: Vec<SliceJob<'_>> =
            slices.iter().map(|slice| SliceJob { slice: Cow::Borrowed(slice), dims }).collect();
        self.waiting.slices.ask(&self.turns, (h, options), &jobs, progress, |jobs, progress| {
            contour_field::contour_fields(self, jobs, h, options, progress)
        })
    }

    fn part_fields(&self, &PartRequest { jobs, h }: &PartRequest<'_>) -> Result<Vec<Field>> {
        self.waiting.parts.ask(&self.turns, h, jobs, &Silent, |jobs, _| part::part_fields(self, jobs, h))
    }

    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>> {
        let &TraceRequest { jobs, h, options } = request;
        self.waiting.traces.ask(&self.turns, (h, options), jobs, progress, |jobs, progress| {
            trace::trace(self, jobs, h, &options, progress)
        })
    }

    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>> {
        let &SweepRequest { pairs, h, options } = request;
        let pairs: Vec<&SweepPair<'_>> = pairs.iter().collect();
        let _turn = self.turns.take();
        propagate::propagate(self, &pairs, h, &options, progress)
    }

    fn morph_layers(&self, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
        let &MorphRequest { intervals, h, options, at_once } = request;
        self.waiting.morphs.ask(&self.turns, (h, options), intervals, progress, |intervals, progress| {
            morph_batches::morph_layers(self, &MorphRequest { intervals, h, options, at_once }, progress)
        })
    }

    fn displacements(&self, request: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
        // Images larger than an adapter's arrays (on lavapipe 2590 px squared) are left to the reference path.
        match request.fields.first() {
            Some(image) if self.holds_images(image.dims) => {
                let _turn = self.turns.take();
                displacement::displacements(self, request)
            }
            _ => Reference.displacements(request),
        }
    }

    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        match request.moving.fields.first() {
            Some(image) if self.holds_images(image.dims) => {
                let _turn = self.turns.take();
                moving_slopes::slopes(self, request.moving, request.wanted.clone(), progress)
            }
            _ => Reference.moving_slopes(request, progress),
        }
    }

    fn moving_layers(&self, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> {
        if !requests.iter().all(|of| self.holds_images(of.moving.fields[of.interval].dims)) {
            return Reference.moving_layers(requests);
        }
        let _turn = self.turns.take();
        moving_layer::layers(self, requests)
    }
}
