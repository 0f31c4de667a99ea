//! Stacks that several benches run on.
#![allow(dead_code)]

use std::path::PathBuf;

use interslice::stack::{ContourStack, Slice, SliceContent};

/// The same contours in an image this many times as wide and high.
pub fn widened(stack: &ContourStack, times: usize) -> ContourStack {
    let [nx, ny] = stack.dims;
    let dims = [times * nx, times * ny];
    let shift = [(dims[0] - nx) / 2, (dims[1] - ny) / 2];
    let inside = |content: &SliceContent, n: usize| {
        let (i, j) = (n % dims[0], n / dims[0]);
        match (i.checked_sub(shift[0]), j.checked_sub(shift[1])) {
            (Some(i), Some(j)) if i < nx && j < ny => content.inside(j * nx + i),
            _ => false,
        }
    };
    let slices = stack.slices.iter().map(|s| Slice {
        content: SliceContent::Mask((0..dims[0] * dims[1]).map(|n| inside(&s.content, n)).collect()),
        ..s.clone()
    });
    ContourStack { dims, slices: slices.collect(), ..stack.clone() }
}

/// Folders named in `INTERSLICE_STACKS`, separated by colons.
pub fn named_stacks() -> Vec<PathBuf> {
    std::env::var_os("INTERSLICE_STACKS").map(|v| std::env::split_paths(&v).collect()).unwrap_or_default()
}
