//! Runs the jobs of a manifest: reading, computing and writing each on threads of their own, with bounded queues between them.
//!
//! ```text
//! lock, fingerprint, finished? -> read -> gate -> | queue | -> compute -> | queue | -> mesh, write, rename, result line -> unlock
//! ```
//!
//! A job's bytes depend on its fingerprint only, not on the order or number of jobs in flight.

use std::any::Any;
use std::collections::VecDeque;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::fingerprint::{digest, fingerprint};
use super::gate::{Gate, Permit};
use super::lock::{Held, Locks};
use super::machine::Machine;
use super::manifest::{Job, Manifest};
use super::results::{Certificate, ResultLine, Results, Status, Written};
use crate::error::{Error, Result};
use crate::files::Loaded;
use crate::files::outputs::{Outputs, Temporary};
use crate::progress::Silent;
use crate::surface::Reconstruction;

/// How long to wait before asking again for jobs that another process has.
const PATIENCE: Duration = Duration::from_millis(100);

/// How a batch runs.
#[derive(Debug, Clone)]
pub struct Options {
    /// Jobs computed at once; as many are read ahead and written behind.
    pub jobs: usize,
    /// Bytes of memory that the jobs in flight may need together, by their estimates.
    pub memory: u64,
    /// Begin no job after one has failed.
    pub fail_fast: bool,
    /// The machine as it was asked for. Part of every fingerprint: a result of another machine is another result.
    pub machine: String,
}

/// What has become of a job.
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

/// Runs all jobs of a manifest that are not finished; says what has become of each, in the manifest's order. `stop` ends the batch: jobs that
/// are being computed are finished, no others begin.
///
/// # Errors
/// [`Error::Output`], [`Error::Read`] where the results or locks cannot be used. A job's failure is an [`Outcome`].
pub fn run(
    manifest: &Manifest,
    results: &Path,
    machine: &dyn Machine,
    options: &Options,
    watch: &dyn Watch,
    stop: &AtomicBool,
) -> Result<Vec<Outcome>> {
    let batch = Batch {
        manifest,
        machine,
        options,
        watch,
        stop,
        locks: Locks::open(&lock_folder(results))?,
        results: Results::open(results)?,
        gate: Gate::new(options.memory),
        agenda: Mutex::new(Agenda { fresh: (0..manifest.jobs.len()).collect(), elsewhere: VecDeque::new() }),
        outcomes: Mutex::new(vec![Outcome::NotRun; manifest.jobs.len()]),
    };
    let jobs = options.jobs.max(1);
    fly(&batch, jobs);
    Ok(batch.outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// All jobs through all threads.
fn fly(batch: &Batch<'_>, jobs: usize) {
    let (to_compute, read) = sync_channel(jobs);
    let (to_write, computed) = sync_channel(jobs);
    let (read, computed) = (Mutex::new(read), Mutex::new(computed));
    thread::scope(|scope| {
        for _ in 0..jobs {
            let to_compute = to_compute.clone();
            scope.spawn(move || batch.read_all(&to_compute));
        }
        for _ in 0..jobs.min(batch.machine.at_once()) {
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

/// Which jobs are finished, in the manifest's order; nothing is written.
///
/// # Errors
/// [`Error::Read`].
pub fn finished(manifest: &Manifest, results: &Path, machine: &str) -> Result<Vec<bool>> {
    let results = Results::open(results)?;
    // An input that cannot be read is told when its job runs.
    let is = |job: &Job| fingerprint(job, machine).map_or(Ok(false), |f| results.finished(&f, job));
    manifest.jobs.iter().map(is).collect()
}

/// Where the locks of a results file are.
fn lock_folder(results: &Path) -> std::path::PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(results.file_name().unwrap_or_default());
    name.push(".locks");
    results.with_file_name(name)
}

/// What all threads share.
struct Batch<'a> {
    manifest: &'a Manifest,
    machine: &'a dyn Machine,
    options: &'a Options,
    watch: &'a dyn Watch,
    stop: &'a AtomicBool,
    locks: Locks,
    results: Results,
    gate: Gate,
    agenda: Mutex<Agenda>,
    outcomes: Mutex<Vec<Outcome>>,
}

/// Jobs still to be looked at.
struct Agenda {
    fresh: VecDeque<usize>,
    /// Those another process had when they were looked at.
    elsewhere: VecDeque<usize>,
}

/// A job on its way. Whatever ends it, its temporary files go, its memory is free and its lock is open.
struct Flight<'a> {
    index: usize,
    fingerprint: Option<String>,
    seconds: f64,
    _lock: Held,
    outputs: Outputs,
    permit: Option<Permit<'a>>,
}

/// What is known of a job when it ends.
struct End {
    fingerprint: Option<String>,
    seconds: f64,
    outputs: Vec<Written>,
    certificate: Option<Certificate>,
}

type Read<'a> = (Flight<'a>, Loaded);
type Computed<'a> = (Flight<'a>, Loaded, Reconstruction);

impl<'a> Batch<'a> {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn next(&self) -> Option<(usize, bool)> {
        let mut agenda = self.agenda.lock().unwrap_or_else(PoisonError::into_inner);
        let fresh = agenda.fresh.pop_front().map(|index| (index, false));
        fresh.or_else(|| agenda.elsewhere.pop_front().map(|index| (index, true)))
    }

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

    /// Reads a job whose lock is held; nothing where it has ended already.
    fn read(&'a self, index: usize, lock: Held) -> Option<Read<'a>> {
        let begin = Instant::now();
        let job = &self.manifest.jobs[index];
        let mut known = None;
        let read = guarded(|| {
            let print = fingerprint(job, &self.options.machine)?;
            known = Some(print.clone());
            if self.results.finished(&print, job)? {
                return Ok(Err(Outcome::Skipped));
            }
            if let Some(why) = self.results.failure(&print) {
                return Ok(Err(Outcome::Failed(format!("{why} (in another process)"))));
            }
            let loaded = Loaded::read(&job.input, job.options.clone())?;
            if fingerprint(job, &self.options.machine)? != print {
                return Err(Error::Format { path: job.input.clone(), message: "has changed while it was read".into() });
            }
            let permit = self.gate.pass(loaded.bytes())?;
            for target in &job.targets {
                let folder = target.parent().unwrap_or(Path::new("."));
                fs::create_dir_all(folder)
                    .map_err(|e| Error::Output { path: target.clone(), message: format!("its folder: {e}") })?;
            }
            let outputs = Outputs::open(&job.targets, None, Temporary::Fixed)?;
            Ok(Ok((permit, outputs, loaded)))
        });
        let seconds = begin.elapsed().as_secs_f64();
        match read {
            Ok(Ok((permit, outputs, loaded))) => {
                let flight = Flight { index, fingerprint: known, seconds, _lock: lock, outputs, permit: Some(permit) };
                Some((flight, loaded))
            }
            Ok(Err(outcome)) => {
                self.ended(index, outcome);
                None
            }
            Err(e) => {
                self.failed(index, known, seconds, &e);
                None
            }
        }
    }

    fn compute_all(&'a self, read: &Mutex<Receiver<Read<'a>>>, to_write: &SyncSender<Computed<'a>>) {
        while let Some((mut flight, loaded)) = take(read) {
            if self.stopped() {
                continue; // dropped: not run
            }
            let begin = Instant::now();
            let body = guarded(|| self.machine.compute(&|backend| loaded.compute(backend, &Silent)));
            flight.seconds += begin.elapsed().as_secs_f64();
            match body {
                Ok(body) => {
                    if to_write.send((flight, loaded, body)).is_err() {
                        break;
                    }
                }
                Err(e) => self.failed(flight.index, flight.fingerprint.clone(), flight.seconds, &e),
            }
        }
    }

    fn write_all(&self, computed: &Mutex<Receiver<Computed<'a>>>) {
        while let Some((flight, loaded, body)) = take(computed) {
            self.write(flight, &loaded, body);
        }
    }

    /// Makes the outputs of a job, renames them, and writes its line.
    fn write(&self, flight: Flight<'a>, loaded: &Loaded, mut body: Reconstruction) {
        let begin = Instant::now();
        let Flight { index, fingerprint, mut seconds, _lock, mut outputs, permit } = flight;
        let job = &self.manifest.jobs[index];
        // Times would differ from run to run; the result line has them.
        body.report.stages.clear();
        let written = guarded(|| {
            outputs.complete(&mut body, &loaded.options.output)?;
            let written = job.outputs.iter().zip(outputs.temporary()).map(|(file, (target, path))| {
                let (bytes, blake3) = digest(path).map_err(|source| Error::Write { path: target.into(), source })?;
                Ok(Written { file: file.clone(), bytes, blake3 })
            });
            let written = written.collect::<Result<Vec<_>>>()?;
            outputs.rename()?;
            Ok(written)
        });
        let certificate = Certificate::from(&body.report);
        drop((body, permit));
        seconds += begin.elapsed().as_secs_f64();
        match written {
            Ok(outputs) => {
                let end = End { fingerprint, seconds, outputs, certificate: Some(certificate) };
                match self.append(index, None, end) {
                    Ok(()) => self.ended(index, Outcome::Done),
                    Err(e) => self.ended(index, Outcome::Failed(e.to_string())),
                }
            }
            Err(e) => self.failed(index, fingerprint, seconds, &e),
        }
    }

    fn failed(&self, index: usize, fingerprint: Option<String>, seconds: f64, error: &Error) {
        let end = End { fingerprint, seconds, outputs: Vec::new(), certificate: None };
        let mut message = error.to_string();
        if let Err(e) = self.append(index, Some(message.clone()), end) {
            message += &format!("; {e}");
        }
        self.ended(index, Outcome::Failed(message));
    }

    fn append(&self, index: usize, error: Option<String>, end: End) -> Result<()> {
        let line = ResultLine {
            id: self.manifest.jobs[index].id.clone(),
            status: if error.is_some() { Status::Failed } else { Status::Done },
            error,
            seconds: (end.seconds * 1e3).round() / 1e3,
            version: env!("CARGO_PKG_VERSION").into(),
            fingerprint: end.fingerprint,
            outputs: end.outputs,
            certificate: end.certificate,
        };
        self.results.append(&line, &self.locks)
    }

    fn ended(&self, index: usize, outcome: Outcome) {
        self.watch.ended(&self.manifest.jobs[index], &outcome);
        if self.options.fail_fast && matches!(outcome, Outcome::Failed(_)) {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.outcomes.lock().unwrap_or_else(PoisonError::into_inner)[index] = outcome;
    }
}

/// The next of a queue that several threads take from; nothing when it has ended.
fn take<T>(queue: &Mutex<Receiver<T>>) -> Option<T> {
    queue.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

/// A job that panics has failed; the others go on.
fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    let words = |panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<String>().cloned();
        text.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).into())).unwrap_or_default()
    };
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        Err(Error::Numerics { stage: "job", message: format!("a defect of this program: {}", words(panic)) })
    })
}
