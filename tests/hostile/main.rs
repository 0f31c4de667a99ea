//! Wrong, damaged and hostile input: refused in words, in little memory, and nothing is lost.

mod bombs;
#[cfg(unix)]
mod climbing;
#[path = "../support/files.rs"]
mod files;
#[cfg(all(feature = "dicom", feature = "geopackage", feature = "zarr"))]
mod fuzzed;
#[cfg(all(feature = "dicom", feature = "terrain", feature = "zarr"))]
mod p15_inputs_stay;
mod refused;
#[cfg(feature = "dicom")]
#[path = "../support/rtss.rs"]
mod rtss;
#[cfg(all(unix, feature = "dicom", feature = "terrain"))]
mod sizes;
#[path = "../support/mod.rs"]
mod support;
mod volumes;
