//! RT structure sets in and out: files that this test writes itself.

mod checks;
mod completed;
mod contours;
mod damaged;
mod found;
mod near_copies;
mod planes;
mod rois;
