//! The options that choose the machine and bound its memory.

use clap::ValueEnum;
#[cfg(feature = "gpu")]
use interslice::gpu::GpuOptions;
use interslice::stack::options::name_or_number;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// Backend that the user asks for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BackendChoice {
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
    pub(super) backend: BackendChoice,

    /// GPU to use, by its number in `interslice devices` or a part of its name
    #[arg(long, value_name = "NAME|NUMBER")]
    #[serde(deserialize_with = "name_or_number")]
    pub(super) adapter: Option<String>,

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
    pub(super) profile: bool,
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

    /// A sentence for each option that changes nothing: those of a GPU where none is to compute.
    pub fn idle(&self) -> Vec<String> {
        let options = [("adapter", self.adapter.is_some()), ("gpu_memory", self.gpu_memory.is_some())];
        let idle = options.into_iter().filter(|(_, asked)| *asked && self.backend == BackendChoice::Cpu);
        idle.map(|(name, _)| format!("setting `{name}` changes nothing: it is for a GPU, and `backend` is cpu"))
            .collect()
    }

    /// Whether drivers of GPUs are asked.
    pub fn asks_drivers(&self) -> bool {
        self.backend != BackendChoice::Cpu
    }

    /// Whether nothing but a GPU will do.
    pub fn needs_gpu(&self) -> bool {
        self.backend == BackendChoice::Gpu
    }
}

#[cfg(feature = "gpu")]
impl DeviceOptions {
    pub(super) fn wanted(&self) -> GpuOptions {
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
fn bytes(text: &str) -> std::result::Result<u64, String> {
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
