//! The GPU path: shaders, kernels beside their twins, whole reconstructions beside those of the reference path, and what hardware does.

#[cfg(feature = "gpu")]
mod both_paths;
#[path = "../support/files.rs"]
mod files;
#[cfg(feature = "gpu")]
mod hardware;
#[cfg(feature = "gpu")]
mod profile;
mod replay;
#[cfg(feature = "gpu")]
mod shaders;
#[path = "../shapes/mod.rs"]
mod shapes;
#[cfg(feature = "gpu")]
mod twins;
