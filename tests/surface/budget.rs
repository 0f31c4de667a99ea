//! Results do not depend on how much of a run is in memory.

use crate::shapes::*;
use interslice::progress::Silent;
use interslice::settings::Link;
use interslice::settings::{Method, Motion};
use interslice::surface::Layer;
use interslice::{Backend, Budget, ContourStack, Means, Reference, Settings, height_grid, reconstruct_into};

/// Nothing stays in memory, one thing is worked on at once.
fn least() -> Budget {
    Budget::of(0, 0)
}

/// Some things stay, two fit.
fn little(stack: &ContourStack) -> Budget {
    let field = 8 * stack.dims.iter().map(|n| (n + 44) as u64).product::<u64>();
    Budget::of(20 * field, 20 * field)
}

fn run(stack: &ContourStack, settings: &Settings, backend: &dyn Backend, budget: &Budget) -> (Vec<Layer>, String) {
    let heights = height_grid(stack, settings, None).heights().expect("a grid");
    let mut layers = Vec::new();
    let mut keep = |layer: Layer| {
        layers.push(layer);
        Ok(())
    };
    let body = reconstruct_into(stack, &heights, settings, &Means { backend, progress: &Silent, budget }, &mut keep)
        .expect("a valid stack");
    let mut report = body.report;
    report.stages.clear();
    report.profile = None;
    (layers, format!("{report:?}"))
}

fn check(name: &str, stack: &ContourStack, settings: &Settings, backend: &dyn Backend) {
    let whole = run(stack, settings, backend, &Budget::unlimited());
    for budget in [least(), little(stack)] {
        let part = run(stack, settings, backend, &budget);
        assert_eq!(whole.1, part.1, "{name}: reports");
        assert_eq!(whole.0.len(), part.0.len(), "{name}: layers");
        for (a, b) in whole.0.iter().zip(&part.0) {
            let same = a.phi.iter().zip(b.phi.iter()).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(a.z == b.z && same, "{name}: the layer at {}", a.z);
        }
    }
}

/// A tube that leans, splits, ends, and begins again; uneven heights, an empty slice.
fn tube() -> ContourStack {
    let disc = |x: f64, y: f64, r: f64| circle(x, y, r);
    let two = |a: f64, b: f64| -> Shape {
        let (a, b) = (disc(a, 50.0, 12.0), disc(b, 45.0, 10.0));
        Box::new(move |x, y| a(x, y).min(b(x, y)))
    };
    let shapes = [
        disc(35.0, 40.0, 15.0),
        disc(40.0, 44.0, 17.0),
        two(36.0, 62.0),
        two(33.0, 68.0),
        disc(33.0, 50.0, 11.0),
        Box::new(|_, _| 5.0),
        disc(50.0, 50.0, 14.0),
        disc(53.0, 47.0, 16.0),
        disc(57.0, 45.0, 12.0),
        disc(60.0, 45.0, 12.0),
    ];
    levels(99, &[0.0, 3.0, 5.0, 9.0, 11.0, 14.0, 17.0, 18.5, 22.0, 26.0], &shapes)
}

fn settings() -> Vec<(&'static str, Settings)> {
    let all = Settings::default();
    let apart = Link { slice: 2, from: 1, to: 2, join: false };
    vec![
        ("default", all.clone()),
        ("motion none", Settings { motion: Motion::None, ..all.clone() }),
        ("motion rigid", Settings { motion: Motion::Rigid, ..all.clone() }),
        ("method field", Settings { method: Method::Field, ..all.clone() }),
        ("kept apart", Settings { links: vec![apart], ..all }),
    ]
}

#[test]
fn what_does_not_fit_into_memory_gives_the_same_bits() {
    for (name, settings) in settings() {
        check(name, &tube(), &settings, &Reference);
    }
}

#[cfg(feature = "gpu")]
#[test]
fn so_it_does_on_a_gpu() {
    use interslice::gpu::{Gpu, GpuOptions};
    let gpu = Gpu::open(&GpuOptions { poison: true, ..GpuOptions::default() })
        .expect("a Vulkan driver (tests/run installs lavapipe)");
    for (name, settings) in settings() {
        check(name, &tube(), &settings, &gpu);
    }
}
