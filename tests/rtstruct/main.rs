//! RT structure sets in and out: files that this test writes itself.
#![cfg(feature = "dicom")]

mod checks;
mod completed;
mod contours;
mod damaged;
#[path = "../support/files.rs"]
mod files;
mod found;
mod planes;
mod rois;
#[path = "../support/rtss.rs"]
mod rtss;
