//! Work in a thread of its own, without Python's lock: the calling thread listens for Ctrl-C and tells the progress.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError};
use std::time::Duration;

use interslice::progress::Stop;
use interslice::{Error, Progress, Result};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::errors::raised;

/// Time between two looks at signals and progress.
const LISTENS: Duration = Duration::from_millis(50);
/// Time between two looks whether something is free.
const PATIENCE: Duration = Duration::from_millis(1);

/// The process in which something was used first. A fork copies no threads: of what has some, nothing works in the child.
pub struct Home(OnceLock<u32>);

impl Home {
    /// None yet.
    pub const fn new() -> Self {
        Home(OnceLock::new())
    }

    /// Whether this process is another one, forked from it. Else this is home from now on.
    pub fn is_left(&self) -> bool {
        *self.0.get_or_init(std::process::id) != std::process::id()
    }
}

/// The process that has the threads of rayon's pool.
static POOL: Home = Home::new();

/// Does `work` on rayon's pool. In a forked process this would wait for threads that are not there: each call has a pool of its own there, since in
/// one for all a thread that waits for its own call's work would take up another call.
///
/// # Errors
/// Those of making threads.
pub fn pooled<T: Send>(work: impl FnOnce() -> T + Send) -> io::Result<T> {
    if !POOL.is_left() {
        return Ok(work());
    }
    let pool = ThreadPoolBuilder::new().build().map_err(io::Error::other)?;
    Ok(pool.install(work))
}

/// State of the current stage.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Stage {
    name: &'static str,
    done: usize,
    total: usize,
}

/// The worker's end of the line.
#[derive(Debug, Default)]
pub struct Watch {
    stop: Stop,
    stage: Mutex<Stage>,
    warnings: Mutex<Vec<String>>,
}

impl Watch {
    /// Says something to a person, once the work is done.
    pub fn warn(&self, message: &str) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(message.into());
    }

    /// The request to end, for work that looks at nothing else.
    pub fn stop(&self) -> Stop {
        self.stop.clone()
    }

    /// # Errors
    /// [`Error::Interrupted`] where the work is to end.
    pub fn go_on(&self) -> Result<()> {
        if self.stops() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Waits until `own` is free.
    ///
    /// # Errors
    /// [`Error::Interrupted`] where the work is to end before.
    pub fn lock<'m, T>(&self, own: &'m Mutex<T>) -> Result<MutexGuard<'m, T>> {
        loop {
            match own.try_lock() {
                Ok(guard) => return Ok(guard),
                Err(TryLockError::Poisoned(guard)) => return Ok(guard.into_inner()),
                Err(TryLockError::WouldBlock) => std::thread::sleep(PATIENCE),
            }
            self.go_on()?;
        }
    }

    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Watch {
    fn begin(&self, name: &'static str, total: usize) {
        *self.stage() = Stage { name, done: 0, total };
    }

    fn advance(&self, units: usize) {
        self.stage().done += units;
    }

    fn end(&self) {
        let mut stage = self.stage();
        stage.done = stage.total;
    }

    fn stops(&self) -> bool {
        self.stop.is_asked()
    }
}

/// Runs `work` in a thread. Ctrl-C and errors of `progress`, which is called as `progress(stage, done, total)`, end it.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let watch = Arc::new(Watch::default());
    let (sender, receiver) = channel();
    let receiver = Mutex::new(receiver);
    let of_worker = watch.clone();
    let worker = move || {
        let result = catch_unwind(AssertUnwindSafe(|| pooled(|| work(&of_worker))));
        // Nobody listens where the caller has panicked.
        let _ = sender.send(result);
    };
    std::thread::Builder::new().name("interslice".into()).spawn(worker)?;
    let mut told = Stage::default();
    let mut interrupted = None;
    let result = loop {
        let ends = interrupted.is_some();
        let waited = py.detach(|| {
            let receiver = receiver.lock().unwrap_or_else(PoisonError::into_inner);
            match ends {
                true => receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
                false => receiver.recv_timeout(LISTENS),
            }
        });
        match waited {
            Ok(result) => break result,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(pyo3::exceptions::PyRuntimeError::new_err("the computing thread has ended"));
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Err(error) = listen(py, &watch, progress.as_ref(), &mut told) {
                    watch.stop.ask();
                    interrupted = Some(error);
                }
            }
        }
    };
    if let Some(error) = interrupted {
        return Err(error);
    }
    let result = result.unwrap_or_else(|panic| resume_unwind(panic))?.map_err(raised)?;
    listen(py, &watch, progress.as_ref(), &mut told)?;
    warn(py, &std::mem::take(&mut *watch.warnings.lock().unwrap_or_else(PoisonError::into_inner)))?;
    Ok(result)
}

fn listen(py: Python<'_>, watch: &Watch, progress: Option<&Bound<'_, PyAny>>, told: &mut Stage) -> PyResult<()> {
    py.check_signals()?;
    let stage = *watch.stage();
    if let Some(progress) = progress.filter(|_| stage != *told && !stage.name.is_empty()) {
        *told = stage;
        progress.call1((stage.name, stage.done, stage.total))?;
    }
    Ok(())
}

/// Python's warnings of these words.
pub fn warn(py: Python<'_>, words: &[String]) -> PyResult<()> {
    let category = py.get_type::<pyo3::exceptions::PyUserWarning>();
    for message in words {
        let message = std::ffi::CString::new(message.replace('\0', " "))?;
        PyErr::warn(py, &category, &message, 2)?;
    }
    Ok(())
}
