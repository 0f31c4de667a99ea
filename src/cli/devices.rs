//! Choice of the machine: `--backend`, `--adapter`, `--memory`, `--profile`, and `interslice devices`.

use clap::ValueEnum;
use interslice::batch::Machine as BatchMachine;
#[cfg(feature = "gpu")]
use interslice::batch::shared_gpu::SharedGpu;
use interslice::estimate::memory::MemoryNeeds;
#[cfg(feature = "gpu")]
use interslice::gpu::adapter::{AdapterSummary, adapters};
#[cfg(feature = "gpu")]
use interslice::gpu::device::DRIVER_BYTES;
#[cfg(feature = "gpu")]
use interslice::gpu::selftest::doctor;
#[cfg(feature = "gpu")]
use interslice::gpu::trust::{cache_folder, examined, remembered};
#[cfg(feature = "gpu")]
use interslice::gpu::{Gpu, GpuOptions, GpuOrReference};
use interslice::report::{DeviceUse, Profile, StageCost};
use interslice::storage::room;
use interslice::{Backend, Budget, Error, Reference, Result};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::say::say;

/// Backend that the user asks for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum BackendChoice {
    /// A GPU if there is one that passes a short self-test, else the reference path; the reference path too when the GPU fails
    #[default]
    Auto,
    /// A GPU, or a software adapter where there is none; fails when it fails
    Gpu,
    /// The f64 reference path
    Cpu,
}

#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Machine")]
pub struct DeviceOptions {
    /// Machine for the numeric stages
    #[arg(long, value_enum, default_value_t)]
    backend: BackendChoice,

    /// GPU to use, by its number in `interslice devices` or a part of its name
    #[arg(long, value_name = "NAME|NUMBER")]
    adapter: Option<String>,

    /// Memory that a run aims to stay within, e.g. 512M or 4G [default: what is free]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    #[serde(deserialize_with = "named_bytes")]
    memory: Option<u64>,

    /// Memory that the GPU's buffers may take [default: `--memory`, or a third of it where the GPU shares the host's memory, else 60 % of what is free there, or 80 % of the GPU's own]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    #[serde(deserialize_with = "named_bytes")]
    gpu_memory: Option<u64>,

    /// Time every kernel; say what the stages have cost the host and asked of the GPU, and what each kernel has cost
    #[arg(long)]
    profile: bool,
}

impl DeviceOptions {
    /// Bytes of memory that were allowed.
    pub fn memory(&self) -> Option<u64> {
        self.memory
    }

    /// The machine as it was asked for; what bounds it changes no result.
    pub fn wish(&self) -> String {
        let backend = self.backend.to_possible_value().map_or(String::new(), |v| v.get_name().into());
        self.adapter.as_ref().map_or(backend.clone(), |adapter| format!("{backend} {adapter}"))
    }
}

#[cfg(feature = "gpu")]
impl DeviceOptions {
    fn wanted(&self) -> GpuOptions {
        GpuOptions {
            adapter: self.adapter.clone(),
            memory: self.gpu_memory,
            within: self.memory,
            timed: self.profile,
            ..GpuOptions::default()
        }
    }
}

/// A number of bytes with an optional K, M, G or T (powers of 1024).
pub fn bytes(text: &str) -> std::result::Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match text[digits.len()..].to_uppercase().trim_end_matches('B').trim_end_matches('I') {
        "" => 1u64,
        "K" => 1 << 10,
        "M" => 1 << 20,
        "G" => 1 << 30,
        "T" => 1 << 40,
        _ => return Err(format!("must be a number of bytes with K, M, G or T, such as 512M; got `{text}`")),
    };
    let wrong = || format!("must be a number of bytes such as 512M or 4G, at least 1M; got `{text}`");
    let count: u64 = digits.parse().map_err(|_| wrong())?;
    count.checked_mul(unit).filter(|&b| b >= 1 << 20).ok_or_else(wrong)
}

/// [`bytes`] of a settings file, as a number or as text.
fn named_bytes<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<Option<u64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "must be a number of bytes, or text such as \"512M\"")]
    enum Named {
        Number(u64),
        Text(String),
    }
    let text = match Option::<Named>::deserialize(from)? {
        None => return Ok(None),
        Some(Named::Number(count)) => count.to_string(),
        Some(Named::Text(text)) => text,
    };
    bytes(&text).map(Some).map_err(D::Error::custom)
}

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

    /// Budget of a run with these needs beside `writing` bytes: what of it may stay in memory. A GPU that was not asked for by name is given up
    /// where it leaves too little.
    ///
    /// # Errors
    /// The errors of [`MemoryNeeds::budget`].
    pub fn budget(&mut self, needs: &MemoryNeeds, writing: u64, limit: Option<u64>) -> Result<Budget> {
        let budget = needs.budget(writing + self.backend().host_bytes() + self.left, limit);
        match (&self.machine, budget) {
            #[cfg(feature = "gpu")]
            (Machine::Either(_), Err(Error::Memory { needed_mib, .. })) => {
                self.reason = format!("the GPU leaves too little memory: with it {needed_mib} MiB are needed");
                self.machine = Machine::Reference(std::marker::PhantomData);
                self.left = DRIVER_BYTES;
                needs.budget(writing + self.left, limit)
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
    }
}

/// A GPU that was opened.
#[cfg(feature = "gpu")]
struct Found {
    gpu: Gpu,
    /// The reference path goes on where it fails.
    fallback: bool,
}

/// No program without the `gpu` feature finds one.
#[cfg(not(feature = "gpu"))]
enum Found {}

/// Opens what the options ask for; nothing is the reference path. Says why.
#[cfg(feature = "gpu")]
fn find(options: &DeviceOptions) -> Result<(Option<Found>, String)> {
    match options.backend {
        BackendChoice::Cpu => return Ok((None, "asked for with --backend cpu".into())),
        BackendChoice::Gpu => {
            let gpu = Gpu::open(&options.wanted())?;
            return Ok((Some(Found { gpu, fallback: false }), "asked for with --backend gpu".into()));
        }
        BackendChoice::Auto => {}
    }
    if options.adapter.is_none()
        && let Err(why) = automatic(&adapters())
    {
        return Ok((None, why));
    }
    let reason = if options.adapter.is_some() { "asked for with --adapter" } else { "the best GPU of this machine" };
    match trusted(&options.wanted()) {
        Ok(Ok(gpu)) => Ok((Some(Found { gpu, fallback: true }), reason.into())),
        Ok(Err(why)) => Ok((None, why)),
        Err(Error::Gpu(message) | Error::GpuMemory(message)) => Ok((None, message)),
        Err(e) => Err(e),
    }
}

/// A GPU whose self-test has agreed, now or in an earlier run, or why it is not trusted.
#[cfg(feature = "gpu")]
fn trusted(options: &GpuOptions) -> Result<std::result::Result<Gpu, String>> {
    let gpu = Gpu::open(options)?;
    let (outcome, now) = examined(cache_folder().as_deref(), &gpu)?;
    if !outcome.wrong.is_empty() {
        return Ok(Err(distrust(&outcome.wrong, &gpu.device.summary)));
    }
    // What the self-test has cost is no part of the run.
    if now { Gpu::open(options).map(Ok) } else { Ok(Ok(gpu)) }
}

/// Why a GPU is not trusted.
#[cfg(feature = "gpu")]
fn distrust(wrong: &[String], summary: &AdapterSummary) -> String {
    let AdapterSummary { name, driver, .. } = summary;
    let first = wrong.first().map_or("", String::as_str);
    format!("the self-test of {name} ({driver}) failed: {} stages are wrong, the first is {first}", wrong.len())
}

/// Without the GPU backend there is one choice.
#[cfg(not(feature = "gpu"))]
fn find(options: &DeviceOptions) -> Result<(Option<Found>, String)> {
    let without = "this program was built without the `gpu` feature";
    match options.backend {
        BackendChoice::Gpu => Err(Error::Gpu(without.into())),
        BackendChoice::Auto => Ok((None, without.into())),
        BackendChoice::Cpu => Ok((None, "asked for with --backend cpu".into())),
    }
}

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
    pub fn machine(&self) -> &dyn BatchMachine {
        match &self.together {
            Together::Reference(_) => &Reference,
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => &**shared,
        }
    }

    /// Bytes that it leaves to jobs, of `memory` bytes that a batch may take.
    ///
    /// # Errors
    /// [`Error::Memory`] where that is nothing.
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

    /// Cost of all jobs, if that was asked.
    pub fn profile(&self) -> Option<Profile> {
        match &self.together {
            _ if !self.profile => None,
            Together::Reference(_) => None,
            #[cfg(feature = "gpu")]
            Together::Gpu(shared) => Some(shared.profile()),
        }
    }
}

/// Chooses the machine for many jobs, as [`choose`] does for one.
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

/// The adapter that `--backend auto` takes, or why it takes none.
#[cfg(feature = "gpu")]
fn automatic(found: &[AdapterSummary]) -> std::result::Result<usize, String> {
    if let Some(k) = found.iter().position(|a| a.lacks.is_none() && !a.is_software()) {
        return Ok(k);
    }
    Err(match found.first() {
        None => "there is no GPU driver here".into(),
        Some(a) if a.is_software() => {
            format!("{} computes on the CPU, where the reference path is faster", a.name)
        }
        Some(a) => format!("{}: {}", a.name, a.lacks.as_deref().unwrap_or("cannot be used")),
    })
}

/// Stages in their order, for people.
fn tell_stages(stages: &[StageCost]) {
    let Some(first) = stages.first() else { return };
    let line = |stage: &StageCost| {
        let seconds = |s: Option<f64>| s.map_or("-".into(), |s| format!("{s:.3}"));
        let DeviceUse { waits, submits, dispatches, buffers, bytes_up, bytes_down, .. } = stage.device;
        let [up, down] = [bytes_up, bytes_down].map(|bytes| bytes as f64 * 1e-6);
        eprintln!(
            "{:>20} {:>10} {:>8} {waits:>6} {submits:>8} {dispatches:>11} {buffers:>8} {up:>8.1} {down:>8.1}",
            stage.name,
            seconds(stage.host_seconds),
            seconds(stage.serial_seconds)
        );
    };
    eprintln!(
        "{:>20} {:>10} {:>8} {:>6} {:>8} {:>11} {:>8} {:>8} {:>8}",
        "stage", "host CPU s", "serial s", "waits", "submits", "dispatches", "buffers", "MB up", "MB down"
    );
    stages.iter().for_each(line);
    let mut all = StageCost { name: "all".into(), ..first.clone() };
    stages[1..].iter().for_each(|stage| all.add(stage));
    line(&all);
    let threads = all.device.threads.iter().enumerate().filter(|(_, count)| **count > 0);
    let words: Vec<String> = threads.map(|(k, count)| format!("{count} from {}", 1u64 << (2 * k))).collect();
    eprintln!("threads of the dispatches, by powers of 4: {}", words.join(", "));
}

/// Stages, and kernels by cost, for people.
pub fn tell_profile(profile: &Profile) {
    tell_stages(&profile.stages);
    let mut kernels: Vec<_> = profile.kernels.iter().collect();
    kernels.sort_by(|a, b| b.1.seconds.total_cmp(&a.1.seconds));
    let total: f64 = kernels.iter().map(|(_, k)| k.seconds).sum();
    let dispatches: u64 = kernels.iter().map(|(_, k)| k.dispatches).sum();
    eprintln!("{:>20} {:>10} {:>7} {:>11} {:>10} {:>8}", "kernel", "GPU ms", "share", "dispatches", "us each", "Mpx/s");
    for (name, k) in kernels {
        let rate = if k.pixels > 0 && k.seconds > 0.0 {
            format!("{:8.1}", k.pixels as f64 / k.seconds * 1e-6)
        } else {
            "       -".into()
        };
        eprintln!(
            "{name:>20} {:10.2} {:6.1}% {:>11} {:10.1} {rate}",
            1e3 * k.seconds,
            if total > 0.0 { 100.0 * k.seconds / total } else { 0.0 },
            k.dispatches,
            1e6 * k.seconds / k.dispatches.max(1) as f64
        );
    }
    eprintln!(
        "{:.1} GPU ms in {dispatches} dispatches and {} submissions; {:.1} MB sent, {:.1} MB read back",
        1e3 * total,
        profile.submissions,
        profile.bytes_up as f64 * 1e-6,
        profile.bytes_down as f64 * 1e-6
    );
    if let Some(busy) = profile.busy.filter(|busy| busy.of_seconds > 0.0) {
        eprintln!(
            "the device had work in {:.1} % of the {:.2} s from its first kernel to its last",
            100.0 * busy.seconds / busy.of_seconds,
            busy.of_seconds
        );
    }
}

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

/// `interslice doctor`.
#[cfg(feature = "gpu")]
pub fn examine(options: &DeviceOptions) -> Result<()> {
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

/// `interslice devices` of a program without GPU backend.
#[cfg(not(feature = "gpu"))]
pub fn list() -> Result<()> {
    say("this program was built without the `gpu` feature: everything runs on the CPU reference path\n")
}
