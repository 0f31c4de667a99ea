//! Many jobs, and one job in parts.

#[path = "../support/cases.rs"]
mod cases;
#[cfg(unix)]
mod faults;
#[path = "../support/files.rs"]
mod files;
mod index;
mod manifests;
#[cfg(unix)]
mod one_place;
mod split;
