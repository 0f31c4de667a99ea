//! The machine of one run, and what its memory leaves to the run.

#[cfg(feature = "gpu")]
use interslice::Error;
use interslice::estimate::memory::MemoryNeeds;
#[cfg(feature = "gpu")]
use interslice::gpu::device::DRIVER_BYTES;
#[cfg(feature = "gpu")]
use interslice::gpu::{Gpu, GpuOrReference};
use interslice::report::Profile;
use interslice::{Backend, Budget, Reference, Result};

use super::options::DeviceOptions;
use super::profile::tell_profile;
#[cfg(feature = "gpu")]
use super::search::Found;
use super::search::find;

/// The machine that was chosen, and why.
pub struct ChosenDevice<'n> {
    machine: Machine<'n>,
    /// Why this one.
    pub reason: String,
    /// Bytes of memory that a driver still has which is not used any more.
    left: u64,
    profile: bool,
}

enum Machine<'n> {
    Reference(std::marker::PhantomData<&'n ()>),
    #[cfg(feature = "gpu")]
    Gpu(Box<Gpu>),
    #[cfg(feature = "gpu")]
    Either(Box<GpuOrReference<'n>>),
}

impl ChosenDevice<'_> {
    /// The backend.
    pub fn backend(&self) -> &dyn Backend {
        match &self.machine {
            Machine::Reference(_) => &Reference,
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => &**gpu,
            #[cfg(feature = "gpu")]
            Machine::Either(either) => &**either,
        }
    }

    /// Bytes of memory that a run needs beside its reconstruction: its outputs' and this machine's own.
    pub fn beside(&self, writing: u64) -> u64 {
        writing + self.backend().host_bytes() + self.left
    }

    /// Budget of a run with these needs beside `writing` bytes: what of it may stay in memory. A GPU that was not asked for by name is given up
    /// where it leaves too little.
    ///
    /// # Errors
    /// The errors of [`MemoryNeeds::budget`].
    pub fn budget(&mut self, needs: &MemoryNeeds, writing: u64, limit: Option<u64>) -> Result<Budget> {
        let budget = needs.budget(self.beside(writing), limit);
        match (&self.machine, budget) {
            #[cfg(feature = "gpu")]
            (Machine::Either(_), Err(Error::Memory { needed_mib, .. })) => {
                self.reason = format!("the GPU leaves too little memory: with it {needed_mib} MiB are needed");
                self.machine = Machine::Reference(std::marker::PhantomData);
                self.left = DRIVER_BYTES;
                needs.budget(self.beside(writing), limit)
            }
            (_, budget) => budget,
        }
    }

    /// Puts the cost of the kernels beside that of the stages.
    pub fn complete(&self, profile: &mut Option<Profile>) {
        let whole: Option<Profile> = match &self.machine {
            Machine::Reference(_) => None,
            #[cfg(feature = "gpu")]
            Machine::Gpu(gpu) => Some(gpu.profile()),
            #[cfg(feature = "gpu")]
            Machine::Either(either) => Some(either.gpu.profile()),
        };
        if let Some(whole) = whole {
            *profile = Some(Profile { stages: profile.take().unwrap_or_default().stages, ..whole });
        }
    }

    /// Tells the profile, if that was asked.
    pub fn tell(&self, profile: &Option<Profile>) {
        profile.iter().filter(|_| self.profile).for_each(tell_profile);
        if self.profile && profile.is_none() {
            tell!("warning: {NO_PROFILE}");
        }
    }

    /// Tells what the kernels of several bodies have cost, if that was asked.
    pub fn tell_kernels(&self) {
        let mut profile = None;
        self.complete(&mut profile);
        self.tell(&profile);
    }
}

/// Said where `--profile` has nothing to show.
pub(super) const NO_PROFILE: &str =
    "setting `profile` changes nothing: it shows what a GPU has cost, and none has computed";

/// Opens what the options ask for; `notice` is told when a GPU fails on the way.
#[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only a GPU gives notice"))]
pub fn choose<'n>(options: &DeviceOptions, notice: &'n (dyn Fn(&str) + Sync)) -> Result<ChosenDevice<'n>> {
    let (found, reason) = find(options)?;
    let machine = match found {
        None => Machine::Reference(std::marker::PhantomData),
        #[cfg(feature = "gpu")]
        Some(Found { gpu, fallback: false }) => Machine::Gpu(Box::new(gpu)),
        #[cfg(feature = "gpu")]
        Some(Found { gpu, fallback: true }) => Machine::Either(Box::new(GpuOrReference::new(gpu, notice))),
        #[cfg(not(feature = "gpu"))]
        Some(none) => match none {},
    };
    Ok(ChosenDevice { machine, reason, left: 0, profile: options.profile })
}
