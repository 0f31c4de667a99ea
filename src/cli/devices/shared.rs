//! The machine that the jobs of a batch share.

use interslice::batch::Machine;
#[cfg(feature = "gpu")]
use interslice::batch::shared_gpu::SharedGpu;
use interslice::storage::room;
use interslice::{Backend, Reference, Result};

use super::chosen::NO_PROFILE;
use super::options::DeviceOptions;
#[cfg(feature = "gpu")]
use super::profile::tell_profile;
#[cfg(feature = "gpu")]
use super::search::Found;
use super::search::find;

/// The machine that all jobs of a batch share, and why.
pub struct SharedDevice<'n> {
    together: Together<'n>,
    /// Why this one.
    pub reason: String,
    profile: bool,
}

enum Together<'n> {
    Reference(std::marker::PhantomData<&'n ()>),
    #[cfg(feature = "gpu")]
    Gpu(Box<SharedGpu<'n>>),
}

impl SharedDevice<'_> {
    /// The machine.
    pub fn machine(&self) -> &dyn Machine {
        match &self.together {
            Together::Reference(_) => &Reference,
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => &**shared,
        }
    }

    /// Bytes that it leaves to jobs, of `memory` bytes that a batch may take.
    ///
    /// # Errors
    /// [`interslice::Error::Memory`] where that is nothing.
    pub fn leaves(&self, memory: u64) -> Result<u64> {
        let taken = match &self.together {
            Together::Reference(_) => 0,
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => shared.gpu().device.host_bytes(),
        };
        room::check(taken + (1 << 20), Some(memory))?;
        Ok(memory - taken)
    }

    /// Its name.
    pub fn name(&self) -> String {
        match &self.together {
            Together::Reference(_) => Reference.name(),
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => shared.gpu().name(),
        }
    }

    /// Tells the cost of all jobs, if that was asked.
    pub fn tell_profile(&self) {
        match &self.together {
            _ if !self.profile => {}
            Together::Reference(_) => tell!("warning: {NO_PROFILE}"),
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => tell_profile(&shared.profile()),
        }
    }
}

/// Chooses the machine for many jobs, as [`choose`](super::choose) does for one.
#[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only a GPU gives notice"))]
pub fn share<'n>(options: &DeviceOptions, notice: &'n (dyn Fn(&str) + Sync)) -> Result<SharedDevice<'n>> {
    let (found, reason) = find(options)?;
    let together = match found {
        None => Together::Reference(std::marker::PhantomData),
        #[cfg(feature = "gpu")]
        Some(Found { gpu, fallback }) => {
            Together::Gpu(Box::new(SharedGpu::new(gpu, options.wanted(), fallback, notice)))
        }
        #[cfg(not(feature = "gpu"))]
        Some(none) => match none {},
    };
    Ok(SharedDevice { together, reason, profile: options.profile })
}
