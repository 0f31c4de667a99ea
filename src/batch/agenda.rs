//! Agenda that all threads of a batch share: jobs asked for, jobs still to do, and their outcomes.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use super::gate::Gate;
use super::lock::Locks;
use super::machine::Machine;
use super::manifest::{Job, Manifest};
use super::pictures::Pictures;
use super::results::Results;

/// Options of a batch.
#[derive(Debug, Clone)]
pub struct Options {
    /// Jobs computed at once; as many are read ahead and completed behind.
    pub jobs: usize,
    /// Bytes of memory that the jobs in flight may need together, by their estimates.
    pub memory: u64,
    /// Begin no job after one has failed.
    pub fail_fast: bool,
    /// Keep a small picture of each job that writes none, for [the page](super::index).
    pub pictures: bool,
    /// The machine as it was asked for. Part of every fingerprint: a result of another machine is another result.
    pub machine: String,
}

/// Outcome of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// Computed and written now.
    Done,
    /// Finished before, or by another process.
    Skipped,
    /// Failed, why.
    Failed(String),
    /// Not begun, or dropped before it was computed.
    NotRun,
}

/// Is told what becomes of the jobs, from any thread.
pub trait Watch: Sync {
    /// A job has ended.
    fn ended(&self, job: &Job, outcome: &Outcome);
}

/// State that all threads share.
pub(super) struct Batch<'a> {
    pub(super) manifest: &'a Manifest,
    pub(super) machine: &'a dyn Machine,
    pub(super) options: &'a Options,
    pub(super) watch: &'a dyn Watch,
    pub(super) stop: &'a AtomicBool,
    pub(super) locks: Locks,
    pub(super) results: Results,
    pub(super) pictures: Option<Pictures>,
    pub(super) gate: Gate,
    pub(super) agenda: Mutex<Agenda>,
    pub(super) outcomes: Mutex<Vec<Outcome>>,
}

/// Jobs still to be looked at.
pub(super) struct Agenda {
    pub(super) fresh: VecDeque<usize>,
    /// Jobs that another process had when they were looked at.
    pub(super) elsewhere: VecDeque<usize>,
}

impl Batch<'_> {
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(super) fn next(&self) -> Option<(usize, bool)> {
        let mut agenda = self.agenda.lock().unwrap_or_else(PoisonError::into_inner);
        let fresh = agenda.fresh.pop_front().map(|index| (index, false));
        fresh.or_else(|| agenda.elsewhere.pop_front().map(|index| (index, true)))
    }

    pub(super) fn ended(&self, index: usize, outcome: Outcome) {
        self.watch.ended(&self.manifest.jobs[index], &outcome);
        if self.options.fail_fast && matches!(outcome, Outcome::Failed(_)) {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.outcomes.lock().unwrap_or_else(PoisonError::into_inner)[index] = outcome;
    }
}
