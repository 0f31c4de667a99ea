//! `interslice devices`: the GPUs of this machine, and which one would be used.

use interslice::Result;
#[cfg(feature = "gpu")]
use interslice::gpu::adapter::{AdapterSummary, adapters};
#[cfg(feature = "gpu")]
use interslice::gpu::trust::{cache_folder, remembered};

#[cfg(feature = "gpu")]
use super::search::{automatic, distrust};
use crate::cli::say::say;

/// `interslice devices`.
#[cfg(feature = "gpu")]
pub fn list() -> Result<()> {
    let found = adapters();
    let line = |a: &AdapterSummary| {
        format!(
            "{}: {} ({}, {}; {})\n   {}largest array {} MiB, largest buffer {} MiB{}\n",
            a.index,
            a.name,
            a.kind,
            a.api,
            a.driver,
            a.memory.map_or(String::new(), |bytes| format!("memory {} MiB, ", bytes >> 20)),
            a.largest_binding >> 20,
            a.largest_buffer >> 20,
            a.lacks.as_ref().map_or(String::new(), |l| format!("; cannot be used: {l}"))
        )
    };
    let choice = match automatic(&found) {
        Ok(k) => match remembered(cache_folder().as_deref(), &found[k]) {
            Some(outcome) if outcome.wrong.is_empty() => {
                format!("--backend auto takes adapter {k}: {}, which has passed its self-test\n", found[k].name)
            }
            Some(outcome) => {
                let why = distrust(&outcome.wrong, &found[k]);
                format!("--backend auto takes the CPU reference path: {why}\n")
            }
            None => format!(
                "--backend auto takes adapter {k}: {}, if it passes its self-test: the first run makes it\n",
                found[k].name
            ),
        },
        Err(why) => format!("--backend auto takes the CPU reference path: {why}\n"),
    };
    say(&(found.iter().map(line).collect::<String>() + &choice))
}

/// `interslice devices` of a program without GPU backend.
#[cfg(not(feature = "gpu"))]
pub fn list() -> Result<()> {
    say("this program was built without the `gpu` feature: everything runs on the CPU reference path\n")
}
