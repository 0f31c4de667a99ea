//! A replayed run has the bytes of the run that was recorded, and a run that asks for something else is told so.

use crate::shapes::*;
use interslice::backend::replay::{Recorder, Recording, Replay};
use interslice::progress::Silent;
use interslice::settings::{Method, Motion};
use interslice::{
    Backend, ContourStack, Error, Reconstruction, Reference, Result, Settings, height_grid, reconstruct_with,
};

/// A tube that leans and splits; a part that ends.
fn tube() -> ContourStack {
    let two = |a: f64, b: f64| -> Shape {
        let (a, b) = (circle(a, 40.0, 12.0), circle(b, 35.0, 8.0));
        Box::new(move |x, y| a(x, y).min(b(x, y)))
    };
    let shapes = [circle(35.0, 40.0, 15.0), two(32.0, 58.0), two(30.0, 62.0), circle(30.0, 42.0, 13.0)];
    levels(91, &[0.0, 3.0, 7.0, 9.0], &shapes)
}

fn all_settings() -> [(&'static str, Settings); 4] {
    let all = Settings::default();
    [
        ("default", all.clone()),
        ("unfaired", Settings { fair: 0.0, ..all.clone() }),
        ("motion none", Settings { motion: Motion::None, ..all.clone() }),
        ("field", Settings { method: Method::Field, ..all }),
    ]
}

fn run(backend: &dyn Backend, settings: &Settings, dz: f64) -> Result<Reconstruction> {
    let stack = tube();
    let heights = height_grid(&stack, settings, Some(dz)).heights()?;
    reconstruct_with(&stack, &heights, settings, backend, &Silent)
}

fn recorded(backend: &dyn Backend, settings: &Settings) -> (Reconstruction, Recording) {
    let recorder = Recorder::new(backend);
    let body = run(&recorder, settings, 0.5).expect("a valid stack");
    (body, recorder.recording())
}

fn bits(body: &Reconstruction) -> Vec<(u64, Vec<u32>)> {
    body.layers.iter().map(|l| (l.z.to_bits(), l.phi.iter().map(|v| v.to_bits()).collect())).collect()
}

fn same_bytes(backend: &dyn Backend) {
    for (name, settings) in all_settings() {
        let (body, recording) = recorded(backend, &settings);
        for round in 0..2 {
            let replay = Replay::new(recording.clone());
            let again = run(&replay, &settings, 0.5).expect("the same questions");
            assert!(bits(&body) == bits(&again), "{name}, replayed for the {round}th time");
            assert_eq!(replay.left(), 0, "{name}: every answer is asked for");
            let profile = again.report.profile.expect("what the host has cost");
            assert!(profile.stages.iter().any(|stage| stage.name == "distance"), "{name}: {profile:?}");
        }
    }
}

#[test]
fn a_replayed_run_has_the_same_bytes() {
    same_bytes(&Reference);
}

#[cfg(feature = "gpu")]
#[test]
fn so_it_has_after_a_run_on_a_gpu() {
    use interslice::gpu::{Gpu, GpuOptions};
    same_bytes(&Gpu::open(&GpuOptions::default()).expect("a Vulkan driver (tests/run installs lavapipe)"));
}

#[test]
fn a_run_that_asks_for_something_else_is_told() {
    let [(_, whole), _, (_, still), (_, field)] = all_settings();
    let (_, recording) = recorded(&Reference, &whole);
    let refused = |settings: &Settings, dz: f64| match run(&Replay::new(recording.clone()), settings, dz) {
        Err(Error::Gpu(message)) => message,
        other => panic!("{:?} with {dz}", other.map(|body| body.layers.len())),
    };
    for (settings, dz) in [(&whole, 0.25), (&still, 0.5), (&field, 0.5)] {
        assert!(refused(settings, dz).contains("replay"), "{}", refused(settings, dz));
    }
    let replay = Replay::new(recording.clone());
    run(&replay, &whole, 0.5).expect("the same questions");
    match run(&replay, &whole, 0.5) {
        Err(Error::Gpu(message)) => assert!(message.contains("nothing more"), "{message}"),
        other => panic!("{:?}", other.map(|body| body.layers.len())),
    }
}
