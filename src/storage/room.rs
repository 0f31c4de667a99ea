//! Free memory and disk, and refusals of what needs more.

use std::path::Path;

use sysinfo::{Process, ProcessRefreshKind, ProcessesToUpdate, System, get_current_pid};

use crate::error::{Error, Result};

const MIB: f64 = (1 << 20) as f64;

/// Bytes that are free for files in a folder, be it on a disk or in memory (tmpfs); nothing on a system that does not tell.
#[cfg(any(target_os = "linux", target_os = "macos"))]
pub fn free_disk(folder: &Path) -> Option<u64> {
    let told = rustix::fs::statvfs(folder).ok()?;
    told.f_bavail.checked_mul(told.f_frsize)
}

/// Bytes that are free on the disk of a folder; nothing on a system that does not tell.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
pub fn free_disk(folder: &Path) -> Option<u64> {
    use sysinfo::{DiskRefreshKind, Disks};
    let folder = folder.canonicalize().ok()?;
    let disks = Disks::new_with_refreshed_list_specifics(DiskRefreshKind::nothing().with_storage()).ok()?;
    let holding = disks.iter().filter(|disk| folder.starts_with(disk.mount_point()));
    holding.max_by_key(|disk| disk.mount_point().components().count()).map(|disk| disk.available_space())
}

/// Refuses a folder of temporary files in which none can be made.
///
/// # Errors
/// [`Error::Output`] with the folder.
pub fn check_temporary(folder: &Path) -> Result<()> {
    let refusal = |e| format!("no temporary file ({e}); set TMPDIR to a folder for them");
    let made = tempfile::tempfile_in(folder).map_err(refusal);
    made.map(|_| ()).map_err(|message| Error::Output { path: folder.into(), message })
}

/// Bytes of memory that this process may take: what is free, and no more than its control groups (containers, Slurm) and its address space
/// (`ulimit -v`, Grid Engine) leave; nothing on a system that does not tell.
pub fn available() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory();
    let free = Some(system.available_memory()).filter(|bytes| *bytes > 0);
    free.into_iter().chain(left_to_this(&mut system)).min()
}

/// Whether this process may take less than the system has.
pub fn is_bounded() -> bool {
    System::new().is_ok_and(|mut system| left_to_this(&mut system).is_some())
}

/// What this process may take beside what it has, where it is bounded.
fn left_to_this(system: &mut System) -> Option<u64> {
    let id = get_current_pid().ok()?;
    let memory = ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[id]), false, memory);
    let own = system.process(id)?;
    left_by_groups(own).into_iter().chain(left_of_addresses(own)).min()
}

/// What the control groups of a process leave. Pages of files that they count go where memory is short, and do not count here.
fn left_by_groups(own: &Process) -> Option<u64> {
    own.cgroup_limits().map(|group| group.total_memory.saturating_sub(group.rss))
}

/// Share of the address space that arrays can fill; stacks and gaps between arrays take the rest. With all of it runs of 100 MiB fell.
#[cfg(any(target_os = "linux", target_os = "macos"))]
const FILLED: f64 = 0.75;

/// What arrays can fill of what is left of the address space of this process.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn left_of_addresses(own: &Process) -> Option<u64> {
    use rustix::process::{Resource, getrlimit};
    getrlimit(Resource::As).current.map(|most| (most.saturating_sub(own.virtual_memory()) as f64 * FILLED) as u64)
}

/// Other systems have no such limit.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn left_of_addresses(_own: &Process) -> Option<u64> {
    None
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

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_room_of_a_folder_is_its_own_and_not_that_of_the_disk_around_it() {
        // A file system without room of its own.
        assert_eq!(free_disk(Path::new("/proc")), Some(0));
        assert!(free_disk(&std::env::temp_dir()).is_some_and(|bytes| bytes > 0));
        assert_eq!(free_disk(Path::new("/gone")), None);
    }
}
