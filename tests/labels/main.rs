//! Several bodies in one run: label volumes and images, segments, masks, each with its slices and its name.

mod commas;
mod ended;
#[path = "../support/files.rs"]
mod files;
mod label_images;
mod left_out;
mod members;
mod other_layers;
mod own_slices;
mod partitions;
#[cfg(feature = "dicom")]
#[path = "../support/rtss.rs"]
mod rtss;
mod segments;
mod stacked;
mod thin;
mod told;
mod unions;
mod written;
