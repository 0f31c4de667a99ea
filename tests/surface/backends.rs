//! The paths that a property must hold on.

use interslice::{Backend, Reference};

/// Everything on the reference path, and on a GPU where the build has one.
pub fn on_backends(test: impl Fn(&dyn Backend)) {
    test(&Reference);
    #[cfg(feature = "gpu")]
    {
        use interslice::gpu::{Gpu, GpuOptions};
        test(&Gpu::open(&GpuOptions::default()).expect("a Vulkan driver (tests/run installs lavapipe)"));
    }
}
