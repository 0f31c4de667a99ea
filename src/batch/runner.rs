//! Runs the jobs of a manifest: reading, computing (which writes layer by layer) and completing each on threads of their own, with bounded
//! queues between them.
//!
//! ```text
//! lock, fingerprint, finished? -> read -> gate -> | queue | -> compute, write -> | queue | -> complete, rename, result line -> unlock
//! ```
//!
//! A job's bytes depend on its fingerprint only, not on the order or number of jobs in flight.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use super::agenda::{Agenda, Batch, Options, Outcome, Watch};
use super::flight::{Computed, Read};
use super::gate::Gate;
use super::lock::Locks;
use super::machine::Machine;
use super::manifest::{Job, Manifest};
use super::pictures::Pictures;
use super::results::Results;
use crate::error::Result;

/// Time to wait before asking again for jobs that another process has.
const PATIENCE: Duration = Duration::from_millis(100);

/// Runs all jobs of a manifest that are not finished; says what has become of each, in the manifest's order. `stop` ends the batch: jobs that
/// are being computed are finished, no others begin.
///
/// # Errors
/// [`Output`](crate::Error::Output), [`Read`](crate::Error::Read) where the results or locks cannot be used. A job's failure is an [`Outcome`].
pub fn run(
    manifest: &Manifest,
    results: &Path,
    machine: &dyn Machine,
    options: &Options,
    watch: &dyn Watch,
    stop: &AtomicBool,
) -> Result<Vec<Outcome>> {
    // Before anything is made beside them.
    let kept = Results::open(results)?;
    let batch = Batch {
        manifest,
        machine,
        options,
        watch,
        stop,
        locks: Locks::open(&folder_of(results, "locks"))?,
        results: kept,
        pictures: options.pictures.then(|| Pictures::open(results)).transpose()?,
        gate: Gate::new(options.memory),
        agenda: Mutex::new(Agenda { fresh: (0..manifest.jobs.len()).collect(), elsewhere: VecDeque::new() }),
        outcomes: Mutex::new(vec![Outcome::NotRun; manifest.jobs.len()]),
    };
    run_workers(&batch, options.jobs.max(1));
    Ok(batch.outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// All jobs through all threads.
fn run_workers(batch: &Batch<'_>, jobs: usize) {
    let (to_compute, read) = sync_channel(jobs);
    let (to_write, computed) = sync_channel(jobs);
    let (read, computed) = (Mutex::new(read), Mutex::new(computed));
    thread::scope(|scope| {
        for _ in 0..jobs {
            let to_compute = to_compute.clone();
            scope.spawn(move || batch.read_all(&to_compute));
        }
        for _ in 0..jobs {
            let (to_write, read) = (to_write.clone(), &read);
            scope.spawn(move || batch.compute_all(read, &to_write));
        }
        for _ in 0..jobs {
            let computed = &computed;
            scope.spawn(move || batch.write_all(computed));
        }
        // The threads have their own ends of the queues.
        drop((to_compute, to_write));
    });
}

/// Whether each job is finished, in the manifest's order; nothing is written.
///
/// # Errors
/// [`Output`](crate::Error::Output), [`Read`](crate::Error::Read) where the results cannot be used.
pub fn finished(manifest: &Manifest, results: &Path, machine: &str) -> Result<Vec<bool>> {
    let results = Results::open(results)?;
    // An input that cannot be read is told when its job runs.
    let is = |job: &Job| job.fingerprint(machine).map_or(Ok(false), |f| results.finished(&f, job));
    manifest.jobs.iter().map(is).collect()
}

/// Folder beside a results file of what belongs to it.
pub(super) fn folder_of(results: &Path, what: &str) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(results.file_name().unwrap_or_default());
    name.push(".");
    name.push(what);
    results.with_file_name(name)
}

impl<'a> Batch<'a> {
    fn read_all(&'a self, to_compute: &SyncSender<Read<'a>>) {
        while !self.stopped() {
            let Some((index, again)) = self.next() else { break };
            let job = &self.manifest.jobs[index];
            match self.locks.job(&job.id) {
                Ok(Some(lock)) => {
                    if let Some(read) = self.read(index, lock)
                        && to_compute.send(read).is_err()
                    {
                        break;
                    }
                }
                Ok(None) => {
                    self.agenda.lock().unwrap_or_else(PoisonError::into_inner).elsewhere.push_back(index);
                    if again {
                        thread::sleep(PATIENCE);
                    }
                }
                Err(e) => self.ended(index, Outcome::Failed(e.to_string())),
            }
        }
    }

    fn compute_all(&'a self, read: &Mutex<Receiver<Read<'a>>>, to_write: &SyncSender<Computed<'a>>) {
        while let Some(read) = take(read) {
            if self.stopped() {
                continue; // dropped: not run
            }
            if let Some(computed) = self.compute(read)
                && to_write.send(computed).is_err()
            {
                break;
            }
        }
    }

    fn write_all(&self, computed: &Mutex<Receiver<Computed<'a>>>) {
        while let Some(computed) = take(computed) {
            self.write(computed);
        }
    }
}

/// The next of a queue that several threads take from; nothing when it has ended.
fn take<T>(queue: &Mutex<Receiver<T>>) -> Option<T> {
    queue.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}
