//! The same body however it lies, and the same work however large the image is.

use interslice::Settings;
use interslice::stack::SliceContent;

use super::{of_zoo, run, ways};
use crate::REFERENCE;
use crate::random::properties::lying::moved;
use crate::random::settings::inner_heights;
use crate::random::turned::TURNS;

#[test]
fn p06_the_same_body_however_it_lies() {
    for (name, bound) in [("one_to_one", 0.02), ("one_to_two", 0.1)] {
        for (way, settings) in ways() {
            let moved = moved(&of_zoo(name, 10.0), &settings, &REFERENCE, &TURNS).expect("the stack is valid");
            assert!(moved.iter().all(|(change, _)| *change <= bound), "{name}, {way}: {moved:?}");
        }
    }
}

/// Work is counted, not timed: band pixels of morphs and sweeps follow the contours.
#[test]
fn p11_work_follows_the_contours() {
    let work = |times: usize| {
        let small = of_zoo("one_to_two", 10.0);
        let [nx, ny] = small.dims;
        let inside = |k: usize, n: usize| {
            let (i, j) = (n % (times * nx), n / (times * nx));
            i < nx && j < ny && small.slices[k].content.inside(j * nx + i)
        };
        let mut stack = small.clone();
        stack.dims = [times * nx, times * ny];
        for (k, slice) in stack.slices.iter_mut().enumerate() {
            let mask = (0..times * nx * times * ny).map(|n| inside(k, n)).collect();
            slice.content = SliceContent::Mask(mask);
        }
        let body = run(&stack, &inner_heights(&stack, 8), &Settings::default());
        body.report.intervals.iter().map(|i| [i.trace_pixels, i.sweep_pixels]).collect::<Vec<_>>()
    };
    assert_eq!(work(1), work(4));
}
