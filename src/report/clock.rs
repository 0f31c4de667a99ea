//! CPU clocks of the threads that compute a run: the one that runs the pipeline, those that it has beside it, and those of the pool.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// CPU seconds: of all threads that compute, and of the calling thread and those beside it alone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CpuSeconds {
    /// The calling thread's, those of the threads beside it and of the pool.
    pub all: f64,
    /// The calling thread's, and those of the threads beside it.
    pub own: f64,
}

/// CPU seconds of the calling thread so far; `None` where the system has no clock of threads that is known here (it has on Linux).
pub fn of_this_thread() -> Option<f64> {
    system::own().and_then(system::seconds)
}

/// Clocks of the pool's threads. A driver's own threads, and those of writers, are none of them.
#[derive(Debug, Clone)]
pub struct Clocks {
    pool: Vec<system::Clock>,
    /// The calling thread is one of the pool.
    within: bool,
    beside: Arc<Mutex<Beside>>,
}

/// Threads beside the calling one.
#[derive(Debug, Default)]
struct Beside {
    clocks: Vec<system::Clock>,
    /// CPU seconds of those that have ended.
    ended: f64,
}

/// A thread that runs beside the calling one until this is dropped, be it by a panic: the clock of a thread that has ended says nothing.
struct Running<'c> {
    beside: &'c Mutex<Beside>,
    clock: Option<system::Clock>,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        let mut beside = self.beside.lock().unwrap_or_else(PoisonError::into_inner);
        beside.ended += of_this_thread().unwrap_or(0.0);
        beside.clocks.retain(|other| Some(*other) != self.clock);
    }
}

impl Clocks {
    /// Clocks of the calling thread's pool.
    pub fn new() -> Self {
        // The global pool's threads live as long as the program.
        static GLOBAL: OnceLock<Vec<system::Clock>> = OnceLock::new();
        let ask = || rayon::broadcast(|_| system::own()).into_iter().flatten().collect();
        match rayon::current_thread_index() {
            Some(_) => Clocks { pool: ask(), within: true, beside: Arc::default() },
            None => Clocks { pool: GLOBAL.get_or_init(ask).clone(), within: false, beside: Arc::default() },
        }
    }

    /// Does `work` on a new thread beside the one that made the clocks, and counts it.
    pub fn beside<T>(&self, work: impl FnOnce() -> T) -> T {
        let running = Running { beside: &self.beside, clock: system::own() };
        self.others().clocks.extend(running.clock);
        work()
    }

    fn others(&self) -> MutexGuard<'_, Beside> {
        self.beside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// CPU seconds so far, by the thread that made the clocks.
    pub fn read(&self) -> Option<CpuSeconds> {
        let beside: f64 = {
            let beside = self.others();
            beside.ended + beside.clocks.iter().copied().filter_map(system::seconds).sum::<f64>()
        };
        let own = of_this_thread()? + beside;
        let pool: f64 = self.pool.iter().copied().filter_map(system::seconds).sum();
        Some(CpuSeconds { all: if self.within { pool + beside } else { pool + own }, own })
    }
}

impl Default for Clocks {
    fn default() -> Self {
        Clocks::new()
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod system {
    /// CPU clock of a thread.
    pub type Clock = libc::clockid_t;

    /// The calling thread's.
    pub fn own() -> Option<Clock> {
        let mut clock = 0;
        // SAFETY: `pthread_self` is the calling thread, which lives, and `clock` can be written to.
        let code = unsafe { libc::pthread_getcpuclockid(libc::pthread_self(), &raw mut clock) };
        (code == 0).then_some(clock)
    }

    /// What it says; nothing where its thread has ended.
    pub fn seconds(clock: Clock) -> Option<f64> {
        let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        // SAFETY: `time` can be written to; of a clock that is no more the call says so.
        let code = unsafe { libc::clock_gettime(clock, &raw mut time) };
        (code == 0).then_some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
mod system {
    /// There is none.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum Clock {}

    /// Nothing.
    pub fn own() -> Option<Clock> {
        None
    }

    /// Nothing.
    pub fn seconds(clock: Clock) -> Option<f64> {
        match clock {}
    }
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use std::hint::black_box;
    use std::sync::Barrier;
    use std::thread;
    use std::time::{Duration, Instant};

    use super::*;

    /// Computes for a while.
    fn busy() {
        let begin = Instant::now();
        let before = of_this_thread().expect("Linux has one");
        let mut sum = 0u64;
        while of_this_thread().expect("still") - before < 0.02 && begin.elapsed() < Duration::from_secs(20) {
            sum = (0..1000).fold(sum, |sum, k| black_box(sum + k));
        }
    }

    #[test]
    fn the_pools_work_counts_and_what_the_caller_does_counts_as_its_own() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");
        pool.install(|| {
            let clocks = Clocks::new();
            let before = clocks.read().expect("Linux has them");
            rayon::broadcast(|_| busy());
            let after = clocks.read().expect("still");
            // Each of the two threads has computed for 20 ms, the caller being one of them.
            assert!(after.all - before.all >= 0.04 && after.own - before.own >= 0.02, "{before:?} {after:?}");
        });
        let clocks = Clocks::new();
        let before = clocks.read().expect("Linux has them");
        rayon::broadcast(|_| busy());
        let between = clocks.read().expect("still");
        busy();
        let after = clocks.read().expect("still");
        assert!(between.all - before.all >= 0.02, "{before:?} {between:?}");
        assert!(between.own - before.own < 0.02, "a caller that waits does not compute: {before:?} {between:?}");
        assert!(after.own - between.own >= 0.02, "{between:?} {after:?}");
        let (has_computed, may_end) = (Barrier::new(2), Barrier::new(2));
        thread::scope(|scope| {
            scope.spawn(|| {
                clocks.beside(|| {
                    busy();
                    has_computed.wait();
                    may_end.wait();
                });
            });
            has_computed.wait();
            let living = clocks.read().expect("still");
            assert!(living.own - after.own >= 0.02 && living.all - after.all >= 0.02, "{after:?} {living:?}");
            may_end.wait();
        });
        let ended = clocks.read().expect("still");
        assert!(ended.own - after.own >= 0.02 && ended.all - after.all >= 0.02, "{after:?} {ended:?}");
        let failing = || {
            clocks.beside(|| {
                busy();
                panic!("on purpose")
            })
        };
        let failed = thread::scope(|scope| scope.spawn(failing).join());
        let counted = clocks.read().expect("still");
        assert!(failed.is_err() && clocks.others().clocks.is_empty(), "an ended thread has no clock");
        assert!(counted.own - ended.own >= 0.02, "{ended:?} {counted:?}");
    }
}
