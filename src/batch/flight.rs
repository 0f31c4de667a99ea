//! A job on its way through a batch: read, computed, written, each step once.

use std::any::Any;
use std::cell::RefCell;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Instant;

use super::agenda::{Batch, Outcome};
use super::gate::Permit;
use super::lock::Held;
use super::pictures::is_picture;
use super::results::{Certificate, ResultLine, Status, Written};
use crate::backend::Means;
use crate::error::{Error, Result};
use crate::files::Loaded;
use crate::files::fingerprint::digest;
use crate::files::format;
use crate::files::outputs::Outputs;
use crate::files::pending::Temporary;
use crate::files::places::Places;
use crate::files::preview;
use crate::progress::Silent;
use crate::report::Provenance;
use crate::storage::spill::Budget;
use crate::surface::Reconstruction;

/// A job on its way. Whatever ends it, its temporary files go, its memory is free and its lock is open.
pub(super) struct Flight<'a> {
    index: usize,
    fingerprint: Option<String>,
    seconds: f64,
    outputs: Outputs,
    permit: Permit<'a>,
    /// Dropped last: until the temporary files are gone nobody else may make them.
    lock: Held,
}

/// Facts about a job when it ends.
struct End {
    fingerprint: Option<String>,
    seconds: f64,
    outputs: Vec<Written>,
    certificate: Option<Certificate>,
}

/// A job that was read.
pub(super) type Read<'a> = (Flight<'a>, (Loaded, Budget));
/// A job that was computed.
pub(super) type Computed<'a> = (Flight<'a>, Reconstruction);

impl<'a> Batch<'a> {
    /// Reads a job whose lock is held; nothing where it has ended already.
    pub(super) fn read(&'a self, index: usize, lock: Held) -> Option<Read<'a>> {
        let begin = Instant::now();
        let job = &self.manifest.jobs[index];
        let mut known = None;
        let read = guarded(|| {
            let print = job.fingerprint(&self.options.machine)?;
            known = Some(print.clone());
            if self.results.finished(&print, job)? {
                return Ok(Err(Outcome::Skipped));
            }
            if let Some(why) = self.results.failure(&print) {
                return Ok(Err(Outcome::Failed(format!("{why} (in another process)"))));
            }
            let loaded = Loaded::read(&job.input, job.options.clone())?;
            if job.fingerprint(&self.options.machine)? != print {
                return Err(Error::Format { path: job.input.clone(), message: "has changed while it was read".into() });
            }
            let stack = &loaded.stack;
            let targets = job.targets.iter().map(|t| t.as_path());
            let drawn = self.pictures.is_some() && !targets.clone().any(is_picture);
            // A small picture needs the mesh.
            let surface = drawn.then_some(Path::new("preview.ply"));
            let has_mesh = targets.clone().any(|path| matches!(format::kind(path), Ok(format::Kind::Mesh)));
            let writing = format::bytes(targets.chain(surface), stack.dims, &stack.geometry, stack.lid())
                + loaded.needs_to_simplify(has_mesh)
                + if drawn { preview::BYTES } else { 0 };
            let needs = loaded.needs();
            let budget = needs.budget(writing, Some(self.options.memory))?;
            // A job larger than the memory of all has all of it for itself.
            let permit = self.gate.pass((needs.all + writing).min(self.options.memory))?;
            for target in &job.targets {
                let folder = target.parent().unwrap_or(Path::new("."));
                fs::create_dir_all(folder)
                    .map_err(|e| Error::Output { path: target.clone(), message: format!("its folder: {e}") })?;
            }
            let mut places = Places::of(&job.input, &job.options)?;
            let outputs = Outputs::open(&job.targets, None, Temporary::Fixed, &mut places)?;
            let outputs = if drawn { outputs.with_preview() } else { outputs };
            outputs.check(&loaded.options.output)?;
            Ok(Ok((permit, outputs, (loaded, budget))))
        });
        let seconds = begin.elapsed().as_secs_f64();
        match read {
            Ok(Ok((permit, outputs, (loaded, budget)))) => {
                let flight = Flight { index, fingerprint: known, seconds, outputs, permit, lock };
                Some((flight, (loaded, budget)))
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

    /// Computes a job and writes its layers under temporary names; nothing where it has failed.
    pub(super) fn compute(&self, (mut flight, (loaded, budget)): Read<'a>) -> Option<Computed<'a>> {
        let begin = Instant::now();
        // A machine may ask again; one call follows the other.
        let outputs = RefCell::new(&mut flight.outputs);
        let body = guarded(|| {
            let mut body = self.machine.compute(&|backend| {
                let means = Means { backend, progress: &Silent, budget: &budget };
                loaded.compute(&means, &mut outputs.borrow_mut())
            })?;
            if outputs.borrow().has_report() {
                body.report.provenance = loaded.provenance()?.map(Provenance::lasting);
            }
            Ok(body)
        });
        flight.seconds += begin.elapsed().as_secs_f64();
        match body {
            Ok(body) => Some((flight, body)),
            Err(e) => {
                self.failed(flight.index, flight.fingerprint.clone(), flight.seconds, &e);
                None
            }
        }
    }

    /// Completes the outputs of a job, renames them, and writes its line.
    pub(super) fn write(&self, (flight, mut body): Computed<'a>) {
        let begin = Instant::now();
        let Flight { index, fingerprint, mut seconds, mut outputs, permit, lock } = flight;
        let job = &self.manifest.jobs[index];
        // Times would differ from run to run; the result line has them.
        body.report.stages.clear();
        body.report.profile = None;
        let written = guarded(|| {
            outputs.complete(&mut body.report)?;
            let written = job.outputs.iter().zip(outputs.temporary()).map(|(file, (target, path))| {
                let (bytes, blake3) = digest(path).map_err(|source| Error::Write { path: target.into(), source })?;
                Ok(Written { file: file.clone(), bytes, blake3 })
            });
            let written = written.collect::<Result<Vec<_>>>()?;
            if let (Some(pictures), Some(print), Some(picture)) = (&self.pictures, &fingerprint, outputs.take_preview())
            {
                pictures.keep(print, &picture)?;
            }
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
        drop(lock);
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
