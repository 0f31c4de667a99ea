//! One GPU for the jobs of a batch, one after another: pipelines are compiled once, and a device that is lost is opened anew.

use std::sync::{Arc, Mutex, PoisonError};

use super::{Gpu, GpuOptions, GpuOrReference};
use crate::batch::machine::{Machine, Work};
use crate::error::Result;
use crate::reference::Reference;
use crate::surface::Reconstruction;

/// A GPU that jobs share.
pub struct SharedGpu<'n> {
    options: GpuOptions,
    /// Whether a job goes to the reference path where the GPU cannot do it.
    fallback: bool,
    notice: &'n (dyn Fn(&str) + Sync),
    gpu: Mutex<Arc<Gpu>>,
    turn: Mutex<()>,
}

impl<'n> SharedGpu<'n> {
    /// Shares `gpu`, which was opened with `options`. `notice` is told of failures.
    pub fn new(gpu: Gpu, options: GpuOptions, fallback: bool, notice: &'n (dyn Fn(&str) + Sync)) -> Self {
        SharedGpu { options, fallback, notice, gpu: Mutex::new(Arc::new(gpu)), turn: Mutex::new(()) }
    }

    /// The GPU of now.
    pub fn gpu(&self) -> Arc<Gpu> {
        self.gpu.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Opens the device anew.
    fn renew(&self) -> Result<()> {
        let fresh = Arc::new(Gpu::open(&self.options)?);
        *self.gpu.lock().unwrap_or_else(PoisonError::into_inner) = fresh;
        Ok(())
    }
}

impl Machine for SharedGpu<'_> {
    fn at_once(&self) -> usize {
        1
    }

    /// A job whose device is lost begins again on the device opened anew, so that its bytes are those of a run in which nothing was lost.
    fn compute(&self, work: &Work<'_>) -> Result<Reconstruction> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let gpu = self.gpu();
        let first = match self.fallback {
            true => work(&GpuOrReference::unless_lost(gpu.clone(), self.notice)),
            false => work(&*gpu),
        };
        let lost = match first {
            Err(e) if gpu.device.check().is_err() => e,
            other => return other,
        };
        match (self.renew(), self.fallback) {
            (Ok(()), fallback) => {
                (self.notice)(&format!("{lost}; the device was opened anew, the job begins again"));
                if fallback { work(&GpuOrReference::new(self.gpu(), self.notice)) } else { work(&*self.gpu()) }
            }
            (Err(e), true) => {
                (self.notice)(&format!("{lost}; {e}; the job runs on the CPU reference path"));
                work(&Reference)
            }
            (Err(_), false) => Err(lost),
        }
    }
}
