//! Progress of a run, told to a listener, and a request to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Listener to the progress of the pipeline. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A stage of `total` units begins.
    fn begin(&self, stage: &'static str, total: usize);
    /// Another `units` of the current stage are done.
    fn advance(&self, units: usize);
    /// The current stage is done.
    fn end(&self);
    /// Whether the run is to end at once, with [`Error::Interrupted`](crate::Error::Interrupted). It is asked between pieces of work.
    fn stops(&self) -> bool {
        false
    }
}

/// Listener that ignores everything.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &'static str, _total: usize) {}
    fn advance(&self, _units: usize) {}
    fn end(&self) {}
}

/// Listener that hands everything on, and ends the run, too, once what takes its results has failed.
pub(crate) struct Halting<'p> {
    listener: &'p dyn Progress,
    halted: AtomicBool,
}

impl<'p> Halting<'p> {
    /// Nothing has failed yet.
    pub fn new(listener: &'p dyn Progress) -> Self {
        Halting { listener, halted: AtomicBool::new(false) }
    }

    /// Ends the run.
    pub fn halt(&self) {
        self.halted.store(true, Ordering::Relaxed);
    }
}

impl Progress for Halting<'_> {
    fn begin(&self, stage: &'static str, total: usize) {
        self.listener.begin(stage, total);
    }

    fn advance(&self, units: usize) {
        self.listener.advance(units);
    }

    fn end(&self) {
        self.listener.end();
    }

    fn stops(&self) -> bool {
        self.halted.load(Ordering::Relaxed) || self.listener.stops()
    }
}

/// A request to end, which all copies share: whoever works asks for it between pieces of work.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Asks the work to end.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it is to end.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Asked(Stop);

    impl Progress for Asked {
        fn begin(&self, _stage: &'static str, _total: usize) {}
        fn advance(&self, _units: usize) {}
        fn end(&self) {}
        fn stops(&self) -> bool {
            self.0.is_asked()
        }
    }

    #[test]
    fn a_run_ends_when_its_listener_asks_and_when_its_output_fails() {
        for by_listener in [true, false] {
            let stop = Stop::default();
            let listener = Asked(stop.clone());
            let halting = Halting::new(&listener);
            assert!(!halting.stops());
            if by_listener {
                stop.ask()
            } else {
                halting.halt()
            }
            assert!(halting.stops(), "by the listener: {by_listener}");
            assert_eq!(listener.stops(), by_listener, "the listener is not told what it did not ask for");
        }
    }
}
