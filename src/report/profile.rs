//! Cost of a run, stage by stage and kernel by kernel.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Cost of a run on a GPU: stage by stage what the host did and what it asked of the device, and the device's kernels, added up by name.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Profile {
    /// Per stage, in the order they ran; what lies between stages is `rest`, what takes the finished layers `output`.
    #[serde(default)]
    pub stages: Vec<StageCost>,
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

/// Cost of a stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StageCost {
    /// Name of the stage.
    pub name: Cow<'static, str>,
    /// CPU seconds of all threads of the host; absent where the system has no clock of threads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub host_seconds: Option<f64>,
    /// Of them, CPU seconds of the threads that run the pipeline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial_seconds: Option<f64>,
    /// What was asked of the device.
    pub device: DeviceUse,
}

/// Use of a device.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DeviceUse {
    /// Times that the host has waited for it.
    pub waits: u64,
    /// Submissions.
    pub submits: u64,
    /// Dispatches.
    pub dispatches: u64,
    /// Buffers that the driver has made, those for sending and reading back too.
    pub buffers: u64,
    /// Bytes sent.
    pub bytes_up: u64,
    /// Bytes read back.
    pub bytes_down: u64,
    /// Dispatches by their threads: the `k`-th number is that of dispatches of at least 4^k and less than 4^(k + 1) threads. Of one whose size
    /// only the device knows the size at the next look counts.
    pub threads: Vec<u64>,
    /// CPU seconds that threads of the host spent in submitting and waiting: a software driver computes there.
    #[serde(skip)]
    pub driver_seconds: f64,
}

impl DeviceUse {
    /// Counts dispatches of this many threads.
    pub fn count_dispatches(&mut self, dispatches: u64, threads: u64) {
        let place = threads.max(1).ilog(4) as usize;
        if self.threads.len() <= place {
            self.threads.resize(place + 1, 0);
        }
        self.threads[place] += dispatches;
        self.dispatches += dispatches;
    }

    /// Adds other use to this.
    pub fn add(&mut self, other: &DeviceUse) {
        self.combine(other, |a, b| a + b, |a, b| a + b);
    }

    /// Use since it was `before`.
    pub fn since(&self, before: &DeviceUse) -> DeviceUse {
        let mut used = self.clone();
        used.combine(before, |a, b| a.saturating_sub(b), |a, b| a - b);
        used
    }

    fn combine(&mut self, other: &DeviceUse, counts: impl Fn(u64, u64) -> u64, seconds: impl Fn(f64, f64) -> f64) {
        self.threads.resize(self.threads.len().max(other.threads.len()), 0);
        let own = [&mut self.waits, &mut self.submits, &mut self.dispatches, &mut self.buffers];
        let own = own.into_iter().chain([&mut self.bytes_up, &mut self.bytes_down]).chain(&mut self.threads);
        let theirs = [other.waits, other.submits, other.dispatches, other.buffers, other.bytes_up, other.bytes_down];
        for (own, other) in own.zip(theirs.into_iter().chain(other.threads.iter().copied())) {
            *own = counts(*own, other);
        }
        self.driver_seconds = seconds(self.driver_seconds, other.driver_seconds);
    }
}

impl StageCost {
    /// Adds another cost to this.
    pub fn add(&mut self, other: &StageCost) {
        self.combine(other, |a, b| a + b);
        self.device.add(&other.device);
    }

    /// Takes a part of this cost out of it.
    pub fn take_out(&mut self, part: &StageCost) {
        self.combine(part, |a, b| (a - b).max(0.0));
        self.device = self.device.since(&part.device);
    }

    fn combine(&mut self, other: &StageCost, seconds: impl Fn(f64, f64) -> f64) {
        let both = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| seconds(a, b));
        self.host_seconds = both(self.host_seconds, other.host_seconds);
        self.serial_seconds = both(self.serial_seconds, other.serial_seconds);
    }

    /// Adds costs to those of the stages of the same names.
    pub fn join(stages: &mut Vec<StageCost>, others: &[StageCost]) {
        for other in others {
            match stages.iter_mut().find(|stage| stage.name == other.name) {
                Some(stage) => stage.add(other),
                None => stages.push(other.clone()),
            }
        }
    }
}

/// Time spent in a stage.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StageReport {
    /// Name of the stage.
    pub name: Cow<'static, str>,
    /// Wall seconds.
    pub seconds: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispatches_are_counted_by_powers_of_four() {
        let mut used = DeviceUse::default();
        for (dispatches, threads) in [(1, 0), (2, 3), (3, 4), (4, 15), (5, 64), (6, 1 << 20)] {
            used.count_dispatches(dispatches, threads);
        }
        assert_eq!(used.threads, [3, 7, 0, 5, 0, 0, 0, 0, 0, 0, 6]);
        assert_eq!(used.dispatches, 21);
    }

    #[test]
    fn what_is_added_can_be_taken_away() {
        let some = |k: u64| DeviceUse {
            waits: k,
            submits: 2 * k,
            bytes_down: 7,
            threads: vec![k; k as usize],
            driver_seconds: k as f64,
            ..DeviceUse::default()
        };
        let mut both = some(2);
        both.add(&some(3));
        assert_eq!(both.threads, [5, 5, 3]);
        assert_eq!(both.since(&some(2)), some(3));
    }
}
