//! `interslice doctor`: whether a GPU and its driver compute rightly.

#[cfg(feature = "gpu")]
use interslice::Backend;
#[cfg(feature = "gpu")]
use interslice::gpu::Gpu;
#[cfg(feature = "gpu")]
use interslice::gpu::selftest::doctor;
use interslice::{Error, Result};

use super::options::DeviceOptions;
#[cfg(feature = "gpu")]
use super::profile::tell_profile;
#[cfg(feature = "gpu")]
use crate::cli::say::say;

/// `interslice doctor`.
#[cfg(feature = "gpu")]
pub fn examine(options: &DeviceOptions) -> Result<()> {
    if !options.asks_drivers() {
        let message = "cpu leaves nothing to test: `doctor` holds a GPU against the reference path".into();
        return Err(Error::Setting { name: "--backend".into(), message });
    }
    let gpu = Gpu::open(&options.wanted())?;
    say(&format!("{}\n", gpu.name()))?;
    let findings = doctor::examine(&gpu)?;
    say(&findings.in_words().iter().map(|line| format!("  {line}\n")).collect::<String>())?;
    if options.profile {
        tell_profile(&gpu.profile());
    }
    if findings.trusted() { Ok(()) } else { Err(Error::Gpu("the self-test failed".into())) }
}

/// `interslice doctor` of a program without GPU backend.
#[cfg(not(feature = "gpu"))]
pub fn examine(_options: &DeviceOptions) -> Result<()> {
    Err(Error::Gpu("this program was built without the `gpu` feature".into()))
}
