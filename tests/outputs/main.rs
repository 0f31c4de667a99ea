//! What is written: meshes, volumes, scenes, reports, where they lie and what they say of their making.

mod appearance;
#[path = "../support/files.rs"]
mod files;
mod idle;
mod like;
mod p16_far_from_origin;
mod page;
#[cfg(unix)]
mod places;
mod provenance;
mod relief;
mod report;
#[cfg(feature = "dicom")]
#[path = "../support/rtss.rs"]
mod rtss;
mod scenes;
#[cfg(feature = "simplify")]
mod simplify;
mod stream;
#[path = "../support/mod.rs"]
mod support;
mod thin;
mod volume_formats;
mod written;
