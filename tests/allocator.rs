//! The program's allocator: arrays have their contents, their zeros and their alignment, below and above the size from which they lie on large
//! pages. Miri runs these tests (`tests/sanitizers.sh miri`).
#![cfg(all(target_os = "linux", target_env = "gnu"))]

use interslice::cli::OnLargePages;

#[global_allocator]
static ALLOCATOR: OnLargePages = OnLargePages;

/// Bytes from which on an array lies on large pages. Miri knows no `madvise`: all its arrays are smaller.
const LARGE: usize = if cfg!(miri) { 1 << 20 } else { 8 << 20 };

/// Places of an array of `size` bytes that are looked at: both ends, those of pages, and some between.
fn places(size: usize) -> impl Iterator<Item = usize> {
    (0..size).step_by(size / 61 + 1).chain([size / 2 / 4096 * 4096, size - 1])
}

#[test]
fn zeroed_arrays_are_zero_even_where_others_lay() {
    for size in [1, 100, 4096, 1 << 20, LARGE - 1, LARGE, LARGE + 4097] {
        let mut array = vec![0u8; size];
        assert!(places(size).all(|at| array[at] == 0), "{size}");
        array.fill(7);
        drop(array);
        let again = vec![0u8; size];
        assert!(places(size).all(|at| again[at] == 0), "{size}");
    }
}

#[test]
fn an_array_that_grows_and_shrinks_keeps_what_it_holds() {
    for size in [1000, LARGE - 3, LARGE, LARGE + 5000] {
        let mut array = vec![9u8; size];
        for room in [size + 5000, 2 * LARGE + 1, 3 * LARGE] {
            array.reserve_exact(room - size);
            assert!(array.capacity() >= room && places(size).all(|at| array[at] == 9), "{size} in {room}");
        }
        for left in [size / 2, 100] {
            array.truncate(left);
            array.shrink_to_fit();
            assert!(places(left).all(|at| array[at] == 9), "{left} of {size}");
        }
    }
}

#[test]
fn arrays_lie_where_their_type_wants_them() {
    #[derive(Clone, Copy)]
    #[repr(align(64))]
    struct Aligned([u8; 64]);
    for count in [1, 3, LARGE / 64 + 1] {
        let mut array = vec![Aligned([1; 64]); count];
        assert_eq!(array.as_ptr() as usize % 64, 0, "{count}");
        array.extend_from_within(..);
        assert_eq!(array.as_ptr() as usize % 64, 0, "{count}");
        assert_eq!(array[2 * count - 1].0, [1; 64], "{count}");
    }
}
