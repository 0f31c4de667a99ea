//! Every stage on the GPU beside its f64 twin.

use interslice::gpu::selftest::cases::Cases;
use interslice::gpu::selftest::comparison::Comparison;
use interslice::gpu::selftest::twins::compare;
use interslice::gpu::{Gpu, GpuOptions};

fn poisoned() -> Gpu {
    Gpu::open(&GpuOptions { poison: true, ..GpuOptions::default() })
        .expect("a Vulkan driver (tests/run installs lavapipe)")
}

#[test]
fn stages_agree_with_their_twins() {
    let gpu = poisoned();
    let square = [1.0, 1.0];
    for (h, scale, cut) in [
        (square, 1, 0),
        ([0.45, 1.0], 1, 0),
        ([1.0, 0.7], 1, 0),
        ([1.0, 0.8], 1, 0),
        (square, 3, 0),
        // What lies in the rim is in no list: nobody may ask for its courses.
        (square, 1, 9),
    ] {
        let comparisons = compare(&gpu, &Cases::new(h, scale).cut(cut)).expect("the GPU works");
        for c in &comparisons {
            println!(
                "h = {h:?}, scale {scale}, cut {cut}, {:28} worst {:.2e} of {} values, bound {:.0e}, {}",
                c.stage, c.worst, c.compared, c.bound, c.place
            );
        }
        let failed: Vec<_> = comparisons.iter().filter(|c| !c.holds()).collect();
        assert!(failed.is_empty(), "h = {h:?}, scale {scale}, cut {cut}: {failed:#?}");
    }
}

#[test]
fn the_comparer_sees_differences() {
    let of = |gpu: &[f64], twin: &[f64]| {
        let mut out = Comparison::new("test", 0.01);
        for (n, a, b) in out.pairs(&"values", gpu, twin) {
            out.value(|| format!("value {n}"), *a, *b);
        }
        out
    };
    assert!(of(&[1.0, 2.0, f64::INFINITY], &[1.0, 2.005, f64::INFINITY]).holds());
    assert!(!of(&[], &[]).holds(), "nothing compared is nothing shown");
    assert!(!of(&[1.0, f64::NAN], &[1.0, f64::NAN]).holds());
    for (gpu, twin, place) in [
        (&[1.0, 2.0][..], &[1.0, 2.02][..], "value 1: 2 for 2.02"),
        (&[f64::NAN, 2.0], &[1.0, 2.0], "value 0: NaN for 1"),
        (&[f64::INFINITY, 2.0], &[1.0, 9.0], "value 0: inf for 1"),
        (&[1.0, 2.0], &[1.0, 2.0, 3.0], "2 values for 3"),
        (&[1.0, 2.0, 3.0], &[1.0, 2.0], "3 values for 2"),
    ] {
        let found = of(gpu, twin);
        assert!(!found.holds() && found.place == place, "{found:?}");
    }
}
