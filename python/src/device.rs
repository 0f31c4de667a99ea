//! The machine that a call computes on.

use std::sync::OnceLock;

use interslice::cli::devices::{ChosenDevice, DeviceOptions, choose};
use interslice::estimate::memory::MemoryNeeds;
use interslice::{Backend, Budget, Error, Reference, Result};

use crate::running::{Home, Watch};

/// The process that has asked drivers of GPUs: they have threads and memory that no fork copies.
static ASKED: Home = Home::new();

/// Why a forked process does not ask them.
const FORKED: &str = "this process was forked from one that has asked the GPU's driver, which no fork survives: start processes by `spawn` or \
                      `forkserver`, or give `backend=\"cpu\"`";

/// Why `backend="auto"` takes the reference path, where it does: drivers are asked once.
static WITHOUT: OnceLock<String> = OnceLock::new();

/// The machine of a call.
pub enum Machine<'w> {
    /// The reference path, and why.
    Reference(String),
    /// Whatever was chosen.
    Chosen(Box<ChosenDevice<'w>>),
}

impl Machine<'_> {
    /// The backend.
    pub fn backend(&self) -> &dyn Backend {
        match self {
            Machine::Reference(_) => &Reference,
            Machine::Chosen(chosen) => chosen.backend(),
        }
    }

    /// Why this one.
    pub fn reason(&self) -> String {
        match self {
            Machine::Reference(why) => why.clone(),
            Machine::Chosen(chosen) => chosen.reason.clone(),
        }
    }

    /// What of a run may stay in memory.
    pub fn budget(&mut self, needs: &MemoryNeeds, writing: u64, limit: Option<u64>) -> Result<Budget> {
        match self {
            Machine::Reference(_) => needs.budget(writing, limit),
            Machine::Chosen(chosen) => chosen.budget(needs, writing, limit),
        }
    }
}

/// Is called before drivers are asked.
///
/// # Errors
/// [`Error::Gpu`] in a process that was forked from one that has asked them.
pub fn ask_drivers() -> Result<()> {
    if ASKED.is_left() { Err(Error::Gpu(FORKED.into())) } else { Ok(()) }
}

/// Opens what the options ask for.
pub fn machine<'w>(options: &'w DeviceOptions, notice: &'w (dyn Fn(&str) + Sync)) -> Result<Machine<'w>> {
    let auto = options.wish() == DeviceOptions::default().wish();
    if let Some(why) = WITHOUT.get().filter(|_| auto) {
        return Ok(Machine::Reference(why.clone()));
    }
    if options.asks_drivers()
        && let Err(forked) = ask_drivers()
    {
        if options.needs_gpu() {
            return Err(forked);
        }
        notice(FORKED);
        return Ok(Machine::Reference(FORKED.into()));
    }
    let chosen = choose(options, notice)?;
    if auto && chosen.backend().device_use().is_none() {
        return Ok(Machine::Reference(WITHOUT.get_or_init(|| chosen.reason.clone()).clone()));
    }
    Ok(Machine::Chosen(Box::new(chosen)))
}

/// A listener to what a GPU says when it fails on the way.
pub fn noticing(watch: &Watch) -> impl Fn(&str) + Sync + '_ {
    |message: &str| watch.warn(message)
}
