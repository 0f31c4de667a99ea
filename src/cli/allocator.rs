//! Requests to the system's allocator: freed memory goes back at once, large arrays lie on large pages.

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod linux {
    use std::alloc::{GlobalAlloc, Layout, System};

    /// Arrays from this size on go back to the system as soon as they are freed, bytes.
    const GIVEN_BACK: libc::c_int = 1 << 20;
    /// Bytes of a page; where pages are larger the kernel does not take the advice.
    const PAGE: usize = 4 << 10;
    /// Arrays of fewer bytes, of which a large page has 2 MiB, would take too much more than they are.
    const LEAST: usize = 8 << 20;

    /// The system's allocator. For large arrays it asks the kernel for large pages: a run on large images makes and
    /// gives back tens of gigabytes, and page by page of 4 KiB that took half of its time.
    #[derive(Debug, Clone, Copy)]
    pub struct OnLargePages;

    // SAFETY: every call is one of `System`, with its own arguments; advice changes neither contents nor ownership of memory.
    unsafe impl GlobalAlloc for OnLargePages {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            // SAFETY: the caller keeps to what `System` demands, which is what the trait demands.
            advised(unsafe { System.alloc(layout) }, layout.size())
        }

        unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
            // SAFETY: as in `alloc`.
            advised(unsafe { System.alloc_zeroed(layout) }, layout.size())
        }

        unsafe fn realloc(&self, array: *mut u8, layout: Layout, size: usize) -> *mut u8 {
            // SAFETY: as in `alloc`.
            advised(unsafe { System.realloc(array, layout, size) }, size)
        }

        unsafe fn dealloc(&self, array: *mut u8, layout: Layout) {
            // SAFETY: as in `alloc`.
            unsafe { System.dealloc(array, layout) }
        }
    }

    /// An array of `size` bytes, or null, after the kernel was asked for large pages where it is large.
    fn advised(array: *mut u8, size: usize) -> *mut u8 {
        if array.is_null() || size < LEAST {
            return array;
        }
        // All pages that it touches: a mapping of which a part has other advice is two for the kernel, and could not grow in place.
        let (first, end) = (array as usize / PAGE * PAGE, (array as usize + size).next_multiple_of(PAGE));
        // SAFETY: the array's own pages. Where others have a share in the first and last, nothing changes for them either: what they hold is
        // as it was. What the kernel answers does not matter: it is free not to.
        unsafe { libc::madvise(array.wrapping_sub(array as usize - first).cast(), end - first, libc::MADV_HUGEPAGE) };
        array
    }

    /// Lets freed memory go back to the system at once, and takes it from one heap for all threads. glibc's allocator would learn from the first
    /// freed arrays to keep the later ones, up to 64 MiB a thread and what lies between pieces that are in use: a run on large images kept a third
    /// more than it used. With a heap a thread, what lies between depends on which thread did what: a run that takes 68 to 71 MiB took 71 to 85.
    pub fn give_back_at_once() {
        // SAFETY: in the program no other thread is there yet, as mallopt's manual asks for, since others read without a lock what it sets. In the
        // module for Python there may be others: mallopt takes the arena's lock, the numbers are single words, and glibc's own `free` sets the
        // first two without a lock, too, beside such readers.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, GIVEN_BACK);
            libc::mallopt(libc::M_TRIM_THRESHOLD, GIVEN_BACK);
            libc::mallopt(libc::M_ARENA_MAX, 1);
        }
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub use linux::{OnLargePages, give_back_at_once};

/// Other systems' allocators do as they do.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back_at_once() {}
