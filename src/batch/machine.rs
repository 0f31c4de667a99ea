//! Machine on which a batch computes.

use crate::backend::Backend;
use crate::error::Result;
use crate::reference::Reference;
use crate::surface::Reconstruction;

/// One device for all jobs of a batch.
pub trait Machine: Sync {
    /// Computes one job, on a thread of its own; several are computed at once. `work` may be asked again, on another backend, when a device fails.
    ///
    /// # Errors
    /// The errors of `work`.
    fn compute(&self, work: &Work<'_>) -> Result<Reconstruction>;
}

/// The computing of a job on whatever backend.
pub type Work<'w> = dyn Fn(&dyn Backend) -> Result<Reconstruction> + 'w;

impl Machine for Reference {
    fn compute(&self, work: &Work<'_>) -> Result<Reconstruction> {
        work(self)
    }
}
