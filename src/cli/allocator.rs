//! What the program asks of the system's allocator: freed memory goes back at once, large arrays lie on large pages.

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod linux {
    use std::alloc::{GlobalAlloc, Layout, System};

    /// Arrays from this size on go back to the system as soon as they are freed, bytes.
    const GIVEN_BACK: libc::c_int = 1 << 20;
    /// Bytes of a large page, on every machine that this program is made for; advice for other sizes does nothing.
    const LARGE_PAGE: usize = 2 << 20;
    /// Arrays of fewer bytes would take too much more than they are.
    const LEAST: usize = 4 * LARGE_PAGE;

    /// The system's allocator. Where it gives out whole large pages, it asks the kernel to back them as such: a run on large images makes and
    /// gives back tens of gigabytes, and page by page of 4 KiB that took half of its time.
    struct OnLargePages;

    #[global_allocator]
    static ALLOCATOR: OnLargePages = OnLargePages;

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

    /// An array of `size` bytes, or null, after the kernel was told to back its whole large pages as such.
    fn advised(array: *mut u8, size: usize) -> *mut u8 {
        if array.is_null() || size < LEAST {
            return array;
        }
        let before = (array as usize).next_multiple_of(LARGE_PAGE) - array as usize;
        let whole = (size - before) / LARGE_PAGE * LARGE_PAGE;
        // SAFETY: the range lies within the array. What the kernel answers does not matter: it is free not to.
        unsafe { libc::madvise(array.wrapping_add(before).cast(), whole, libc::MADV_HUGEPAGE) };
        array
    }

    /// Lets freed memory go back to the system at once. glibc's allocator would learn from the first freed arrays to keep the later ones, up
    /// to 64 MiB a thread and what lies between pieces that are in use: a run on large images kept a third more than it used.
    pub fn give_back_at_once() {
        // SAFETY: called before any other thread is there, as mallopt asks for.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, GIVEN_BACK);
            libc::mallopt(libc::M_TRIM_THRESHOLD, GIVEN_BACK);
        }
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub use linux::give_back_at_once;

/// Other systems' allocators do as they do.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back_at_once() {}
