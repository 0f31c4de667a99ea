//! Cost of a run, stage by stage and kernel by kernel.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Cost of a GPU's kernels, added up by name.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Profile {
    /// Per kernel.
    pub kernels: BTreeMap<Cow<'static, str>, KernelCost>,
    /// Submissions.
    pub submissions: u64,
    /// Bytes sent to the device.
    pub bytes_up: u64,
    /// Bytes read back.
    pub bytes_down: u64,
    /// Share of its time that the device worked; absent unless timed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub busy: Option<Busy>,
}

/// Time in which a device had work, by its own clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Busy {
    /// Time from the beginning to the end of submissions, none of it twice, seconds.
    pub seconds: f64,
    /// Time from the beginning of the first to the end of the last, seconds.
    pub of_seconds: f64,
}

/// Cost of one kernel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelCost {
    /// Dispatches.
    pub dispatches: u64,
    /// Seconds on the device; 0 unless timed.
    pub seconds: f64,
    /// Pixels updated, where they are counted.
    pub pixels: u64,
}

/// Time spent in a stage.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StageReport {
    /// Name of the stage.
    pub name: Cow<'static, str>,
    /// Wall seconds.
    pub seconds: f64,
}
