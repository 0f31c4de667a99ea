//! How the system's allocator keeps freed memory.

/// Arrays from this size on go back to the system as soon as they are freed, bytes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE: libc::c_int = 1 << 20;

/// Lets freed memory go back to the system at once. glibc's allocator would learn from the first freed arrays to keep the later ones, up to
/// 64 MiB a thread and what lies between pieces that are in use: a run on large images kept a third more than it used. Others do as they do.
pub fn give_back_at_once() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: called before any other thread is there, as mallopt asks for.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
        libc::mallopt(libc::M_TRIM_THRESHOLD, LARGE);
    }
}
