//! Every stage on the GPU beside its f64 twin.
#![cfg(feature = "gpu")]

use interslice::gpu::comparison::Comparison;
use interslice::gpu::twin_cases::Cases;
use interslice::gpu::twins::compare;
use interslice::gpu::{Gpu, GpuOptions};

fn poisoned() -> Gpu {
    Gpu::open(&GpuOptions { poison: true, ..GpuOptions::default() })
        .expect("a Vulkan driver (tests/run installs lavapipe)")
}

#[test]
fn stages_agree_with_their_twins() {
    let gpu = poisoned();
    for (h, scale) in [([1.0, 1.0], 1), ([0.45, 1.0], 1), ([1.0, 0.7], 1), ([1.0, 0.8], 1), ([1.0, 1.0], 3)] {
        let comparisons = compare(&gpu, &Cases::new(h, scale)).expect("the GPU works");
        for c in &comparisons {
            println!(
                "h = {h:?}, scale {scale}, {:28} worst {:.2e} of {} values, bound {:.0e}",
                c.stage, c.worst, c.compared, c.bound
            );
        }
        let failed: Vec<_> = comparisons.iter().filter(|c| !c.holds()).collect();
        assert!(failed.is_empty(), "h = {h:?}, scale {scale}: {failed:#?}");
    }
}

#[test]
fn the_comparer_sees_differences() {
    let of = |pairs: &[(f64, f64)]| Comparison::of("test", 0.01, pairs.iter().copied());
    assert!(of(&[(1.0, 1.0), (2.0, 2.005), (f64::INFINITY, f64::INFINITY)]).holds());
    assert!(!of(&[]).holds(), "nothing compared is nothing shown");
    assert!(!of(&[(1.0, 1.0), (2.0, 2.02)]).holds());
    assert!(!of(&[(f64::NAN, 1.0), (2.0, 2.0)]).holds());
    assert!(!of(&[(1.0, 1.0), (f64::NAN, f64::NAN)]).holds());
    assert!(!of(&[(f64::INFINITY, 1.0), (2.0, 2.0)]).holds());
}
