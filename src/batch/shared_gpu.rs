//! One GPU for all jobs of a batch: kernels are compiled once, calls of several jobs are computed together, and a device that is lost is opened anew.

use std::sync::{Arc, Mutex, PoisonError};

use crate::batch::machine::{Machine, Work};
use crate::error::Result;
use crate::gpu::{Gpu, GpuOptions, GpuOrReference};
use crate::reference::Reference;
use crate::report::{Profile, Report, StageCost};
use crate::surface::Reconstruction;

/// Losses of the device after which a job is given up.
const MOST_LOSSES: usize = 3;

/// A GPU that jobs share.
pub struct SharedGpu<'n> {
    options: GpuOptions,
    /// Whether a job goes to the reference path where the GPU cannot do it.
    fallback: bool,
    notice: &'n (dyn Fn(&str) + Sync),
    gpu: Mutex<Arc<Gpu>>,
    /// Costs of all jobs, stage by stage. Those of jobs that were computed at the same time are the same seconds and the same device.
    stages: Mutex<Vec<StageCost>>,
}

impl<'n> SharedGpu<'n> {
    /// Shares `gpu`, which was opened with `options`. `notice` is told of failures.
    pub fn new(gpu: Gpu, options: GpuOptions, fallback: bool, notice: &'n (dyn Fn(&str) + Sync)) -> Self {
        SharedGpu { options, fallback, notice, gpu: Mutex::new(Arc::new(gpu)), stages: Mutex::default() }
    }

    /// The GPU of now.
    pub fn gpu(&self) -> Arc<Gpu> {
        self.gpu.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Cost of all jobs so far.
    pub fn profile(&self) -> Profile {
        let stages = self.stages.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Profile { stages, ..self.gpu().profile() }
    }

    /// Opens the device anew, unless another job has done so since `lost` was the one.
    fn renew(&self, lost: &Arc<Gpu>) -> Result<()> {
        let mut slot = self.gpu.lock().unwrap_or_else(PoisonError::into_inner);
        if Arc::ptr_eq(&slot, lost) {
            *slot = Arc::new(Gpu::open(&self.options)?);
        }
        Ok(())
    }
}

impl Machine for SharedGpu<'_> {
    /// A job whose device is lost begins again on the device opened anew, so that its bytes are those of a run in which nothing was lost.
    fn compute(&self, work: &Work<'_>) -> Result<Reconstruction> {
        let mut losses = 0;
        loop {
            let gpu = self.gpu();
            let result = match self.fallback {
                true if losses < MOST_LOSSES => work(&GpuOrReference::unless_lost(gpu.clone(), self.notice)),
                true => work(&GpuOrReference::new(gpu.clone(), self.notice)),
                false => work(&*gpu),
            };
            if let Ok(Reconstruction { report: Report { profile: Some(profile), .. }, .. }) = &result {
                StageCost::join(&mut self.stages.lock().unwrap_or_else(PoisonError::into_inner), &profile.stages);
            }
            let why = match result {
                Err(e) if losses < MOST_LOSSES && gpu.device.check().is_err() => e,
                other => return other,
            };
            losses += 1;
            match (self.renew(&gpu), self.fallback) {
                (Ok(()), _) => (self.notice)(&format!("{why}; the device was opened anew, the job begins again")),
                (Err(e), true) => {
                    (self.notice)(&format!("{why}; {e}; the job runs on the CPU reference path"));
                    return work(&Reference);
                }
                (Err(_), false) => return Err(why),
            }
        }
    }
}
