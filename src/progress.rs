//! Progress of a run, told to a listener.

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
