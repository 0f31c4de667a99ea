//! Free memory and disk, and refusals of what needs more.

use std::path::Path;

use sysinfo::{DiskRefreshKind, Disks, System};

use crate::error::{Error, Result};

const MIB: f64 = (1 << 20) as f64;

/// Bytes that are free on the disk of a folder; nothing on a system that does not tell.
pub fn free_disk(folder: &Path) -> Option<u64> {
    let folder = folder.canonicalize().ok()?;
    let disks = Disks::new_with_refreshed_list_specifics(DiskRefreshKind::nothing().with_storage()).ok()?;
    let holding = disks.iter().filter(|disk| folder.starts_with(disk.mount_point()));
    holding.max_by_key(|disk| disk.mount_point().components().count()).map(|disk| disk.available_space())
}

/// Bytes of memory that are free; nothing on a system that does not tell.
pub fn available() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory();
    Some(system.available_memory()).filter(|bytes| *bytes > 0)
}

/// Refuses to hold what was read where it is larger than the memory that is free.
///
/// # Errors
/// Refusal of what takes too much: its size and what is free.
pub fn check_room(bytes: f64) -> std::result::Result<(), String> {
    match available() {
        Some(free) if bytes > free as f64 => {
            Err(format!("take {:.0} MiB of memory, {} MiB are available", (bytes / MIB).ceil(), free >> 20))
        }
        _ => Ok(()),
    }
}

/// Refuses what needs more memory than `limit`, or else than is free.
///
/// # Errors
/// [`Error::Memory`] with both figures.
pub fn check(needed: u64, limit: Option<u64>) -> Result<()> {
    match limit.or_else(available) {
        Some(available) if needed > available => {
            Err(Error::Memory { needed_mib: needed.div_ceil(1 << 20), available_mib: available >> 20 })
        }
        _ => Ok(()),
    }
}
