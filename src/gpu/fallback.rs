//! A GPU with the reference path behind it: when the GPU fails, the rest of the job goes on there.

use std::sync::{Arc, OnceLock};

use super::Gpu;
use crate::backend::Backend;
use crate::backend::interval_morph::Morphed;
use crate::backend::jobs::{Filled, Traced};
use crate::backend::requests::{
    ContourRequest, LayerRequest, MorphRequest, PartRequest, SlopeRequest, SweepRequest, TraceRequest,
};
use crate::error::{Error, Result};
use crate::grid::field::Field;
use crate::grid::sparse_image::SparseImage;
use crate::progress::Progress;
use crate::reference::Reference;
use crate::registration::displacement::{Displacement, DisplacementJob};
use crate::report::DeviceUse;

/// A GPU, and the reference path from its first failure on.
pub struct GpuOrReference<'n> {
    /// The GPU.
    pub gpu: Arc<Gpu>,
    failure: OnceLock<String>,
    notice: &'n (dyn Fn(&str) + Sync),
    /// Whether a lost device is a failure of its own.
    unless_lost: bool,
}

impl<'n> GpuOrReference<'n> {
    /// `notice` is told of the failure when it happens.
    pub fn new(gpu: impl Into<Arc<Gpu>>, notice: &'n (dyn Fn(&str) + Sync)) -> Self {
        GpuOrReference { gpu: gpu.into(), failure: OnceLock::new(), notice, unless_lost: false }
    }

    /// A GPU with the reference path behind it, but a device that is lost fails: for a caller that can open another.
    pub fn unless_lost(gpu: impl Into<Arc<Gpu>>, notice: &'n (dyn Fn(&str) + Sync)) -> Self {
        GpuOrReference { unless_lost: true, ..Self::new(gpu, notice) }
    }

    fn ask<T>(&self, on: impl Fn(&dyn Backend) -> Result<T>) -> Result<T> {
        if self.failure.get().is_none() {
            match on(&*self.gpu) {
                Err(Error::Gpu(message) | Error::GpuMemory(message))
                    if !(self.unless_lost && self.gpu.device.check().is_err()) =>
                {
                    (self.notice)(&format!("{message}; the rest of the job runs on the CPU reference path"));
                    self.failure.get_or_init(|| message);
                }
                result => return result,
            }
        }
        on(&Reference)
    }
}

impl Backend for GpuOrReference<'_> {
    fn name(&self) -> String {
        match self.failure.get() {
            None => self.gpu.name(),
            Some(message) => format!("{} until it failed ({message}), then {}", self.gpu.name(), Reference.name()),
        }
    }

    fn host_bytes(&self) -> u64 {
        self.gpu.device.host_bytes()
    }

    fn device_use(&self) -> Option<DeviceUse> {
        self.gpu.device_use()
    }

    fn run_begins(&self) {
        self.gpu.run_begins();
    }

    fn run_ends(&self) {
        self.gpu.run_ends();
    }

    fn contour_fields(&self, request: &ContourRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        self.ask(|backend| backend.contour_fields(request, progress))
    }

    fn part_fields(&self, request: &PartRequest<'_>) -> Result<Vec<Field>> {
        self.ask(|backend| backend.part_fields(request))
    }

    fn trace(&self, request: &TraceRequest<'_>, progress: &dyn Progress) -> Result<Vec<Traced>> {
        self.ask(|backend| backend.trace(request, progress))
    }

    fn propagate(&self, request: &SweepRequest<'_>, progress: &dyn Progress) -> Result<Vec<Filled>> {
        self.ask(|backend| backend.propagate(request, progress))
    }

    fn morph_layers(&self, request: &MorphRequest<'_>, progress: &dyn Progress) -> Result<Vec<Morphed>> {
        self.ask(|backend| backend.morph_layers(request, progress))
    }

    fn displacements(&self, request: &DisplacementJob<'_>) -> Result<Vec<Displacement>> {
        self.ask(|backend| backend.displacements(request))
    }

    fn moving_slopes(&self, request: &SlopeRequest<'_>, progress: &dyn Progress) -> Result<Vec<Field>> {
        self.ask(|backend| backend.moving_slopes(request, progress))
    }

    fn moving_layers(&self, requests: &[LayerRequest<'_>]) -> Result<Vec<Vec<SparseImage<f32>>>> {
        self.ask(|backend| backend.moving_layers(requests))
    }
}
